"""The `cone` spray: one quasi-steady jet a plume, superposed on a grid, its droplets evaporating.

0. Methane comes out under-expanded (`underexpanded_jet.py`): up to the Mach disc it is as cold and
   fast as in the notional nozzle and takes up no gas; there the jet begins.
1. Each plume is a jet (`jet.py`). Fuel that left the hole at one moment travels with the
   jet's mean speed, so that the fuel in a length ds is rate / speed ds, and what has been injected
   is spread between the place of the first and of the last fuel: after the end of injection the
   plume leaves the nozzle. Tip and tail are soft (a tenth of the time of travel), the tip rounded.
2. Across the plume the fuel-to-gas ratio falls from the axis as `profile`. The plume is as wide as
   this fuel, mixed in that ratio and cooled by its evaporation, needs: somewhat less than the
   given cone where the gas is hot, the cone itself where nothing evaporates.
3. Evaporated is the smaller of two shares: of equilibrium, which the heat and the room for vapour
   of the gas mixed in allow, and of kinetics, which the d^2 law of every size class allows in the
   time of travel, with the rate of droplets at rest in the undisturbed gas (`wet_bulb.py`).
   Slip makes them evaporate faster, cooler gas with vapour slower; neither is in the rate. In a
   march along a hot plume (0.6 MPa, 570 K) with both they make up for each other on and near the
   axis from 20 mm on (within 0.1 of the fuel); at the edge, and within 15 mm of the nozzle, slip
   wins, and the model evaporates up to 0.2 of the fuel too little.
4. The fuel of all plumes adds up in the cells of a grid. Fuel content and evaporated share decide
   the state (`mixing.py`): the gas has the temperature that keeps enthalpy, the liquid
   that of the wet bulb in this gas; in equilibrium both are the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError
from cldit.scene.spray import ConeSpray, Plume
from cldit.spray.cone.fluid_properties import (
    METHANE,
    NITROGEN,
    GAS_CONSTANT_J_mol_K,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
)
from cldit.spray.cone.jet import MEAN_SQUARE, Jet, profile
from cldit.spray.cone.mixing import State
from cldit.spray.cone.nozzle import Source, source_of
from cldit.spray.extent import Box
from cldit.spray.result import Cells, Parcels, Spray, Vapour

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SOFTNESS = 0.1  # half the width of tip and tail, of the time of travel
ROUNDING = 0.4  # by how much of the time the plume's edge lags its axis
NEGLIGIBLE = 1e-7  # of the fuel's mass: the thinnest cells go, and the others take it over
THIN = 2e-4  # of the liquid: the thinnest cells count as evaporated
SMALLEST_m = 1e-7  # droplets below count as evaporated
RESOLVED = 1.5  # the plume is at least this many cells wide (radius)
MOST_CELLS = 2e8  # looked at, in the boxes around all plumes
_AT_ONCE = 1e5  # of these, whose steps stay in the cache
_AVOGADRO = 6.02214076e23


def make_cone(spec: ConeSpray) -> Spray:
    """Parcels and vapour of the spray at `spec.time_s`; fuel mass is kept to rounding.

    `notes`: injected_mass_kg, liquid_mass_kg, vapour_mass_kg, jet_speed_m_s, flow_coefficient (of
    what the holes pass at that speed),
    vapour_penetration_m (farthest cell with a vapour mass fraction of 1e-3), coldest_K, cells, and
    with droplets parcels, sauter_mean_diameter_m, liquid_penetration_m (depth below the nozzle
    that 97 % of the liquid does not reach), and where it can evaporate wet_bulb_K and
    evaporation_rate_m2_s (K of the d^2 law) in the undisturbed gas, saturation_K and
    saturation_fuel_ratio (where equilibrium leaves no liquid). For methane mach_disc_m (distance
    from the hole, of the largest plume), throat_K, throat_Pa, notional_K, and notional_area_ratio
    (of the notional nozzle to the throat).

    Raises:
        SprayError: the combination of values is impossible: pressure, flow, sizes, grid.
    """
    source = source_of(spec)
    rate = spec.injected_mass_kg / spec.injection_duration_s
    holes = len(spec.plumes) * np.pi / 4 * spec.hole_diameter_m**2
    flow = rate / (holes * source.flux_kg_m2_s)
    if flow > 1:
        raise SprayError(
            f"spray.injected_mass_kg: {spec.injected_mass_kg:g} in {spec.injection_duration_s:g} s "
            f"is {flow:.3g} times what the pressure drives through {len(spec.plumes)} holes of "
            f"{spec.hole_diameter_m:g} m; at most {spec.injected_mass_kg / flow:.3g}"
        )
    injected = spec.injected_mass_kg * min(spec.time_s / spec.injection_duration_s, 1.0)
    notes = {"injected_mass_kg": injected, "flow_coefficient": flow}
    remarks = _without_effect(spec)
    if injected == 0:
        return Spray(notes=notes, remarks=remarks)
    index, mass, content, kinetic = _grid(spec, source, injected=injected)
    state = source.mixture.at(content, kinetic)
    parcels, liquid = _parcels(spec, source, index, mass, state)
    gone = mass - liquid
    share = state.evaporated * state.fuel_to_gas / (1 + state.fuel_to_gas)
    seen = (index[share >= 1e-3] + 0.5) * spec.lattice_m
    notes |= source.notes
    if source.disc > 0:
        largest = max(plume.mass_fraction for plume in spec.plumes)
        every = sum(plume.mass_fraction for plume in spec.plumes)
        notes["mach_disc_m"] = source.barrel_m(largest / every * rate)
    notes |= {
        "jet_speed_m_s": source.speed_m_s,
        "cells": float(len(index)),
        "coldest_K": float(state.gas_K.min()),
        "vapour_penetration_m": float(np.linalg.norm(seen, axis=1).max(initial=0.0)),
        "vapour_mass_kg": float(gone.sum()),
        "liquid_mass_kg": 0.0 if parcels is None else parcels.mass_kg,
    }
    if source.bulb is not None:
        notes["wet_bulb_K"] = source.bulb.temperature_K
        notes["evaporation_rate_m2_s"] = source.bulb.rate_m2_s
    if np.isfinite(source.mixture.saturation_K):
        notes["saturation_K"] = source.mixture.saturation_K
        notes["saturation_fuel_ratio"] = source.mixture.saturation_B
    if parcels is not None:
        notes |= {
            "parcels": float(len(parcels.diameter_m)),
            "sauter_mean_diameter_m": parcels.sauter_mean_diameter_m,
            "liquid_penetration_m": _mass_depth_m(index, liquid, 0.97, spacing_m=spec.lattice_m),
        }
    vapour = _vapour(spec, index, gone, state.gas_K)
    return Spray(parcels=parcels, vapour=vapour, notes=notes, remarks=remarks)


def _without_effect(spec: ConeSpray) -> tuple[str, ...]:
    """What to say of keys that scenes of older versions may have."""
    given = [name for name in ("parcels_per_cell", "seed") if getattr(spec, name) is not None]
    return tuple(
        f"spray.{name} has no effect: the droplets of a cell fill it evenly, in "
        "spray.size_classes classes of size"
        for name in given
    )


def _grid(
    spec: ConeSpray, source: Source, *, injected: float
) -> tuple[Ints, Floats, Floats, Floats]:
    """Cells (N, 3) that hold fuel, counted from the nozzle, and for each (N,) the fuel's mass, its
    content in kg/m3 in that part of the cell that the plumes fill, and the share of it that has
    had the time to evaporate (where plumes meet, the mean)."""
    gas_kg_m3 = (
        spec.ambient.pressure_Pa
        * NITROGEN.molar_mass_kg_mol
        / (GAS_CONSTANT_J_mol_K * spec.ambient.temperature_K)
    )
    total = sum(plume.mass_fraction for plume in spec.plumes)
    indices, masses, filled, shares = [], [], [], []
    for plume in spec.plumes:
        share = plume.mass_fraction / total
        jet = Jet(
            rate_kg_s=share * spec.injected_mass_kg / spec.injection_duration_s,
            speed_m_s=source.speed_m_s,
            half_angle_rad=float(np.radians(plume.cone_angle_deg / 2)),
            fuel_kg_m3=source.density_kg_m3,
            gas_kg_m3=gas_kg_m3,
        )
        index, content, part, kinetic = _plume(spec, plume, jet, source)
        indices.append(index)
        masses.append(content * (share * injected / content.sum()))
        filled.append(masses[-1] * part)
        shares.append(masses[-1] * kinetic)
    low = np.min([index.min(axis=0) for index in indices], axis=0)
    high = np.max([index.max(axis=0) for index in indices], axis=0)
    shape = tuple(high - low + 1)
    runs = [np.ravel_multi_index(tuple(index.T - low[:, None]), shape) for index in indices]
    joined = np.concatenate(runs)
    # Each plume's cells are in order: a stable sort merges them.
    order = np.argsort(joined, kind="stable")
    joined = joined[order]
    new = np.append(True, joined[1:] != joined[:-1])
    keys, place = joined[new], np.cumsum(new) - 1

    def summed(values: list[Floats]) -> Floats:
        return np.bincount(place, np.concatenate(values)[order]).astype(float, copy=False)

    mass = summed(masses)
    part, kinetic = summed(filled) / mass, summed(shares) / mass
    kept = np.delete(np.arange(len(mass)), _thinnest(mass, NEGLIGIBLE * injected))
    mass = mass[kept] * (injected / mass[kept].sum())
    index = (np.stack(np.unravel_index(keys[kept], shape)) + low[:, None]).T
    content = mass / (part[kept] * spec.lattice_m**3)
    return index, mass, content, np.minimum(kinetic[kept], 1.0)


def _thinnest(amount: Floats, most: float) -> Ints:
    """Places of the smallest of amounts (N,) that are together at most `most`."""
    bound = min(float(amount.max()), most)  # one alone that is more does not go
    fewer = amount[amount <= bound]
    # What is sorted are the few below a bound that together are more than that.
    while bound > 0 and (fewer := fewer[fewer <= bound / 2]).sum() > most:
        bound /= 2
    among = np.flatnonzero(amount <= bound)
    # Stable: which of equal cells go does not depend on the processor.
    order = among[np.argsort(amount[among], kind="stable")]
    return np.asarray(order[np.cumsum(amount[order]) <= most])


def _plume(
    spec: ConeSpray, plume: Plume, jet: Jet, source: Source
) -> tuple[Ints, Floats, Floats, Floats]:
    """Cells (N, 3) of one plume, and for each (N,) the fuel in kg/m3, the part that it fills, and
    the share that has had the time to evaporate.

    Near the hole the plume is finer than the grid. It is widened there and fills that much less of
    its cells: it neither takes up more gas nor evaporates sooner because the grid is coarse.
    """
    h = spec.lattice_m
    inclination, azimuth = np.radians(plume.inclination_deg), np.radians(plume.azimuth_deg)
    side = np.sin(inclination)
    axis = np.array([side * np.cos(azimuth), side * np.sin(azimuth), -np.cos(inclination)])
    reach = jet.tip_m(spec.time_s * (1 + SOFTNESS + ROUNDING * MEAN_SQUARE))
    along = np.linspace(0.0, reach, 600)[1:]
    edge = _edge_m(jet, source, along)
    wide = np.hypot(edge, RESOLVED * h)
    across = wide[-1] * np.sqrt(1 - axis**2)
    start = source.barrel_m(jet.rate_kg_s)
    end = (start + reach) * axis
    least, most = np.minimum(0.0, end) - across, np.maximum(0.0, end) + across
    finest = float(np.prod(most - least) * len(spec.plumes) / MOST_CELLS) ** (1 / 3)
    if not finest <= h <= reach / 2:
        raise SprayError(
            f"spray.spacing_m: {h:g} does not suit a plume {reach:.3g} m long, one of "
            f"{len(spec.plumes)}; allowed is {finest:.2g}..{reach / 2:.2g}"
        )
    low, high = np.floor(least / h).astype(np.int64), np.ceil(most / h).astype(np.int64)
    slabs = max(1, int(np.prod((high - low).astype(float)) / _AT_ONCE))
    indices, contents, parts, shares = [], [], [], []
    for x in np.array_split(np.arange(low[0], high[0]), slabs):
        if not x.size:
            continue
        # Most cells lie beside the plume: the three coordinates stay apart until it is known which.
        ranges = (x, np.arange(low[1], high[1]), np.arange(low[2], high[2]))
        centre = [(one + 0.5) * h for one in np.ix_(*ranges)]
        s = sum(a * c for a, c in zip(axis, centre, strict=True))
        r2 = sum(c * c for c in centre) - s * s
        at = np.flatnonzero((s > 0) & (s < start + reach) & (r2 < wide[-1] ** 2))
        box = s.shape
        s, r2 = s.reshape(-1)[at], r2.reshape(-1)[at]
        # In the barrel the fuel is as it is where the jet begins: unmixed.
        s = np.maximum(s - start, along[0])
        width = np.interp(s, along, wide)
        xi2 = np.maximum(r2, 0.0) / width**2
        near = xi2 < 1
        at, s, xi2, width = at[near], s[near], xi2[near], width[near]
        ratio = jet.axis_ratio(s) * profile(np.sqrt(xi2))
        part = (np.interp(s, along, edge) / width) ** 2
        travel = jet.travel_s(s)
        kinetic = source.kinetic(_age_s(travel, xi2))
        content = source.mixture.content(ratio, kinetic) * part * _present(spec, travel, xi2)
        held = content > 0
        found = np.unravel_index(at[held], box)
        indices.append(np.stack([one[i] for one, i in zip(ranges, found, strict=True)]))
        contents.append(content[held])
        parts.append(part[held])
        shares.append(kinetic[held])
    if not any(content.size for content in contents):
        raise SprayError(
            f"spray.spacing_m: {h:g} is so coarse that no cell's middle lies in a plume; "
            f"allowed is {finest:.2g}..{reach / 20:.2g}"
        )
    content, part, kinetic = (np.concatenate(each) for each in (contents, parts, shares))
    return np.concatenate(indices, axis=1).T, content, part, kinetic


def _age_s(travel_s: Floats, xi2: Floats) -> Floats:
    """Time since the fuel left the hole: the plume's edge lags its axis."""
    return travel_s / (1 - ROUNDING * (xi2 - MEAN_SQUARE))


