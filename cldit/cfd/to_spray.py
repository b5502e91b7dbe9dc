"""Conversion of a CFD case to a spray: plausibility of fields, rotation into cldit's frame."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cldit.arrays import Floats
from cldit.cfd import one_state
from cldit.cfd.case import NO_CLOUD, CfdCase, choose_time, time_remarks, triple
from cldit.cfd.formats import find_format, read_case
from cldit.cfd.mesh.cells import AnyFloats, Labels, slices
from cldit.cfd.names import SAME_MOLAR_MASS, fuel_of, other_fuels, with_molar_mass
from cldit.cfd.orientation import InjectorFrame, check_downstream, find_frame
from cldit.cfd.plausible import (
    SECOND,
    assumptions,
    check_one_liquid,
    check_parcels,
    check_totals,
    farthest_m,
    freezing_K,
    gas_remarks,
    is_fuel,
    only,
)
from cldit.cfd.sectors import Pose, completed_parcels, copies
from cldit.cfd.tolerances import SLACK
from cldit.constants import AVOGADRO_PER_MOL, GAS_CONSTANT_J_mol_K
from cldit.errors import NoFuel, NotAtThisTime, SprayError
from cldit.io.origin import files_read
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray
from cldit.spray.penetration import liquid_figures
from cldit.spray.result import Cells, Parcels, Spray, Vapour
from cldit.spray.spray_file import read_spray

AIR_KG_MOL = 0.02885  # dry air, for a case without rho, which does not state its gas

_NEGLIGIBLE = 1e-12  # share of the vapour in all omitted cells together
_LARGEST_M = 10.0  # the coordinates of a larger case are in mm
_IDEAL = 4.0  # factor by which rho may differ from that of an ideal gas; other units differ by more
_PRESSURE_Pa = (1e4, 5e7)  # of engines and chambers; a gauge pressure is often below
_EDGE_OF_JET = 1e-3  # vapour mass fraction at which a jet's penetration is measured (ECN)


@dataclass(frozen=True)
class _Gas:
    """Temperature, mass fraction of the fuel, and its molecules per m3, of each cell."""

    temperature_K: AnyFloats
    mass_fraction: Floats
    number_density_m3: Floats
    remarks: tuple[str, ...] = ()


def read_cfd(spec: CfdSpray, *, watch: Watch = silent) -> Spray:
    """Reads a spray from the result of a CFD code, or from cldit's own file of one.

    Gas: T, rho (or p, for an ideal gas of air and fuel), and the fuel's mass fraction, the field
    `spec.fuel_field`. Parcels: d (the diameter), nParticle (a real number), T, rho. The nozzle
    becomes the origin and the axis of injection -z. Nozzle and axis are inferred where the scene
    does not give them; `remarks` state their source. Cells without vapour are omitted.

    Args:
        spec: the case.
        watch: receives the progress.

    Returns:
        Spray with `vapour` (None without any), `parcels` (None for a case without a cloud), and
        figures in `notes`.

    Raises:
        SprayError: files or fields are missing, damaged, or hold impossible values; the message
            names the file and the field.
    """
    return _stored(spec) if find_format(spec) == "cldit" else _imported(spec, watch)


def _stored(spec: CfdSpray) -> Spray:
    fixed = ("nozzle_m", "axis", "cloud", "mapping", "region", "sector", "symmetry", "accept")
    for key in fixed:
        if getattr(spec, key) is not None and (key != "accept" or spec.accept):
            raise SprayError(f"{spec.file}: spray.{key} was fixed when the case was imported")
    spray = read_spray(spec.file)
    fuel, vapour = spray.fuel or fuel_of(spec), spray.vapour
    if spec.fuel_field != CfdSpray.model_fields["fuel_field"].default and fuel != fuel_of(spec):
        requested = fuel_of(spec)
        raise SprayError(f"{spec.file}: spray.fuel_field: {requested}; the file contains {fuel}")
    if not spray.fuel and vapour is not None:  # a file of an older version
        mass = with_molar_mass(spec).fuel_molar_mass_kg_mol
        if abs(vapour.molar_mass_kg_mol / mass - 1.0) > SAME_MOLAR_MASS:
            fuel = f"one of {vapour.molar_mass_kg_mol:g} kg/mol (spray.fuel_field names it)"
    if spec.time_s is not None:
        stated = [spray.notes["time_s"]] if "time_s" in spray.notes else []
        choose_time(str(spec.file), stated, spec.time_s)
    return replace(spray, files=files_read([spec.file]) + spray.files, fuel=fuel)


def _imported(spec: CfdSpray, watch: Watch) -> Spray:
    spec, begun = with_molar_mass(spec), time.time()
    case = read_case(spec, watch)
    for file in case.files:
        if begun < file.stat().st_mtime <= time.time():
            raise SprayError(f"{file}: changed while it was read; import it when it is complete")
    accepted = one_state.judged(case.accept, {"times": lambda: one_state.check_times(case.times_s)})
    _check_size(case)
    gas = _gas(spec, case)
    parcels, kept, omitted = None, np.ones(0, dtype=bool), tuple[str, ...]()
    if case.cloud is not None:
        share, coldest_K, extent_m = spec.parcels_left_out, freezing_K(spec), case.mesh.extent_m
        parcels, kept, omitted = check_parcels(
            case.cloud, *extent_m, share=share, coldest_K=coldest_K
        )
        cloud = only(case.cloud, kept)
        accepted += one_state.check_parcels(cloud, case.accept)
        case = replace(case, cloud=cloud)
    frame = find_frame(spec, case)
    poses, completed = copies(spec, case, frame)
    vapour, jet_m, cell_remarks = _vapour(spec, case, gas, poses, watch)
    accepted += cell_remarks
    if parcels is not None:
        parcels = completed_parcels(parcels, poses)
        check_downstream(spec, parcels, frame)
    notes = _notes(case, gas, parcels, vapour, frame)
    farthest = None if case.cloud is None else farthest_m(case.cloud, 0.95)
    if farthest is not None:
        notes["liquid_path_m"] = farthest
    if not kept.all():
        notes["parcels_left_out"] = float(np.sum(~kept))
    if len(poses) > 1:
        notes["copies"] = float(len(poses))
    if np.isfinite(jet_m):
        notes["vapour_penetration_m"] = jet_m
    check_totals(case, notes)
    present = vapour if len(vapour.temperature_K) else None
    if present is None and not notes.get("liquid_mass_kg"):
        raise NoFuel(f"{case.source}: no fuel: no liquid, and no {spec.fuel_field} as vapour")
    foreign = other_fuels(case.available, spec.fuel_field)
    if case.cloud is not None:
        liquids = partial(check_one_liquid, case.cloud, spec.fuel_field)
        accepted += one_state.judged(case.accept, {"liquids": liquids})
    _check_one_fuel(spec, case, gas, foreign)
    gas_alone = parcels is None and spec.cloud != NO_CLOUD
    remarks = (
        *case.remarks,
        *accepted,
        *assumptions(spec, case),
        *gas.remarks,
        *((f"{case.source}: no parcels in it: gas alone.",) if gas_alone else ()),
        *((f"Other fuels, not read: {', '.join(foreign)}.",) if foreign else ()),
        *omitted,
        *time_remarks(case.time_s, spec.time_s),
        *frame.remarks,
        *completed,
    )
    files = files_read(case.files)
    return Spray(parcels, present, notes=notes, remarks=remarks, files=files, fuel=fuel_of(spec))


def _check_one_fuel(spec: CfdSpray, case: CfdCase, gas: _Gas, foreign: Sequence[str]) -> None:
    """Refuses a case in which another fuel has more than a small share."""
    gas_only = spec.model_copy(update={"cloud": NO_CLOUD})
    for name in filter(is_fuel, foreign):
        column = read_case(gas_only, fuel_column=name).gas[spec.fuel_field]
        if column.label == case.gas[spec.fuel_field].label:
            continue  # a mapping file gives it
        highest = float(np.nanmax(column.values))
        if highest > SECOND * float(gas.mass_fraction.max()):
            raise SprayError(
                f"{spec.file}: two fuels: {spec.fuel_field}, up to {gas.mass_fraction.max():.3g}, "
                f"and {name}, up to {highest:.3g}; allowed: one fuel, as mass, liquid, vapour and "
                "optics depend on it (add the fields of a mixture under one name in the case)"
            )


def _check_size(case: CfdCase) -> None:
    lower, upper = case.mesh.extent_m
    extent = float((upper - lower).max())
    if extent > _LARGEST_M:
        limit = f"up to {_LARGEST_M:g} m (coordinates must be in metres)"
        raise SprayError(f"{case.mesh.source}: the mesh is {extent:g} m wide; allowed: {limit}")


def _within(case: CfdCase, name: str, *, low: float, high: float, hint: str) -> AnyFloats:
    """Returns the values of a cell field as stored, once all are numbers within low..high."""
    column = case.gas[name]
    if (outside := column.outside(low, high)) is not None:
        bad = int(np.argmax(outside))
        place = triple(case.mesh.measure(np.array([bad])).centroid_m[0])
        count = f"{int(outside.sum())} of {outside.size} values; this cell is at {place} m"
        value = f"{column.values[bad]:g} (entry {bad}) is outside {low:g}..{high:g} ({count})"
        raise SprayError(f"{column.label}: {value}; {hint}")
    return column.values


def _gas(spec: CfdSpray, case: CfdCase) -> _Gas:
    for name, key in ((spec.fuel_field, " (spray.fuel_field)"), ("T", "")):
        if name not in case.gas:
            available = ", ".join(case.available) or "none"
            kind = NotAtThisTime if name == spec.fuel_field else SprayError
            raise kind(f"{case.source}: no cell field {name!r}{key}; it has: {available}")
    temperature = _within(case, "T", low=1.0, high=5000.0, hint="T is a temperature in K")
    hint = "it must be the mass fraction of the fuel's vapour (spray.fuel_field)"
    stored = _within(case, spec.fuel_field, low=-SLACK, high=1.0 + SLACK, hint=hint)
    fraction = stored.astype(np.float64)
    fraction.clip(0.0, 1.0, out=fraction)
    coldest_K = freezing_K(spec)
    if (cold := (temperature < coldest_K) & (fraction > _EDGE_OF_JET)).any():
        cell = int(np.argmax(cold))
        raise SprayError(
            f"{case.gas['T'].label}: {temperature[cell]:g} (entry {cell}) is below the freezing "
            f"point of the vapour in this cell, {coldest_K:g} K; T is a temperature in K (degC? a "
            "mapping file gives the unit)"
        )
    pressure = None
    remarks: tuple[str, ...] = ()
    if case.gas[spec.fuel_field].unit == "mol/mol":
        mass = fraction * spec.fuel_molar_mass_kg_mol
        fraction = mass / (mass + (1.0 - fraction) * AIR_KG_MOL)
        label = case.gas[spec.fuel_field].label
        remarks = (f"{label}: mole fractions of fuel in air, converted to mass fractions.",)
    if "p" in case.gas:
        without_density, stated = "rho" not in case.gas, case.gas["p"].unit == "Pa absolute"
        low, high = _PRESSURE_Pa if without_density and not stated else (1.0, 1e9)
        way = "absolute, as there is no density (gauge? else a mapping: unit: Pa absolute)"
        hint = f"p is a pressure in Pa{', ' + way if without_density else ''}"
        pressure = _within(case, "p", low=low, high=high, hint=hint)
        moles_kg = fraction / spec.fuel_molar_mass_kg_mol + (1.0 - fraction) / AIR_KG_MOL
        ideal = pressure / (moles_kg * GAS_CONSTANT_J_mol_K * temperature)
    if "rho" in case.gas:
        density = _within(case, "rho", low=0.0, high=2e3, hint="rho is a density in kg/m3")
        if pressure is not None:
            ratio = float(np.median(density / ideal))
            if not 1.0 / _IDEAL < ratio < _IDEAL:
                raise SprayError(
                    f"{case.gas['rho'].label}: {ratio:.3g} times the density of an ideal gas at T "
                    f"and p ({case.gas['p'].label}); one of them is not in kg/m3, K, Pa"
                )
            remarks += gas_remarks(case, density, ideal, temperature, pressure)
    elif pressure is not None:
        density = ideal
    else:
        raise SprayError(f"{case.source}: neither rho nor p among the cell fields; one is needed")
    number = density * fraction * (AVOGADRO_PER_MOL / spec.fuel_molar_mass_kg_mol)
    return _Gas(temperature, fraction, number, remarks)


def _vapour(
    spec: CfdSpray, case: CfdCase, gas: _Gas, poses: Sequence[Pose], watch: Watch
) -> tuple[Vapour, float, tuple[str, ...]]:
    """Vapour in cldit's frame, its penetration along the axis [m] (NaN if none), and remarks.

    A box has the volume and centroid of its cell and the proportions of the cell's bounding box in
    the case. Cells with a negligible share are omitted, some thousands at a time; the cells of all
    copies refer to the same gas.
    """
    total, depth, filled, count = 0.0, -np.inf, 0.0, 0
    share = _NEGLIGIBLE / case.mesh.cells
    # room for all cells takes no memory where it is not written
    cell, volume = np.empty(case.mesh.cells, np.int64), np.empty(case.mesh.cells)
    lower, upper = np.empty((2, case.mesh.cells, 3))  # centroids and edges at first
    for chosen in slices(case.mesh.cells):
        watch("measuring cells", chosen.start, case.mesh.cells)
        cells = case.mesh.measure(np.arange(chosen.start, chosen.stop))
        molecules = gas.number_density_m3[chosen] * cells.volume_m3
        filled += float(cells.volume_m3.sum())
        total += float(molecules.sum())
        # a lower bound of the final threshold: the total is not known yet
        kept = np.flatnonzero(molecules > share * total)
        place = slice(count, count + len(kept))
        cell[place], volume[place] = chosen.start + kept, cells.volume_m3[kept]
        lower[place], upper[place] = cells.centroid_m[kept], (cells.upper_m - cells.lower_m)[kept]
        count += len(kept)
        jet = cells.centroid_m[gas.mass_fraction[chosen] > _EDGE_OF_JET]
        for origin, rotation in poses:
            depth = max(depth, float(((origin - jet) @ rotation[2]).max(initial=-np.inf)))
    enough = gas.number_density_m3[cell[:count]] * volume[:count] > share * total
    selected: slice | Labels = slice(count) if enough.all() else np.flatnonzero(enough)
    cell, volume, lower, upper = cell[selected], volume[selected], lower[selected], upper[selected]

    def check_cells() -> None:
        one_state.check_cells_once(case, cell, lower, volume)
        one_state.check_volume(case.mesh, filled)

    accepted = one_state.judged(case.accept, {"cells": check_cells})
    if len(poses) > 1:
        lower, upper = (np.tile(values, (len(poses), 1)) for values in (lower, upper))
    for copy, (origin, rotation) in enumerate(poses):
        for part in slices(len(cell)):
            place = slice(copy * len(cell) + part.start, copy * len(cell) + part.stop)
            centre, half = (lower[place] - origin) @ rotation.T, upper[place] @ np.abs(rotation).T
            half *= (np.cbrt(volume[part] / half.prod(axis=1)) / 2)[:, None]
            lower[place], upper[place] = centre - half, centre + half
    number = np.tile(cell, len(poses))
    temperature = gas.temperature_K[number].astype(np.float64)
    boxes, molar_mass = Cells(lower, upper), spec.fuel_molar_mass_kg_mol
    vapour = Vapour(boxes, gas.number_density_m3[number], temperature, molar_mass)
    return vapour, depth if np.isfinite(depth) else np.nan, accepted


def _notes(
    case: CfdCase, gas: _Gas, parcels: Parcels | None, vapour: Vapour, frame: InjectorFrame
) -> dict[str, float]:
    """Figures that show whether the case was read as meant; the ambient temperature is that outside
    the jet, or the hottest if it fills all cells."""
    hottest_K = float(gas.temperature_K.max())
    outside = gas.temperature_K[gas.mass_fraction <= _EDGE_OF_JET]
    notes = {} if case.time_s is None else {"time_s": case.time_s}
    if case.wall_K is not None:
        notes["wall_temperature_K"] = case.wall_K
    if parcels is not None:
        notes |= {
            "parcels": float(len(parcels.diameter_m)),
            "droplets": float(parcels.droplets.sum()),
            **liquid_figures(parcels),
        }
    notes |= {
        "gas_cells": float(case.mesh.cells),
        "vapour_cells": float(len(vapour.temperature_K)),
        "vapour_mass_kg": vapour.mass_kg,
        "vapour_mass_fraction_max": float(gas.mass_fraction.max()),
        "gas_temperature_min_K": float(gas.temperature_K.min()),
        "gas_temperature_max_K": hottest_K,
        "ambient_temperature_K": float(np.median(outside) if len(outside) else hottest_K),
    }
    for name, place, along in zip("xyz", frame.nozzle_m, frame.axis, strict=True):
        notes |= {f"nozzle_{name}_m": float(place), f"axis_{name}": float(along)}
    return notes
