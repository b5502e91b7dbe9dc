"""Vapour: shipped bands against their sources, k-distributions against band models, .xsc files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from cldit.errors import OpticsError
from cldit.optics.vapour import vapour_band
from cldit.optics.xsc import read_xsc

FILTER = (3.3, 3.5)


def _mean(species: str, filter_um: tuple[float, float], temperature_K: float = 298.0) -> float:
    wavelength = np.linspace(*filter_um, 400)
    band = vapour_band(species)
    return float(np.mean(band.absorption_m2_mol(1e4 / wavelength, temperature_K))) * 1e4


def test_n_heptane_against_the_sources() -> None:
    """cm2/mol of 3.375 to 3.425 um: estimate 5.07e5 of 508 km/mol, so 5.0e5; RadCal 6.22e5. Areas
    by the rule of Williams et al., JQSRT 129, 298 (2013), 503 km/mol, and RadCal's, 761."""
    band = vapour_band("n-heptane")
    assert band.status == "estimate"
    for temperature_K in (200.0, 293.0, 420.0, 794.0):
        assert band.area_km_mol(temperature_K) == pytest.approx(503.0, rel=1e-3)
    assert _mean("n-heptane", (3.375, 3.425)) == pytest.approx(5.07e5 * 503 / 508.5, rel=0.02)
    assert _mean("n-heptane-radcal", (3.375, 3.425), 293.0) == pytest.approx(6.22e5, rel=0.01)
    radcal = vapour_band("n-heptane-radcal")
    assert radcal.area_km_mol(293.0) == pytest.approx(761.0, rel=0.001)
    assert radcal.absorption_m2_mol(2950.0, 293.0) == pytest.approx(64.107, rel=1e-3)


def test_area_scales_everything() -> None:
    base, wider = vapour_band("n-heptane"), vapour_band("n-heptane", area_km_mol=761.0)
    number = np.linspace(2700, 3100, 50)
    ratio = wider.absorption_m2_mol(number, 500.0) / base.absorption_m2_mol(number, 500.0)
    assert ratio == pytest.approx(761 / 503, rel=1e-4)
    assert "761 km/mol" in wider.source
    for area in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(OpticsError, match="km/mol"):
            vapour_band("n-heptane", area_km_mol=area)


def test_methane_bins_are_lower_edges() -> None:
    """The Q branch at 3018.9 1/cm is in the bin that begins at 3000."""
    band = vapour_band("methane")
    values = band.absorption_m2_mol([2999.9, 3000.0, 3024.9, 3025.1], 300.0) * 1e4
    assert values == pytest.approx([14337, 79041, 79041, 8658], rel=1e-3)
    assert band.area_km_mol(300.0) == pytest.approx(61.37, rel=1e-3)


def _elsasser(tau: float, y: float) -> float:
    """Transmission of Elsasser's band, by adaptive quadrature of the textbook form."""
    top, bottom = np.sinh(2 * np.pi * y), np.cosh(2 * np.pi * y)
    points = [y] if y < 0.4 else None
    return float(
        2 * quad(lambda z: np.exp(-tau * top / (bottom - np.cos(2 * np.pi * z))), 0, 0.5,
                 points=points, limit=400, epsabs=1e-10)[0]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("points", "within"), [(8, 1.7e-2), (16, 2.1e-3), (32, 1.6e-4), (64, 1.1e-5)]
)
@pytest.mark.parametrize("pressure_Pa", [2e4, 4e5, 3e6])
def test_k_distribution_gives_the_band_model(
    pressure_Pa: float, points: int, within: float
) -> None:
    """Mean optical depths of 0.01 to 100 through 3.3 to 3.5 um, at the error that is stated."""
    band = vapour_band("methane")
    assert band.lines is not None
    found = band.k_distribution(FILTER, temperature_K=400.0, pressure_Pa=pressure_Pa, points=points)
    assert len(found.weights) <= points
    assert np.sum(found.weights) == pytest.approx(1, abs=1e-12)
    y = band.lines.fine_structure(temperature_K=400.0, pressure_Pa=pressure_Pa, mole_fraction=0.0)
    wavelength = 3.3 + 0.2 * (np.arange(4000) + 0.5) / 4000
    means, counts = np.unique(band.absorption_m2_mol(1e4 / wavelength, 400.0), return_counts=True)
    mean = np.average(means, weights=counts)
    assert found.weights @ found.absorption_m2_mol == pytest.approx(mean, rel=1e-6)
    for tau in (0.01, 0.1, 1.0, 10.0, 100.0):
        column = tau / mean
        exact = np.average([_elsasser(k * column, y) for k in means], weights=counts)
        assert found.transmission(column) == pytest.approx(exact, abs=within)


def test_fine_structure() -> None:
    """gamma / d at 273 K and 1 atm, diluted and pure, and its growth with temperature."""
    lines = vapour_band("methane").lines
    assert lines is not None
    at = {"temperature_K": 273.0, "pressure_Pa": 101325.0}
    assert lines.fine_structure(**at, mole_fraction=0.0) == pytest.approx(0.00734)
    assert lines.fine_structure(**at, mole_fraction=1.0) == pytest.approx(0.00734 * 1.3)
    hot = lines.fine_structure(temperature_K=546.0, pressure_Pa=101325.0, mole_fraction=0.0)
    assert hot == pytest.approx(0.00734 * np.exp(1.02) / np.sqrt(2))


