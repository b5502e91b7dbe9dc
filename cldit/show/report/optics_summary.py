"""Optical properties of a scene in numbers, beside data and the values of the paper."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K, STANDARD_ATMOSPHERE_Pa
from cldit.errors import SprayError
from cldit.optics.droplets import DropletTable, droplet_table, table_error
from cldit.optics.liquid import Liquid, liquid, liquids
from cldit.optics.liquid_table import read_liquid_table
from cldit.optics.phase import PhaseFunction, phase_table
from cldit.optics.response import edges_um, scene_filter
from cldit.optics.vapour import VapourBand, vapour_band, vapours
from cldit.optics.xsc import read_xsc
from cldit.scene.optics import Optics
from cldit.scene.schema import Scene
from cldit.scene.sizes import Monodisperse, NukiyamaTanasawa
from cldit.scene.spray import ConeSpray, LagrangianSpray
from cldit.spray.sizes import Sizes, mean_diameter_m, strata_m

_SAMPLES = 400  # of sizes and of wavelengths


@dataclass(frozen=True)
class PaperSizes:
    """A row of the paper's Fig. 4, with n corrected to give the printed D10 and D32, um."""

    sizes: NukiyamaTanasawa | Monodisperse
    d10_um: float
    d32_um: float


PAPER = Optics()  # its defaults are the paper's constants
FIG4 = (
    PaperSizes(NukiyamaTanasawa(m_um=1.5, n=1.0, p=3.0), 6.00, 9.00),
    PaperSizes(NukiyamaTanasawa(m_um=3.21, n=1.28822, p=2.0), 5.97, 9.00),
    PaperSizes(NukiyamaTanasawa(m_um=1.5, n=0.8642, p=1.0), 4.11, 9.00),
    PaperSizes(Monodisperse(diameter_um=9.0), 9.00, 9.00),
)


@dataclass(frozen=True)
class Row:
    """One line of the table: values of the scene, of the data, and of the paper."""

    quantity: str
    scene: str = ""
    data: str = ""
    paper: str = ""
    note: str = ""


@dataclass(frozen=True)
class Growth:
    """Emissivity through the filter over the column (C,), mol/m2, with and without lines."""

    species: str
    column_mol_m2: Floats
    emissivity: Floats
    beer: Floats


@dataclass(frozen=True)
class Droplets:
    """Efficiencies over size, and the phase function of a scene's sizes, for one index."""

    table: DropletTable
    phase: PhaseFunction


@dataclass(frozen=True)
class SceneOptics:
    """Data of `optics_figure`.

    droplets: with the scene's refractive index; measured: with the data's mean over the filter.
    Both, like sizes and liquid, are None if a scene has no droplets or there are no data.
    """

    scene: Scene
    filter_um: tuple[float, float]
    fuel_K: float
    gas_K: float
    liquid: Liquid | None
    vapours: tuple[VapourBand, ...]
    growth: tuple[Growth, ...]
    sizes: Sizes | None
    droplets: Droplets | None
    measured: Droplets | None
    rows: tuple[Row, ...]
    sources: tuple[str, ...]


