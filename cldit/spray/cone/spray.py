"""The `cone` spray: one quasi-steady jet per plume with evaporating droplets, added on a grid.

0. Methane is under-expanded at the hole (`underexpanded_jet.py`): up to the Mach disc it has the
   temperature and speed of the notional nozzle and entrains no gas; there the jet begins.
1. Each plume is a jet (`jet.py`). Fuel that leaves the hole at one time travels with the mean speed
   of the jet, so that the fuel in a length ds is rate / speed ds, and the injected fuel is between
   the positions of the first and of the last fuel: after the end of injection the plume leaves the
   nozzle. Tip and tail are smooth (a tenth of the travel time), and the tip is rounded.
2. Across the plume the fuel-to-gas ratio falls from the axis as `profile`. The width of the plume
   is that of this fuel, mixed in that ratio and cooled by its evaporation: somewhat less than the
   given cone in hot gas, and equal to it without evaporation.
3. The evaporated share is the smaller of two: that of equilibrium, which heat and saturation of the
   entrained gas allow, and that of kinetics, which the d^2 law of every size class allows in the
   travel time, with the rate of droplets at rest in the undisturbed gas (`wet_bulb.py`). Slip
   increases evaporation, cooler gas with vapour reduces it; the rate includes neither. In an
   integration along a hot plume (0.6 MPa, 570 K) with both they cancel on and near the axis from
   20 mm on (within 0.1 of the fuel); at the edge, and within 15 mm of the nozzle, slip prevails,
   and the model evaporates up to 0.2 of the fuel too little.
4. The fuel of all plumes is added in the cells of a grid. Fuel content and evaporated share give
   the state (`mixing.py`): the gas has the temperature that conserves enthalpy, the liquid that of
   the wet bulb in this gas; in equilibrium both are equal.
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
from cldit.spray.cone.mixing import MixtureState
from cldit.spray.cone.nozzle import NozzleFlow, nozzle_flow
from cldit.spray.extent import Box
from cldit.spray.result import Cells, Parcels, Spray, Vapour

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SOFTNESS = 0.1  # half the width of tip and tail, over the travel time
ROUNDING = 0.4  # lag of the plume's edge behind its axis, over the time
NEGLIGIBLE = 1e-7  # share of the fuel in the thinnest cells, which the others receive
THIN = 2e-4  # share of the liquid in the thinnest cells, which counts as evaporated
SMALLEST_m = 1e-7  # smaller droplets count as evaporated
RESOLVED = 1.5  # smallest radius of the plume, in cells
MOST_CELLS = 2e8  # in the boxes around all plumes
_AT_ONCE = 1e5  # of these, processed in the cache
_AVOGADRO = 6.02214076e23


def make_cone(spec: ConeSpray) -> Spray:
    """Parcels and vapour of the spray at `spec.time_s`; fuel mass is conserved to rounding.

    `notes`: injected_mass_kg, liquid_mass_kg, vapour_mass_kg, jet_speed_m_s, flow_coefficient
    (ratio to the flow that fills the holes at that speed), vapour_penetration_m (farthest cell with
    a vapour mass fraction of 1e-3), coldest_K, cells. With droplets: parcels,
    sauter_mean_diameter_m, liquid_penetration_m (depth below the nozzle of 97 % of the liquid).
    With evaporation: wet_bulb_K and evaporation_rate_m2_s (K of the d^2 law) in the undisturbed
    gas, saturation_K and saturation_fuel_ratio (where no liquid remains in equilibrium). For
    methane: mach_disc_m (distance from the hole, of the largest plume), throat_K, throat_Pa,
    notional_K, and notional_area_ratio (of the notional nozzle to the throat).

    Raises:
        SprayError: the combination of values is impossible: pressure, flow, sizes, grid.
    """
    source = nozzle_flow(spec)
    rate = spec.injected_mass_kg / spec.injection_duration_s
    holes = len(spec.plumes) * np.pi / 4 * spec.hole_diameter_m**2
    flow = rate / (holes * source.flux_kg_m2_s)
    if flow > 1:
        raise SprayError(
            f"spray.injected_mass_kg: {spec.injected_mass_kg:g} in {spec.injection_duration_s:g} s "
            f"is {flow:.3g} times the flow that the pressure drives through {len(spec.plumes)} "
            f"holes of {spec.hole_diameter_m:g} m; at most {spec.injected_mass_kg / flow:.3g}"
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
    """Remarks on keys without effect, which scenes of older versions may have."""
    given = [name for name in ("parcels_per_cell", "seed") if getattr(spec, name) is not None]
    return tuple(
        f"spray.{name} has no effect: the droplets of a cell fill it uniformly, in "
        "spray.size_classes classes of size"
        for name in given
    )


def _grid(
    spec: ConeSpray, source: NozzleFlow, *, injected: float
) -> tuple[Ints, Floats, Floats, Floats]:
    """Cells (N, 3) with fuel, counted from the nozzle, and three values (N,) of each.

    These are the mass of the fuel, its content in kg/m3 in the part of the cell that plumes fill,
    and the share that has had time to evaporate (the mean if several plumes fill the cell).
    """
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
    # The cells of each plume are sorted: a stable sort merges them.
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
    """Numbers of the smallest of amounts (N,) whose sum is at most `most`."""
    bound = min(float(amount.max()), most)  # no single larger amount
    fewer = amount[amount <= bound]
    # Only the few amounts below a bound, whose sum exceeds `most`, are sorted.
    while bound > 0 and (fewer := fewer[fewer <= bound / 2]).sum() > most:
        bound /= 2
    among = np.flatnonzero(amount <= bound)
    # A stable sort chooses among equal cells independently of the processor.
    order = among[np.argsort(amount[among], kind="stable")]
    return np.asarray(order[np.cumsum(amount[order]) <= most])


def _plume(
    spec: ConeSpray, plume: Plume, jet: Jet, source: NozzleFlow
) -> tuple[Ints, Floats, Floats, Floats]:
    """Cells (N, 3) of one plume, and three values (N,) of each.

    These are the fuel in kg/m3, the filled part, and the share that has had time to evaporate. Near
    the hole the plume is finer than the grid. It is widened there and fills less of its cells
    accordingly, so that a coarse grid increases neither entrainment nor evaporation.
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
            f"spray.spacing_m: {h:g} does not suit a plume of {reach:.3g} m, one of "
            f"{len(spec.plumes)}; allowed: {finest:.2g}..{reach / 2:.2g}"
        )
    low, high = np.floor(least / h).astype(np.int64), np.ceil(most / h).astype(np.int64)
    slabs = max(1, int(np.prod((high - low).astype(float)) / _AT_ONCE))
    indices, contents, parts, shares = [], [], [], []
    for x in np.array_split(np.arange(low[0], high[0]), slabs):
        if not x.size:
            continue
        # Most cells are beside the plume: coordinates are combined only for those within.
        ranges = (x, np.arange(low[1], high[1]), np.arange(low[2], high[2]))
        centre = [(one + 0.5) * h for one in np.ix_(*ranges)]
        s = sum(a * c for a, c in zip(axis, centre, strict=True))
        r2 = sum(c * c for c in centre) - s * s
        at = np.flatnonzero((s > 0) & (s < start + reach) & (r2 < wide[-1] ** 2))
        box = s.shape
        s, r2 = s.reshape(-1)[at], r2.reshape(-1)[at]
        # In the barrel the fuel is unmixed, as at the start of the jet.
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
        filled = content > 0
        found = np.unravel_index(at[filled], box)
        indices.append(np.stack([one[i] for one, i in zip(ranges, found, strict=True)]))
        contents.append(content[filled])
        parts.append(part[filled])
        shares.append(kinetic[filled])
    if not any(content.size for content in contents):
        raise SprayError(
            f"spray.spacing_m: {h:g} is so coarse that no cell's middle is in a plume; "
            f"allowed: {finest:.2g}..{reach / 20:.2g}"
        )
    content, part, kinetic = (np.concatenate(each) for each in (contents, parts, shares))
    return np.concatenate(indices, axis=1).T, content, part, kinetic


