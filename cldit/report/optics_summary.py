"""What a scene's optics are, in numbers: data beside the values of the scene and the paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError
from cldit.optics.droplets import DropletTable, droplet_table, table_error
from cldit.optics.liquid import Liquid, liquid, liquids
from cldit.optics.phase import PhaseFunction, phase_table
from cldit.optics.vapour import VapourBand, vapour_band, vapours
from cldit.scene.schema import ConeSpray, Monodisperse, NukiyamaTanasawa, Scene
from cldit.spray.sizes import Sizes, mean_diameter_m, strata_m

Floats = NDArray[np.float64]

_STRATA = 400
_WAVELENGTHS = 400


@dataclass(frozen=True)
class PaperSizes:
    """A row of the paper's Fig. 4, with n as it must be for the printed D10 and D32, um."""

    sizes: NukiyamaTanasawa | Monodisperse
    d10_um: float
    d32_um: float


FIG4 = (
    PaperSizes(NukiyamaTanasawa(m_um=1.5, n=1.0, p=3.0), 6.00, 9.00),
    PaperSizes(NukiyamaTanasawa(m_um=3.21, n=1.28822, p=2.0), 5.97, 9.00),
    PaperSizes(NukiyamaTanasawa(m_um=1.5, n=0.8642, p=1.0), 4.11, 9.00),
    PaperSizes(Monodisperse(diameter_um=9.0), 9.00, 9.00),
)


@dataclass(frozen=True)
class Row:
    """One line of the table: what the scene uses, what the data give, what the paper says."""

    quantity: str
    scene: str = ""
    data: str = ""
    paper: str = ""
    note: str = ""


@dataclass(frozen=True)
class SceneOptics:
    """Everything `optics_picture` draws. None where a scene has no droplets, or no data exist."""

    scene: Scene
    filter_um: tuple[float, float]
    fuel_K: float
    gas_K: float
    liquid: Liquid | None
    vapours: tuple[VapourBand, ...]
    sizes: Sizes | None
    table: DropletTable | None
    measured_table: DropletTable | None
    phase: PhaseFunction | None
    measured_phase: PhaseFunction | None
    rows: tuple[Row, ...]