def _edge_m(jet: Jet, source: Source, along_m: Floats) -> Floats:
    """Radius of the plume at distances (N,): what rate / speed of fuel a length needs."""
    xi = (np.arange(64) + 0.5) / 64
    ratio = jet.axis_ratio(along_m)[:, None] * profile(xi)
    kinetic = source.kinetic(_age_s(jet.travel_s(along_m)[:, None], xi * xi))
    content = source.mixture.content(ratio, kinetic)
    mean = np.sum(content * 2 * xi / 64, axis=1)
    line = jet.rate_kg_s / jet.mean_speed_m_s(along_m)
    return np.asarray(np.sqrt(line / (np.pi * mean)))


def _present(spec: ConeSpray, travel_s: Floats, xi2: Floats) -> Floats:
    """Share (0..1) of the fuel that is there yet and not yet gone.

    Both steps are symmetric in the time of travel and the lag of the edge averages to nothing, so
    that the mass between tip and tail is what was injected.
    """
    first = spec.time_s * (1 - ROUNDING * (xi2 - MEAN_SQUARE))
    last = first - min(spec.injection_duration_s, spec.time_s) * (first / spec.time_s)
    present = _smooth_step((first - travel_s) / (SOFTNESS * spec.time_s))
    if spec.time_s <= spec.injection_duration_s:
        return present
    width = SOFTNESS * (spec.time_s - spec.injection_duration_s)
    return present * _smooth_step((travel_s - last) / width)