def _age_s(travel_s: Floats, xi2: Floats) -> Floats:
    """Time since the fuel left the hole: the edge of the plume lags behind its axis."""
    return travel_s / (1 - ROUNDING * (xi2 - MEAN_SQUARE))


def _edge_m(jet: Jet, source: NozzleFlow, along_m: Floats) -> Floats:
    """Radius of the plume at distances (N,), by the fuel per length, rate / speed."""
    xi = (np.arange(64) + 0.5) / 64
    ratio = jet.axis_ratio(along_m)[:, None] * profile(xi)
    kinetic = source.kinetic(_age_s(jet.travel_s(along_m)[:, None], xi * xi))
    content = source.mixture.content(ratio, kinetic)
    mean = np.sum(content * 2 * xi / 64, axis=1)
    line = jet.rate_kg_s / jet.mean_speed_m_s(along_m)
    return np.asarray(np.sqrt(line / (np.pi * mean)))


def _present(spec: ConeSpray, travel_s: Floats, xi2: Floats) -> Floats:
    """Share (0..1) of the fuel between tip and tail.

    Both steps are symmetric in the travel time and the mean lag of the edge is 0, so that the mass
    between tip and tail is the injected mass.
    """
    first = spec.time_s * (1 - ROUNDING * (xi2 - MEAN_SQUARE))
    last = first - min(spec.injection_duration_s, spec.time_s) * (first / spec.time_s)
    present = _smooth_step((first - travel_s) / (SOFTNESS * spec.time_s))
    if spec.time_s <= spec.injection_duration_s:
        return present
    width = SOFTNESS * (spec.time_s - spec.injection_duration_s)
    return present * _smooth_step((travel_s - last) / width)


def _smooth_step(x: Floats) -> Floats:
    """Smooth step: 0 below -1, 1 above 1, a cubic between."""
    t = np.clip((x + 1) / 2, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _parcels(
    spec: ConeSpray, source: NozzleFlow, index: Ints, mass: Floats, state: MixtureState
) -> tuple[Parcels | None, Floats]:
    """Parcels of all cells, and the liquid of each cell (N,); the rest of its fuel is vapour.

    A cell has a parcel for each size class. The classes have equal mass and fill the cell
    uniformly: nothing is random.
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
        """Values of the parcels (N,), from those of cells (W, 1) or of their classes (W, count)."""
        wide = np.broadcast_to(values, seen.shape)
        return wide.reshape(-1) if every else wide[seen]

    place = np.empty((3, np.count_nonzero(seen)))  # rows of three would be slow
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
    """Depth below the nozzle of a `share` of the liquid, which fills its cells uniformly."""
    wet = liquid > 0
    layer = -1 - index[wet, 2]
    first = int(layer.min())
    below = np.append(0.0, np.cumsum(np.bincount(layer - first, liquid[wet])))
    depth = np.interp(share * below[-1], below, np.arange(len(below)) + first)
    return float(depth * spacing_m)
