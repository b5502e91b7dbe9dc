"""Limits on the values of parcels, on totals, and between fields.

Assumptions where a case does not state a figure are reported and kept in the run.
"""

from collections.abc import Mapping

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.cfd.case import CfdCase, Cloud, Column, triple
from cldit.cfd.mesh.cells import AnyFloats
from cldit.cfd.names import (
    SAME_MOLAR_MASS,
    formula,
    fuel_of,
    is_liquid,
    molar_mass_kg_mol,
    similar,
    species_in,
)
from cldit.cfd.tolerances import SLACK, WRITTEN
from cldit.constants import ZERO_CELSIUS_K, STANDARD_ATMOSPHERE_Pa
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Parcels

# A falling drop of water breaks up beyond some 5 mm; liquids have from 162 kg/m3, methane's density
# at its critical point (NIST), to some 1,500. What lies beyond has another unit.
_LIMITS = {
    "d": (1e-9, 5e-3, "d is the diameter of a droplet in metres"),
    "nParticle": (0.0, 1e18, "nParticle is the number of droplets"),
    "T": (1.0, 5000.0, "T is a temperature in K, above the freezing point (degC?)"),
    "rho": (100.0, 3e3, "rho is a density in kg/m3"),
}


def check_parcels(
    cloud: Cloud, lower_m: Floats, upper_m: Floats, *, share: float, coldest_K: float
) -> tuple[Parcels, Mask, tuple[str, ...]]:
    """Omits parcels with impossible values or outside the mesh's bounding box, lower_m to upper_m.

    Returns parcels in the case's coordinates, a mask of those that are kept, (N,), and remarks.
    Liquid below coldest_K, the freezing point, is impossible. More than `share` of their number,
    or of the mass, is an error. Up to half may be dummies, of diameter or number zero.
    """
    count = len(cloud.position_m.values)
    wrong: list[tuple[Mask, str]] = []
    for name, (minimum, maximum, hint) in _LIMITS.items():
        if name == "T":
            minimum = coldest_K
        column = cloud.fields[name]
        if (outside := column.outside(minimum, maximum)) is not None:
            bad = int(np.argmax(outside))
            value = f"{column.values[bad]:g} (entry {bad}) is outside {minimum:g}..{maximum:g}"
            wrong.append((outside, f"{column.label}: {value}; {hint}"))
    position = cloud.position_m
    slack = WRITTEN * float((upper_m - lower_m).max())  # float32 in either file
    low, high = position.values >= lower_m - slack, position.values <= upper_m + slack
    beyond = ~np.all(low & high, axis=1)
    if beyond.any():
        bad = int(np.argmax(beyond))
        box = f"{triple(lower_m)} to {triple(upper_m)} m"
        place = f"parcel {bad} at {triple(position.values[bad])} m"
        wrong.append((beyond, f"{position.label}: {place} is outside the mesh, {box}"))
    kept = np.ones(count, dtype=bool)
    for mask, _ in wrong:
        kept &= ~mask
    dummy = (cloud.fields["d"].values == 0.0) | (cloud.fields["nParticle"].values == 0.0)
    lost = int(np.sum(~kept & ~dummy if 2 * dummy.sum() <= count else ~kept))
    if lost > share * count or _mass_share(cloud, beyond, wrong) > share:
        problem = f"{lost} of {count} parcels are impossible or outside"
        limit = f"up to {100 * share:g} % may be omitted: spray.parcels_left_out"
        raise SprayError(f"{wrong[0][1]} ({problem}; {limit})")
    remarks = tuple(f"Omitted {int(mask.sum())} of {count} parcels: {why}." for mask, why in wrong)
    columns = (position, *(cloud.fields[name] for name in _LIMITS))
    where, *quantities = (np.asarray(stored.values[kept], np.float64) for stored in columns)
    size, droplets, temperature, density = quantities
    vector = cloud.fields.get("U")
    velocity = None  # unless all parcels have one
    if vector is not None and np.isfinite(vector.values[kept]).all():
        velocity = np.asarray(vector.values[kept], np.float64)
    parcels = Parcels(where, size, droplets, temperature, density, velocity_m_s=velocity)
    return parcels, kept, remarks


def _mass_share(cloud: Cloud, beyond: Mask, wrong: list[tuple[Mask, str]]) -> float:
    """Share of the liquid in parcels with possible values, but outside the mesh."""
    possible = np.ones(len(beyond), dtype=bool)
    for mask, _ in wrong:
        possible &= ~mask | (mask is beyond)
    if not (beyond & possible).any():
        return 0.0
    mass = np.where(possible, cloud.masses, 0.0)
    return float(mass[beyond].sum() / mass.sum()) if mass.sum() > 0 else 0.0