def scene_optics(scene: Scene, *, cache: Path | None) -> SceneOptics:
    """The tables of a scene, and the same for the shipped data of its fuel over its filter.

    Args:
        cache: folder for the tables; None builds them afresh.

    Raises:
        OpticsError: the scene's values are outside what can be solved.
    """
    spray, optics = scene.spray, scene.optics
    cone = spray if isinstance(spray, ConeSpray) else None
    fuel = cone.fuel if cone is not None else "n-heptane"
    fuel_K = cone.fuel_temperature_K if cone is not None else 300.0
    gas_K = 0.5 * (fuel_K + cone.ambient.temperature_K) if cone is not None else 300.0
    low, high = optics.filter_um
    rows = [Row("filter", f"{low:g} to {high:g} µm", "", "3.4 µm", "")]

    has_liquid = fuel in liquids() and (cone is None or cone.droplets is not None)
    known = liquid(fuel) if has_liquid else None
    if known is not None and not (known.wavelength_um[0] <= low and high <= known.wavelength_um[1]):
        known = None
    wavelength = np.linspace(low, high, _WAVELENGTHS)
    n_data = k_data = None
    if known is not None:
        n, k = known.index(wavelength, fuel_K)
        n_data, k_data = float(np.mean(n)), float(np.mean(k))
        source = f"{known.status}: {known.source}"
        rows.append(Row("n of the liquid", f"{optics.n:g}", f"{n_data:.4f}", "1.338", source))
        rows.append(Row("k of the liquid", f"{optics.k:g}", f"{k_data:.4f}", "0.0341", known.fit))
    bands = tuple(vapour_band(name) for name in (fuel, f"{fuel}-radcal") if name in vapours())
    bands = tuple(band for band in bands if _covers(band, low, high))
    for band in bands:
        temperature = min(max(gas_K, band.temperatures_K[0]), band.temperatures_K[1])
        mean = float(np.mean(band.absorption_m2_mol(1e4 / wavelength, temperature)))
        paper = "5e+05" if fuel == "n-heptane" else ""
        rows.append(
            Row(
                f"vapour of {band.species}, cm²/mol",
                f"{optics.vapour_m2_mol * 1e4:.3g}",
                f"{mean * 1e4:.3g}",
                paper,
                f"{band.status}: {band.source}",
            )
        )
        gas_K = temperature
    sizes: Sizes | None = None
    if cone is not None:
        sizes = cone.droplets
    elif has_liquid:
        sizes = FIG4[0].sizes
    if sizes is None or not has_liquid:
        return SceneOptics(
            scene,
            (low, high),
            fuel_K,
            gas_K,
            None,
            bands,
            None,
            None,
            None,
            None,
            None,
            tuple(rows),
        )
    strata = strata_m(sizes, _STRATA)
    rows += _size_rows(sizes)
    table, phase = _solve(optics.wavelength_um, optics.n, optics.k, strata, cache)
    used = _droplet_values(table, phase, strata)
    measured_table = measured_phase = None
    found = ["", "", ""]
    if n_data is not None and k_data is not None:
        middle = 0.5 * (low + high)
        measured_table, measured_phase = _solve(middle, n_data, k_data, strata, cache)
        found = _droplet_values(measured_table, measured_phase, strata)
    names = ("droplets: scattering / extinction", "droplets: g", "droplets: extinction, m²/g")
    rows += [Row(name, mine, theirs) for name, mine, theirs in zip(names, used, found, strict=True)]
    error = table_error(table)
    rows.append(
        Row(
            "largest error of the droplet table",
            f"{100 * error.largest:.2g} %",
            "",
            "",
            f"Q_sca {error.scattering:.1g}, Q_abs {error.absorption:.1g}, g {error.asymmetry:.1g}",
        )
    )
    return SceneOptics(
        scene,
        (low, high),
        fuel_K,
        gas_K,
        known,
        bands,
        sizes,
        table,
        measured_table,
        phase,
        measured_phase,
        tuple(rows),
    )


def _covers(band: VapourBand, low_um: float, high_um: float) -> bool:
    low, high = band.wavenumber_per_cm
    return low <= 1e4 / high_um and 1e4 / low_um <= high


def _size_rows(sizes: Sizes) -> list[Row]:
    rows = []
    for name, orders, paper in (("D32", (3, 2), "9.00"), ("D10", (1, 0), "4.11 to 9.00")):
        try:
            text = f"{mean_diameter_m(sizes, *orders) * 1e6:.2f}"
        except SprayError:
            text = "does not exist"
        rows.append(Row(f"{name} at the nozzle, µm", text, "", paper))
    return rows


def _solve(
    wavelength_um: float, n: float, k: float, strata: Floats, cache: Path | None
) -> tuple[DropletTable, PhaseFunction]:
    table = droplet_table(wavelength_um=wavelength_um, n=n, k=k, cache=cache)
    largest = max(100e-6, float(strata[-1]))
    phases = phase_table(wavelength_um=wavelength_um, n=n, k=k, cache=cache, largest_m=largest)
    return table, phases.mean(strata, strata**-3.0)


def _droplet_values(table: DropletTable, phase: PhaseFunction, strata: Floats) -> list[str]:
    """Single-scattering albedo, g, and extinction for a gram of liquid of 0.68 g/cm3."""
    absorbed, scattered = table.cross_sections(strata)
    volume = np.pi / 6 * strata**3
    extinct = float(np.mean((absorbed + scattered) / volume))
    albedo = float(np.mean(scattered / volume)) / extinct
    return [f"{albedo:.3f}", f"{phase.asymmetry:.3f}", f"{extinct / 0.68e6:.3f}"]