def scene_optics(scene: Scene, *, cache: Path | None) -> SceneOptics:
    """Tables of a scene, and of the shipped data of its fuel over its filter.

    The gas temperature is the mean of fuel and ambient. A scene without a fuel is shown with
    n-heptane and the paper's first distribution of sizes. Tables are kept in `cache`; None keeps
    none. Raises OpticsError if the scene's values cannot be solved.
    """
    optics = scene.optics
    cone = scene.spray if isinstance(scene.spray, ConeSpray | LagrangianSpray) else None
    fuel, fuel_K, gas_K, pressure_Pa = "n-heptane", 300.0, 300.0, STANDARD_ATMOSPHERE_Pa
    sizes: Sizes | None = FIG4[0].sizes
    if cone is not None:
        fuel, fuel_K, sizes = cone.fuel, cone.fuel_temperature_K, cone.droplets
        gas_K = 0.5 * (fuel_K + cone.ambient.temperature_K)
        pressure_Pa = cone.ambient.pressure_Pa
    low, high = filter_um = edges_um(scene_filter(scene))
    fluid = _liquid(optics.liquid or fuel) if sizes is not None else None
    if fluid is not None and not (fluid.wavelength_um[0] <= low and high <= fluid.wavelength_um[1]):
        fluid = None
    index, rows, sources = _liquid_rows(fluid, optics, filter_um, fuel_K)
    of_paper = f"around {PAPER.wavelength_um:g} µm"
    rows.insert(0, Row("filter", f"{low:g} to {high:g} µm", "", of_paper))
    named = _vapours(optics.vapour or fuel, optics.vapour_area_km_mol)
    bands = tuple(band for band in named if _covers(band, low, high))
    for band in bands:
        gas_K = min(max(gas_K, band.temperatures_K[0]), band.temperatures_K[1])
    rows += [_vapour_row(band, optics, filter_um, gas_K, fuel) for band in bands]
    sources += [f"{band.species} vapour ({band.status}): {band.source}" for band in bands]
    growth = tuple(_growth(band, filter_um, gas_K, pressure_Pa) for band in bands if band.lines)
    rows += [_growth_row(curve, gas_K, pressure_Pa) for curve in growth]

    droplets = measured = None
    if sizes is not None:
        strata = strata_m(sizes, _SAMPLES)
        droplets = _solve(
            strata, wavelength_um=optics.wavelength_um, n=optics.n, k=optics.k, cache=cache
        )
        if index is not None:
            measured = _solve(
                strata, wavelength_um=0.5 * (low + high), n=index[0], k=index[1], cache=cache
            )
        rows += [*_size_rows(sizes), *_droplet_rows(droplets, measured, strata)]
    return SceneOptics(
        scene=scene,
        filter_um=filter_um,
        fuel_K=fuel_K,
        gas_K=gas_K,
        liquid=fluid,
        vapours=bands,
        growth=growth,
        sizes=sizes,
        droplets=droplets,
        measured=measured,
        rows=tuple(rows),
        sources=tuple(sources),
    )


def _liquid_rows(
    fluid: Liquid | None, optics: Optics, filter_um: tuple[float, float], fuel_K: float
) -> tuple[tuple[float, float] | None, list[Row], list[str]]:
    """Mean index of a liquid over the filter, its rows and its source; nothing without data."""
    if fluid is None:
        return None, [], []
    n, k = (float(np.mean(part)) for part in fluid.index(np.linspace(*filter_um, _SAMPLES), fuel_K))
    note = f"{fluid.status}, mean over the filter at {fuel_K:.0f} K"
    rows = [
        Row("n of the liquid", f"{optics.n:g}", f"{n:.4f}", f"{PAPER.n:g}", note),
        Row("k of the liquid", f"{optics.k:g}", f"{k:.4f}", f"{PAPER.k:g}", note),
    ]
    fit = f"; fit {fluid.fit}" if fluid.fit else ""
    return (n, k), rows, [f"{fluid.name} ({fluid.status}): {fluid.source}{fit}"]


def _vapour_row(
    band: VapourBand, optics: Optics, filter_um: tuple[float, float], gas_K: float, fuel: str
) -> Row:
    wavenumber_per_cm = 1e4 / np.linspace(*filter_um, _SAMPLES)
    mean = float(np.mean(band.absorption_m2_mol(wavenumber_per_cm, gas_K))) * 1e4
    return Row(
        f"vapour of {band.species}, cm²/mol",
        f"{optics.vapour_m2_mol * 1e4:.3g}",
        f"{mean:.3g}",
        f"{PAPER.vapour_m2_mol * 1e4:.3g}" if fuel == "n-heptane" else "",
        f"{band.status}, mean over the filter at {gas_K:.0f} K",
    )


def _liquid(name: str) -> Liquid | None:
    """The user's table, or shipped data; None if a fuel has none."""
    if Path(name).suffix:
        return read_liquid_table(Path(name))
    return liquid(name) if name in liquids() else None