def test_high_pressure_is_beer_lambert() -> None:
    """Lines merge: within a bin nothing is left of them, and k is one of the bins' means."""
    band = vapour_band("methane")
    filter_um = (1e4 / 3020.0, 1e4 / 3005.0)  # one bin
    found = band.k_distribution(filter_um, temperature_K=400.0, pressure_Pa=1e9, points=8)
    mean = float(band.absorption_m2_mol(3010.0, 400.0))
    assert found.transmission(1 / mean) == pytest.approx(np.exp(-1), rel=1e-6)


def test_methane_stays_translucent_where_the_mean_would_be_black() -> None:
    """A jet at 0.4 MPa, 445 K: about 0.3 for a column whose mean absorption says 0.5.

    The paper's jet stays below 0.3. Emissivity 0.3 is 2 cm of gas with 20 % of methane here; it
    is not a ceiling: the curve of growth goes on, as the square root of the column.
    """
    band = vapour_band("methane")
    found = band.k_distribution(
        FILTER, temperature_K=445.0, pressure_Pa=4e5, points=32, mole_fraction=0.2
    )
    mean = found.weights @ found.absorption_m2_mol
    column = 0.2 * 4e5 / (8.314 * 445.0) * 0.02
    emissivity = 1 - found.transmission(column)
    beer = 1 - np.exp(-mean * column)
    assert 0.25 < emissivity < 0.40
    assert beer > 1.5 * emissivity
    # 30 cm of it: a Beer-Lambert mean leaves exp(-13), the lines a tenth.
    assert 1 - found.transmission(15 * column) < 0.9


def test_smooth_spectrum_sorts_itself() -> None:
    """n-heptane: against the integral over the spectrum."""
    band = vapour_band("n-heptane")
    wavelength = np.linspace(*FILTER, 20001)
    k = band.absorption_m2_mol(1e4 / wavelength, 450.0)
    given: dict[str, Any] = {"temperature_K": 450.0, "pressure_Pa": 6e5, "points": 16}
    found = band.k_distribution(FILTER, **given)
    for column in (1e-4, 1e-2, 0.1, 1.0):
        exact = np.mean(np.exp(-k * column))
        assert found.transmission(column) == pytest.approx(exact, abs=3e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"filter_um": (3.5, 3.3)}, "empty"),
        ({"filter_um": (2.0, 5.0)}, "outside 2700..3250"),
        ({"temperature_K": float("nan")}, "nan K is outside"),
        ({"pressure_Pa": 0.0}, "allowed: pressures"),
        ({"mole_fraction": 1.5}, "allowed: pressures"),
        ({"points": 0}, "allowed: pressures"),
    ],
)
def test_impossible_k_distributions_are_refused(change: dict[str, object], message: str) -> None:
    given: dict[str, object] = {
        "filter_um": FILTER, "temperature_K": 400.0, "pressure_Pa": 4e5, "points": 8,
    } | change  # fmt: skip
    with pytest.raises(OpticsError, match=message):
        vapour_band("methane").k_distribution(given.pop("filter_um"), **given)  # type: ignore[arg-type]


def test_unknown_species_names_the_known() -> None:
    with pytest.raises(OpticsError, match="methane, n-heptane, n-heptane-radcal"):
        vapour_band("ethanol")


def _xsc(temperature_K: float, values: np.ndarray) -> str:
    head = (
        f"{'C7H16':>20}{2800.0:10.4f}{3000.0:10.4f}{len(values):7d}{temperature_K:7.1f}{760.0:6.1f}"
        f"{values.max():10.3E}{'0.112':>5}{'n-heptane':>15}{'':4}{'N2':>3}{1:3d}"
    )
    cells = [f"{value:10.3E}" for value in values]
    lines = ["".join(cells[at : at + 10]) for at in range(0, len(cells), 10)]
    return "\n".join([head, *lines]) + "\n"


def test_xsc_file(tmp_path: Path) -> None:
    """cm2 per molecule times 6.022e19 is m2/mol; temperatures are interpolated."""
    values = 1e-18 * (1 + np.arange(41) % 7)
    file = tmp_path / "heptane.xsc"
    file.write_text(_xsc(300.0, values) + _xsc(400.0, 0.5 * values))
    band = read_xsc(file)
    assert (band.species, band.status) == ("C7H16", "user")
    number = np.linspace(2800, 3000, 41)
    assert band.absorption_m2_mol(number, 300.0) == pytest.approx(values * 6.02214076e19, rel=1e-3)
    assert band.absorption_m2_mol(number, 350.0) == pytest.approx(
        0.75 * values * 6.02214076e19, rel=1e-3
    )
    with pytest.raises(OpticsError, match=r"500 K is outside 300\.\.400 K"):
        band.absorption_m2_mol(number, 500.0)


def test_damaged_xsc_files_are_refused(tmp_path: Path) -> None:
    good = _xsc(300.0, 1e-18 * np.ones(30))
    cases = {
        "has no": "\n",
        "is no head": "wavelength,k\n3.4,0.1\n",
        "30 points, 20 were found": "\n".join(good.splitlines()[:-1]),
        "several blocks": good + good,
        "negative": _xsc(300.0, 1e-18 * np.array([1.0, -1.0])),
    }
    for message, text in cases.items():
        file = tmp_path / "bad.xsc"
        file.write_text(text)
        with pytest.raises(OpticsError, match=message):
            read_xsc(file)
    with pytest.raises(OpticsError, match="cannot be read"):
        read_xsc(tmp_path / "none.xsc")