def farthest_m(cloud: Cloud, share: float) -> float | None:
    """Distance from their origin within which `share` of the liquid lies; None without origins.

    Interpolated as KinematicCloud::penetration does; OpenFOAM's log states it for 0.95.
    """
    if "origin" not in cloud.fields:
        return None
    distance = np.linalg.norm(cloud.position_m.values - cloud.fields["origin"].values, axis=1)
    order = np.argsort(distance, kind="stable")
    distance, mass = distance[order], cloud.masses[order]
    beyond = np.cumsum(mass[::-1])[::-1]  # with the parcel itself
    rest = (1.0 - share) * beyond[0]
    at = int(np.flatnonzero(beyond > rest)[-1]) if beyond[0] > 0 else len(distance) - 1
    if at == len(distance) - 1:
        return float(distance[-1])
    step = (beyond[at] - rest) / mass[at]
    return float(distance[at] + step * (distance[at + 1] - distance[at]))


def only(cloud: Cloud, kept: Mask) -> Cloud:
    """Restricts `cloud` to the parcels that are `kept` (N,)."""
    if kept.all():
        return cloud
    fields, extra = (
        {name: Column(column.label, column.values[kept]) for name, column in columns.items()}
        for columns in (cloud.fields, cloud.extra)
    )
    place = Column(cloud.position_m.label, cloud.position_m.values[kept])
    return Cloud(cloud.name, place, fields, extra)


_MOST_KG = {"liquid": 0.01, "vapour": 0.1}  # an injection has milligrams, a large engine's grams
_LONGEST_m = 1.0  # of a penetration: chambers and engines are shorter
_FITS = 0.05  # relative deviation of a density from an ideal gas
_OFF = 0.15  # beyond it, another unit of temperature or pressure is tried
_FREEZING_K = {
    "CH4": 90.7, "C2H5OH": 159.0, "CH3OH": 175.6, "IC8H18": 165.8, "C7H16": 182.6,
    "NC7H16": 182.6, "C8H18": 165.8, "NC8H18": 216.4, "C10H22": 243.5, "C12H26": 263.5,
    "NC12H26": 263.5, "C16H34": 291.3, "C14H30": 279.0,
}  # fmt: skip


def freezing_K(spec: CfdSpray) -> float:
    """Freezing point of the fuel; of one that is not in the table, the lowest of the table."""
    name = "C7H16" if fuel_of(spec) == "n-heptane" else formula(spec.fuel_field)
    return _FREEZING_K.get(name, min(_FREEZING_K.values()))


def is_fuel(field: str) -> bool:
    """True for a field of a substance that is injected as a fuel, and no product of reactions."""
    return formula(field) in _FREEZING_K


_GASES = {"N2", "O2", "CO2", "CO"}
SECOND = 0.01  # share of the liquid, or of the fuel's largest mass fraction: a second fuel


def check_one_liquid(cloud: Cloud, fuel_field: str) -> None:
    """Refuses parcels of several liquids, or of another one than the fuel."""
    parts: dict[str, Column] = {}
    liquid = False
    for name, column in cloud.extra.items():
        species, values = species_in(name), np.asarray(column.values, np.float64)
        if species is not None and values.min() >= -SLACK and SECOND < values.max() <= 1.0 + SLACK:
            parts[species] = column
            liquid = liquid or is_liquid(name)
    total = np.sum([part.values for part in parts.values()], axis=0)
    if _GASES & set(parts) or not (liquid or np.all(np.abs(total - 1.0) < SECOND)):
        return  # of the gas around the parcels, or something else
    fuel = formula(fuel_field)
    foreign = {name: part for name, part in parts.items() if fuel not in name and name not in fuel}
    formulas = molar_mass_kg_mol(fuel) is not None and all(map(molar_mass_kg_mol, foreign))
    if foreign and (len(parts) > 1 or formulas):
        label = next(iter(foreign.values())).label
        shown = ", ".join(f"{name} (up to {part.values.max():.3g})" for name, part in parts.items())
        raise SprayError(
            f"{label}: parcels of {shown}; allowed: parcels of {fuel_field} alone "
            "(spray.fuel_field), as evaporation and optics of mixtures are not known"
        )