def _vapours(name: str, area_km_mol: float | None) -> list[VapourBand]:
    """Vapour of the scene; beside shipped data, also that of RadCal."""
    if Path(name).suffix:
        return [read_xsc(Path(name))]
    used = [vapour_band(name, area_km_mol=area_km_mol)] if name in vapours() else []
    beside = f"{name}-radcal"
    return [*used, *([vapour_band(beside)] if beside in vapours() else [])]


def _growth(
    band: VapourBand, filter_um: tuple[float, float], gas_K: float, pressure_Pa: float
) -> Growth:
    spectrum = band.k_distribution(
        filter_um, temperature_K=gas_K, pressure_Pa=pressure_Pa, points=64, mole_fraction=0.2
    )
    mean = float(spectrum.weights @ spectrum.absorption_m2_mol)
    column = np.geomspace(1e-2, 1e2, 200) / mean
    return Growth(
        band.species, column, 1 - spectrum.transmission(column), -np.expm1(-mean * column)
    )


def _growth_row(curve: Growth, gas_K: float, pressure_Pa: float) -> Row:
    """Row for 1 cm of gas with as much methane as a jet some diameters from its nozzle."""
    column = 0.2 * pressure_Pa / (GAS_CONSTANT_J_mol_K * gas_K) * 0.01
    real, beer = (
        float(np.interp(column, curve.column_mol_m2, values))
        for values in (curve.emissivity, curve.beer)
    )
    note = f"{beer:.3f} by Beer-Lambert on the mean; {pressure_Pa / 1e6:g} MPa"
    return Row("emissivity of 1 cm, 20 % in the gas", "", f"{real:.3f}", "about 0.3 at most", note)


def _covers(band: VapourBand, low_um: float, high_um: float) -> bool:
    low, high = band.wavenumber_per_cm
    return low <= 1e4 / high_um and 1e4 / low_um <= high


def _size_rows(sizes: Sizes) -> list[Row]:
    rows = []
    for name, orders, paper in (("D32", (3, 2), "9.00"), ("D10", (1, 0), "4.11 to 9.00")):
        try:
            diameter = f"{mean_diameter_m(sizes, *orders) * 1e6:.2f}"
        except SprayError:
            diameter = "does not exist"
        rows.append(Row(f"{name} at the nozzle, µm", diameter, "", paper))
    return rows


def _solve(
    strata: Floats, *, wavelength_um: float, n: float, k: float, cache: Path | None
) -> Droplets:
    largest = max(100e-6, float(strata[-1]))
    table = droplet_table(wavelength_um=wavelength_um, n=n, k=k, cache=cache, largest_m=largest)
    phases = phase_table(wavelength_um=wavelength_um, n=n, k=k, cache=cache, largest_m=largest)
    return Droplets(table, phases.mean(strata, strata**-3.0))


def _droplet_rows(used: Droplets, measured: Droplets | None, strata: Floats) -> list[Row]:
    names = (
        "droplets: scattering / extinction",
        "droplets: g",
        "droplets: extinction, m²/cm³ of liquid",
    )
    scene_values = _values(used, strata)
    theirs = _values(measured, strata) if measured is not None else ["", "", ""]
    paper = ("", "0 (isotropic)", "")
    rows = [Row(*row) for row in zip(names, scene_values, theirs, paper, strict=True)]
    error = table_error(used.table)
    note = "Q_sca {:.1g}, Q_abs {:.1g}, g {:.1g}".format(*error)
    rows.append(Row("largest error of the table", f"{100 * max(error):.2g} %", note=note))
    return rows


def _values(droplets: Droplets, strata: Floats) -> list[str]:
    """Albedo, g and extinction by volume of liquid."""
    absorbed, scattered = droplets.table.cross_sections(strata)
    volume = np.pi / 6 * strata**3
    extinct = float(np.mean((absorbed + scattered) / volume))
    albedo = float(np.mean(scattered / volume)) / extinct
    return [f"{albedo:.3f}", f"{droplets.phase.asymmetry:.3f}", f"{extinct * 1e-6:.3f}"]
