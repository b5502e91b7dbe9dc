"""Liquids: fitted bands against their sources, temperature, tables that users bring."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import hilbert

from cldit.errors import OpticsError
from cldit.optics.liquid import liquid, liquids
from cldit.optics.liquid_table import read_liquid_table
from cldit.spray.cone.fluid_properties import heptane_density_kg_m3

# wavelength um, n, k, as the sources of the shipped bands give them.
SOURCES = {
    "n-octane": [
        (2.35, 1.38341, 8.1415e-4), (3.0, 1.37765, 1.3668e-4), (3.35, 1.32021, 9.9898e-3),
        (3.38, 1.33297, 0.1144), (3.40, 1.32642, 0.067775), (3.42, 1.40232, 0.16643),
        (3.46, 1.4236, 0.032267), (3.50, 1.42403, 0.079754), (3.6, 1.4122, 2.0795e-3),
        (3.8, 1.39818, 1.1425e-3), (5.0, 1.38892, 8.935e-5),
    ],
    "n-heptane": [
        (2.35, 1.37346, 8.0251e-4), (3.0, 1.36773, 1.3472e-4), (3.35, 1.30826, 0.01047),
        (3.38, 1.32535, 0.12536), (3.40, 1.32382, 0.070426), (3.42, 1.39964, 0.15766),
        (3.46, 1.41194, 0.03052), (3.50, 1.41521, 0.074315), (3.6, 1.40164, 2.0056e-3),
        (3.8, 1.38805, 1.1262e-3), (5.0, 1.37897, 8.807e-5),
    ],
    "iso-octane": [
        (2.351, 1.379, 6.49e-4), (3.0, 1.373, 4.758e-4), (3.352, 1.333, 0.0241032),
        (3.376, 1.329, 0.0443424), (3.40, 1.352, 0.08191), (3.416, 1.379, 0.0752494),
        (3.456, 1.398, 0.0626709), (3.496, 1.42, 0.0475135), (3.6, 1.417, 2.7703e-3),
        (3.8, 1.393, 1.1901e-3), (5.0, 1.383, 1.676e-4),
    ],
}  # fmt: skip
# Largest errors that the data files state: k where it is above 0.005, k elsewhere, n.
FITS = {"n-octane": (0.04, 1.5e-4, 1.1e-3), "n-heptane": (5e-3, 6e-5, 3.1e-4)}
FITS["iso-octane"] = (0.04, 2.6e-4, 1.5e-2)


@pytest.mark.parametrize("name", liquids())
def test_bands_against_their_source(name: str) -> None:
    known = liquid(name)
    assert known.temperature_K is not None
    wavelength, n_source, k_source = np.array(SOURCES[name]).T
    n, k = known.index(wavelength, known.temperature_K)
    strong, weak, real = FITS[name]
    band = k_source > 0.005
    assert k[band] == pytest.approx(k_source[band], rel=strong)
    assert k[~band] == pytest.approx(k_source[~band], abs=weak)
    assert n == pytest.approx(n_source, abs=real)
    assert np.all(k >= 0) and known.licence and known.fit and known.source


@pytest.mark.parametrize("name", liquids())
def test_n_follows_from_k_by_kramers_and_kronig(name: str) -> None:
    """n of the bands is closed form; here it is the Hilbert transform of their k over the whole
    range, at steps of 0.3 1/cm in bands of 4 1/cm and more, padded with zeros to eight times the
    range. What differs is the background and what lies beyond the ends, a smooth curve that is
    fitted; 6e-7 is left, where n varies by 0.1 to 0.2."""
    known = liquid(name)
    number = np.arange(1790.0, 4970.0, 0.3)
    n, k = known.index(1e4 / number, known.temperature_K or 0.0)
    found = -hilbert(k, 8 * len(k)).imag[: len(k)]
    near = (number > 2500.0) & (number < 3333.0)
    ratio = (number[near] / 3000.0) ** 2
    smooth = np.stack([np.ones_like(ratio), ratio, 1 / ratio], axis=1)
    rest = (n - found)[near]
    rest -= smooth @ np.linalg.lstsq(smooth, rest, rcond=None)[0]
    assert np.max(np.abs(rest)) < 2e-6


def test_the_papers_wavelength() -> None:
    """The paper's k = 0.0341 is half of every source's; only a filter 0.36 um wide gives it."""
    heptane = liquid("n-heptane")
    assert heptane.status == "estimate"
    assert float(heptane.index(3.4, 299.15)[1]) == pytest.approx(0.070, abs=0.001)
    narrow = heptane.index(np.linspace(3.375, 3.425, 400), 299.15)
    assert np.mean(narrow[1]) == pytest.approx(0.108, abs=0.002)
    wide = heptane.index(np.linspace(3.22, 3.58, 2000), 299.15)
    assert np.mean(wide[1]) == pytest.approx(0.0337, abs=0.0003)


def test_temperature() -> None:
    """k as the density, here against the spray's own fit; n by -5.1e-4 per K."""
    heptane = liquid("n-heptane")
    n0, k0 = heptane.index(3.42, 299.15)
    for temperature_K in (200.0, 370.0, 500.0):
        n, k = heptane.index(3.42, temperature_K)
        ratio = heptane_density_kg_m3(temperature_K) / heptane_density_kg_m3(299.15)
        assert k / k0 == pytest.approx(float(ratio), rel=1e-6)
        assert n - n0 == pytest.approx(-5.1e-4 * (temperature_K - 299.15))