def _smooth_step(x: Floats) -> Floats:
    """0 below -1, 1 above 1, a cubic between."""
    t = np.clip((x + 1) / 2, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _parcels(
    spec: ConeSpray, source: Source, index: Ints, mass: Floats, state: State
) -> tuple[Parcels | None, Floats]:
    """Parcels of all cells, and the liquid of each cell (N,); the rest of its fuel is vapour.

    A cell has a parcel for each class of its sizes. The classes have equal mass and fill the cell
    evenly: nothing is drawn at random.
    """
    liquid = mass * (1 - state.evaporated)
    if source.bulb is not None:
        liquid[_thinnest(liquid, THIN * liquid.sum())] = 0.0
    wet = np.flatnonzero(liquid > 0)
    if source.sizes is None or not wet.size:
        return None, np.zeros(len(mass))
    count = spec.classes
    temperature = state.liquid_K[wet]
    density = heptane_density_kg_m3(temperature)
    diameter = source.sizes.diameters_m(state.evaporated[wet], count)
    diameter *= np.cbrt(source.density_kg_m3 / density)[:, None]
    droplets = diameter * diameter
    droplets *= diameter
    droplets *= np.pi / 6
    np.divide((liquid[wet] / density / count)[:, None], droplets, out=droplets)
    seen = diameter >= SMALLEST_m
    every = bool(seen.all())
    if not every:
        liquid[wet] *= np.mean(seen, axis=1)
    if not seen.any():
        return None, liquid

    def for_each(values: Floats) -> Floats:
        """Of cells (W, 1) or of their classes (W, count), for each of the parcels (N,)."""
        wide = np.broadcast_to(values, seen.shape)
        return wide.reshape(-1) if every else wide[seen]

    place = np.empty((3, np.count_nonzero(seen)))  # an axis at a time: rows of three are slow
    for row, along in zip(place, index.T, strict=True):
        row[:] = for_each(((along[wet] + 0.5) * spec.lattice_m)[:, None])
    parcels = Parcels(
        position_m=place.T,
        diameter_m=for_each(diameter),
        droplets=for_each(droplets),
        temperature_K=for_each(temperature[:, None]),
        density_kg_m3=for_each(density[:, None]),
        extent=Box(np.full(3, spec.lattice_m)),
    )
    return parcels, liquid


def _vapour(spec: ConeSpray, index: Ints, mass: Floats, temperature: Floats) -> Vapour | None:
    held = mass > 0
    if not held.any():
        return None
    molar = METHANE.molar_mass_kg_mol if spec.fuel == "methane" else HEPTANE_MOLAR_MASS_kg_mol
    index = np.stack([along[held] for along in index.T]).T
    lower, upper = (np.asarray(at * spec.lattice_m, dtype=float) for at in (index, index + 1))
    return Vapour(
        cells=Cells(lower_m=lower, upper_m=upper),
        number_density_m3=mass[held] / spec.lattice_m**3 * (_AVOGADRO / molar),
        temperature_K=temperature[held],
        molar_mass_kg_mol=molar,
    )


def _mass_depth_m(index: Ints, liquid: Floats, share: float, *, spacing_m: float) -> float:
    """Depth below the nozzle within which `share` of the liquid lies; it fills its cells evenly."""
    wet = liquid > 0
    layer = -1 - index[wet, 2]
    first = int(layer.min())
    below = np.append(0.0, np.cumsum(np.bincount(layer - first, liquid[wet])))
    depth = np.interp(share * below[-1], below, np.arange(len(below)) + first)
    return float(depth * spacing_m)