def check_totals(case: CfdCase, notes: Mapping[str, float]) -> None:
    """Refuses masses, numbers and lengths that no fuel spray has; `notes` as of the spray."""
    hint = "one of the fields is in another unit, such as cm; a mapping file gives the unit"
    for phase, limit_kg in _MOST_KG.items():
        if (mass := notes.get(f"{phase}_mass_kg", 0.0)) > limit_kg:
            raise SprayError(
                f"{case.source}: {mass:.3g} kg of {phase}; allowed: up to {limit_kg:g} kg ({hint})"
            )
    if notes.get("droplets", np.inf) < notes.get("parcels", 0.0):
        label = "nParticle" if case.cloud is None else case.cloud.fields["nParticle"].label
        raise SprayError(
            f"{label}: {notes['droplets']:.3g} droplets in {notes['parcels']:.0f} parcels; "
            "allowed: one in each parcel or more (if it is the parcel's mass, a mapping file "
            "names it as `mass`)"
        )
    low, high = case.mesh.extent_m
    longest = min(_LONGEST_m, float(np.linalg.norm(high - low)))
    for name in ("liquid_penetration_99_m", "vapour_penetration_m"):
        if (length := notes.get(name, 0.0)) > longest:
            quantity = name.removesuffix("_m").replace("_", " ")
            raise SprayError(
                f"{case.source}: {quantity} is {length:.3g} m; allowed: up to {longest:.3g} m, 1 m "
                f"and the mesh's diagonal ({hint}; or the nozzle is wrong, spray.nozzle_m)"
            )


def gas_remarks(
    case: CfdCase, density: AnyFloats, ideal: Floats, temperature_K: AnyFloats, pressure: AnyFloats
) -> tuple[str, ...]:
    """Compares the density with an ideal gas; refuses temperatures in degrees Celsius.

    `density` and `ideal` (N,), that of an ideal gas at temperature_K and pressure (N,).
    """
    positive = density > 0
    if not positive.any():
        return ()
    kelvin = np.log(density[positive] / ideal[positive])
    shifted = kelvin + np.log1p(ZERO_CELSIUS_K / temperature_K[positive])
    off, fit = (float(np.expm1(np.median(logs))) for logs in (kelvin, shifted))
    if abs(off) < _OFF:
        return ()
    scatter = float(np.median(np.abs(shifted)))  # cell by cell, not on the mean alone
    if scatter < _FITS and np.std(shifted) <= np.std(kelvin) + 1e-6:
        raise SprayError(
            f"{case.gas['T'].label}: {temperature_K.min():.4g} to {temperature_K.max():.4g} seem "
            f"to be degrees Celsius: the density is {1 + off:.3g} times that of an ideal gas at T, "
            f"and {1 + fit:.3g} times at T + 273.15; a mapping file gives the unit: "
            "temperature: {column: T, unit: degC}"
        )
    span = f"{pressure.min():.4g} to {pressure.max():.4g} Pa"
    gauge = float(np.median(np.abs(kelvin - np.log1p(STANDARD_ATMOSPHERE_Pa / pressure[positive]))))
    hint = ": p seems to be a gauge pressure" if gauge < _FITS else ""
    return (
        f"The density is {1 + off:.3g} times that of an ideal gas of air and fuel at T and p "
        f"({span}){hint}.",
    )


def assumptions(spec: CfdSpray, case: CfdCase) -> tuple[str, ...]:
    """Lists the assumptions that replace figures which the case lacks, a sentence each."""
    remarks = []
    if "rho" not in case.gas and "p" in case.gas:
        close = ", ".join(map(repr, similar("rho", set(case.available) - set(case.gas))))
        hint = f" (if it is {close}, name it in a mapping file)" if close else ""
        p = case.gas["p"].values
        span = f"{p.min():.4g} to {p.max():.4g} Pa"
        used = f"that of an ideal gas of air and fuel at T and p ({span}) was used"
        remarks.append(f"{case.source}: no density 'rho' among the cell fields{hint}: {used}.")
    if "rho" in case.gas and "p" not in case.gas:
        effect = "the density was not compared with that of an ideal gas"
        remarks.append(f"{case.source}: no pressure among the cell fields: {effect}.")
    if case.time_s is None:
        caveat = "" if case.cloud is None else "; gas and parcels were not compared by theirs"
        remarks.append(f"{case.source}: does not state its time{caveat}.")
    fuel, stated = fuel_of(spec), molar_mass_kg_mol(spec.fuel_field)
    if stated is not None and abs(stated / spec.fuel_molar_mass_kg_mol - 1.0) > SAME_MOLAR_MASS:
        used = f"Molar mass of {spec.fuel_field}: {spec.fuel_molar_mass_kg_mol:g} kg/mol, as given"
        remarks.append(f"{used}; by its formula it is {stated:.6g} (spray.fuel_molar_mass_kg_mol).")
    if stated is None:
        reason = f"the name of the field {spec.fuel_field} is no formula (spray.fuel_field)"
        remarks.append(f"Fuel {fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol: {reason}.")
    elif fuel != "n-heptane":
        remarks.append(f"Fuel {fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol.")
    return tuple(remarks)