@pytest.mark.parametrize("wavelength", [1.9, 5.7, 0.0, -3.4, float("nan"), 3400.0])
def test_wavelengths_outside_are_refused(wavelength: float) -> None:
    with pytest.raises(OpticsError, match=r"outside 2\.\.5\.6 um"):
        liquid("n-heptane").index([3.4, wavelength], 300.0)


@pytest.mark.parametrize("temperature_K", [0.0, -1.0, 540.0, float("nan"), float("inf")])
def test_temperatures_outside_are_refused(temperature_K: float) -> None:
    with pytest.raises(OpticsError, match=r"outside 183\.\.530 K"):
        liquid("n-heptane").index(3.4, temperature_K)


def test_shapes_and_names() -> None:
    n, k = liquid("iso-octane").index(np.full((2, 3), 3.4), 300.0)
    assert n.shape == k.shape == (2, 3)
    assert liquid("iso-octane").index([], 300.0)[0].shape == (0,)
    with pytest.raises(OpticsError, match="iso-octane, n-heptane, n-octane"):
        liquid("water")


CSV = "wavelength_um,n,k\n3.5,1.42,0.05\n3.4,1.33,0.07\n3.3,1.35,0.002\n"


def test_csv_table(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    for text in (CSV, "# from a lab\n" + CSV, CSV.split("\n", 1)[1]):
        file.write_text(text)
        mine = read_liquid_table(file)
        assert (mine.name, mine.status, mine.wavelength_um) == ("mine", "user", (3.3, 3.5))
        n, k = mine.index([3.4, 3.45], 400.0)
        assert n == pytest.approx([1.33, 1.375]) and k == pytest.approx([0.07, 0.06])
    with pytest.raises(OpticsError, match=r"outside 3\.3\.\.3\.5 um"):
        mine.index(3.6, 300.0)


def _yaml(*parts: str) -> str:
    return "REFERENCES: somebody\nCONDITIONS:\n  temperature: 298\nDATA:\n" + "".join(parts)


NK = "  - type: tabulated nk\n    data: |\n        3.3 1.35 0.002\n        3.5 1.42 0.05\n"
K = "  - type: tabulated k\n    data: |\n        3.3 0.002\n        3.5 0.05\n"
N_OF_LESS = "  - type: tabulated n\n    data: |\n        3.4 1.3\n        3.45 1.3\n"
SELLMEIER = (
    "  - type: formula {kind}\n    wavelength_range: 0.23 9.7\n"
    "    coefficients: 0 0.5675888 {a} 0.4710914 {b} 3.8484723 {c}\n"
)
CAF2 = (0.050263605, 0.1003909, 34.649040)


def test_refractiveindex_info_yaml(tmp_path: Path) -> None:
    """Calcium fluoride (Malitson 1963) has n = 1.4149 at 3.4 um in either form of Sellmeier."""
    file = tmp_path / "mine.yml"
    file.write_text(_yaml(NK))
    mine = read_liquid_table(file)
    assert (mine.source, mine.temperature_K) == ("somebody", 298.0)
    assert mine.index(3.4, 300.0)[0] == pytest.approx(1.385)
    for kind, power in ((1, 1), (2, 2)):
        a, b, c = (value**power for value in CAF2)
        file.write_text(_yaml(SELLMEIER.format(kind=kind, a=a, b=b, c=c), K))
        n, k = read_liquid_table(file).index(3.4, 300.0)
        assert n == pytest.approx(1.4149, abs=2e-4) and k == pytest.approx(0.026)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3300,1.3,0.1\n3400,1.3,0.1\n", "nm"),
        ("3.3e-6,1.3,0.1\n3.4e-6,1.3,0.1\n", "look like m "),
        ("3.3,1.3,-0.1\n3.4,1.3,0.1\n", "k = -0.1 at 3.3 um"),
        ("3.3,1.3,nan\n3.4,1.3,0.1\n", "not finite"),
        ("3.3,1.3,0.1\n3.3,1.3,0.1\n", "occurs twice"),
        ("3.3,1.3,0.1\n3.4,oops,0.1\n", "line 2: .* numbers only"),
        ("wavelength_nm,n,k\n3300,1.3,0.1\n", "allowed: wavelength_um"),
        ("", "no line of numbers"),
        (_yaml(K), "has no n"),
        (_yaml(SELLMEIER.format(kind=1, a=0.05, b=0.1, c=34.6)), "has no k"),
        (_yaml("  - type: formula 7\n    coefficients: 1 2 3\n"), "formula 7"),
        (_yaml(K, N_OF_LESS), "beyond"),
        (_yaml("  - type: tabulated nk\n"), "not numbers"),
        ("DATA: 3\n", "no DATA list"),
        ("a: [", "not valid YAML"),
    ],
)  # fmt: skip
def test_impossible_tables_are_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / ("bad.yml" if ":" in text else "bad.csv")
    file.write_text(text)
    with pytest.raises(OpticsError, match=message):
        read_liquid_table(file)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OpticsError, match="cannot be read"):
        read_liquid_table(tmp_path / "none.csv")
