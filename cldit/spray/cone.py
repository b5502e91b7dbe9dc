"""The `cone` spray: one quasi-steady jet a plume, superposed on a grid, in local equilibrium.

1. Each plume is a jet (`cldit.spray.jet`). Fuel that left the hole at one moment travels with the
   jet's mean speed, so that the fuel in a length ds is rate / speed ds, and what has been injected
   is spread between the place of the first and of the last fuel: after the end of injection the
   plume leaves the nozzle. Tip and tail are soft (a tenth of the time of travel), the tip rounded.
2. Across the plume the fuel-to-gas ratio falls from the axis as `profile`. The plume is as wide as
   this fuel, mixed in that ratio and cooled by its evaporation, needs: somewhat less than the
   given cone where the gas is hot, the cone itself where nothing evaporates.
3. The fuel of all plumes adds up in the cells of a grid. Fuel content decides the state (mixing
   limit, `cldit.spray.mixing`): temperature, vapour, liquid. Droplets and gas have one
   temperature, and every droplet of a cell has lost the same share of its mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.errors import SprayError
from cldit.scene.schema import ConeSpray, Plume
from cldit.spray.fuel import (
    METHANE,
    NITROGEN,
    GAS_CONSTANT_J_mol_K,
    HEPTANE_MOLAR_MASS_kg_mol,
    heptane_density_kg_m3,
)
from cldit.spray.jet import MEAN_SQUARE, Jet, profile
from cldit.spray.methane import expand
from cldit.spray.mixing import Mixture, heptane_mixture, methane_mixture
from cldit.spray.result import Cells, Parcels, Spray, Vapour
from cldit.spray.sizes import strata_m

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

VELOCITY_COEFFICIENT = 0.9  # speed at the hole over Bernoulli's
SOFTNESS = 0.1  # half the width of tip and tail, of the time of travel
ROUNDING = 0.4  # by how much of the time the plume's edge lags its axis
NEGLIGIBLE = 1e-7  # of the fuel's mass: the thinnest cells go, and the others take it over
SMALLEST_m = 1e-7  # droplets below count as evaporated
RESOLVED = 1.5  # the plume is at least this many cells wide (radius)
MOST_CELLS = 5e7  # looked at, in the boxes around all plumes
_SETS = 16  # cells take turns with this many interleaved sets of diameters
_AVOGADRO = 6.02214076e23


@dataclass(frozen=True)
class _Source:
    """What leaves the holes: the same for every plume but for the flow."""

    speed_m_s: float
    density_kg_m3: float
    flux_kg_m2_s: float
    mixture: Mixture


def make_cone(spec: ConeSpray) -> Spray:
    """Parcels and vapour of the spray at `spec.time_s`; fuel mass is kept to rounding.

    `notes`: injected_mass_kg, liquid_mass_kg, vapour_mass_kg, jet_speed_m_s, flow_coefficient (of
    what the holes pass at that speed),
    vapour_penetration_m (farthest cell with a vapour mass fraction of 1e-3), coldest_K, cells, and
    with droplets parcels, sauter_mean_diameter_m, liquid_penetration_m (97 % of the liquid is
    nearer to the nozzle), saturation_K and saturation_fuel_ratio where liquid can evaporate.

    Raises:
        SprayError: the combination of values is impossible: pressure, flow, sizes, grid.
    """
    source = _source(spec)
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
    if injected == 0:
        return Spray(notes=notes)
    index, mass, content = _grid(spec, source, injected=injected)
    temperature, evaporated, ratio = source.mixture.at(content)
    gone = mass * evaporated
    parcels, lost = _parcels(spec, index, mass, temperature, evaporated)
    gone += lost
    distance = np.linalg.norm((index + 0.5) * spec.spacing_m, axis=1)
    share = evaporated * ratio / (1 + ratio)
    notes |= {
        "jet_speed_m_s": source.speed_m_s,
        "cells": float(len(index)),
        "coldest_K": float(temperature.min()),
        "vapour_penetration_m": float(np.max(distance, where=share >= 1e-3, initial=0.0)),
        "vapour_mass_kg": float(gone.sum()),
        "liquid_mass_kg": 0.0 if parcels is None else parcels.mass_kg,
    }
    if np.isfinite(source.mixture.saturation_K):
        notes["saturation_K"] = source.mixture.saturation_K
        notes["saturation_fuel_ratio"] = source.mixture.saturation_B
    if parcels is not None:
        notes |= {
            "parcels": float(len(parcels.diameter_m)),
            "sauter_mean_diameter_m": parcels.sauter_mean_diameter_m,
            "liquid_penetration_m": _mass_distance(parcels, 0.97),
        }
    vapour = _vapour(spec, index, gone, temperature)
    return Spray(parcels=parcels, vapour=vapour, notes=notes)


def _source(spec: ConeSpray) -> _Source:
    """State of the fuel at the holes, and the table of its mixtures with the gas."""
    ambient = spec.ambient
    if spec.injection_pressure_Pa <= ambient.pressure_Pa:
        raise SprayError(
            f"spray.injection_pressure_Pa: {spec.injection_pressure_Pa:g} is not above the "
            f"pressure of the gas, {ambient.pressure_Pa:g}"
        )
    if spec.fuel == "methane":
        jet = expand(
            stagnation_Pa=spec.injection_pressure_Pa,
            stagnation_K=spec.fuel_temperature_K,
            pressure_Pa=ambient.pressure_Pa,
        )
        mixture = methane_mixture(
            pressure_Pa=ambient.pressure_Pa,
            gas_K=ambient.temperature_K,
            fuel_K=spec.fuel_temperature_K,
            speed_m_s=jet.speed_m_s,
        )
        return _Source(jet.speed_m_s, jet.density_kg_m3, jet.flux_kg_m2_s, mixture)
    if spec.droplets is None:
        raise SprayError("spray.droplets: null, but n-heptane leaves the injector as droplets")
    density = float(heptane_density_kg_m3(spec.fuel_temperature_K))
    drop = spec.injection_pressure_Pa - ambient.pressure_Pa
    speed = VELOCITY_COEFFICIENT * float(np.sqrt(2 * drop / density))
    mixture = heptane_mixture(
        pressure_Pa=ambient.pressure_Pa,
        gas_K=ambient.temperature_K,
        fuel_K=spec.fuel_temperature_K,
        evaporation=spec.evaporation,
    )
    return _Source(speed, density, density * speed, mixture)


def _grid(spec: ConeSpray, source: _Source, *, injected: float) -> tuple[Ints, Floats, Floats]:
    """Cells (N, 3) that hold fuel, counted from the nozzle, the fuel's mass in them (N,), and its
    content in kg/m3 (N,) in that part of the cell that the plumes fill."""
    gas_kg_m3 = (
        spec.ambient.pressure_Pa
        * NITROGEN.molar_mass_kg_mol
        / (GAS_CONSTANT_J_mol_K * spec.ambient.temperature_K)
    )
    total = sum(plume.mass_fraction for plume in spec.plumes)
    indices, masses, filled = [], [], []
    for plume in spec.plumes:
        share = plume.mass_fraction / total
        jet = Jet(
            rate_kg_s=share * spec.injected_mass_kg / spec.injection_duration_s,
            speed_m_s=source.speed_m_s,
            half_angle_rad=float(np.radians(plume.cone_angle_deg / 2)),
            fuel_kg_m3=source.density_kg_m3,
            gas_kg_m3=gas_kg_m3,
        )
        index, content, part = _plume(spec, plume, jet, source.mixture)
        indices.append(index)
        masses.append(content * (share * injected / content.sum()))
        filled.append(masses[-1] * part)
    together = np.concatenate(indices)
    low = together.min(axis=0)
    shape = together.max(axis=0) - low + 1
    keys, place = np.unique(
        np.ravel_multi_index(tuple((together - low).T), tuple(shape)), return_inverse=True
    )
    mass = np.bincount(place, weights=np.concatenate(masses))
    part = np.bincount(place, weights=np.concatenate(filled)) / mass
    order = np.argsort(mass)
    thin = np.cumsum(mass[order]) <= NEGLIGIBLE * injected
    kept = np.sort(order[~thin])
    mass = mass[kept] * (injected / mass[kept].sum())
    index = np.stack(np.unravel_index(keys[kept], tuple(shape)), axis=1) + low
    return index, mass, mass / (part[kept] * spec.spacing_m**3)


def _plume(
    spec: ConeSpray, plume: Plume, jet: Jet, mixture: Mixture
) -> tuple[Ints, Floats, Floats]:
    """Cells (N, 3) of one plume, the fuel in them in kg/m3 (N,), and the part that it fills (N,).

    Near the hole the plume is finer than the grid. It is widened there and fills that much less of
    its cells: it neither takes up more gas nor evaporates sooner because the grid is coarse.
    """
    h = spec.spacing_m
    inclination, azimuth = np.radians(plume.inclination_deg), np.radians(plume.azimuth_deg)
    side = np.sin(inclination)
    axis = np.array([side * np.cos(azimuth), side * np.sin(azimuth), -np.cos(inclination)])
    reach = jet.tip_m(spec.time_s * (1 + SOFTNESS + ROUNDING * MEAN_SQUARE))
    along = np.linspace(0.0, reach, 600)[1:]
    edge = _edge_m(jet, mixture, along)
    wide = np.hypot(edge, RESOLVED * h)
    across = wide[-1] * np.sqrt(1 - axis**2)
    least, most = np.minimum(0.0, reach * axis) - across, np.maximum(0.0, reach * axis) + across
    finest = float(np.prod(most - least) * len(spec.plumes) / MOST_CELLS) ** (1 / 3)
    if not finest <= h <= reach / 2:
        raise SprayError(
            f"spray.spacing_m: {h:g} does not suit a plume {reach:.3g} m long, one of "
            f"{len(spec.plumes)}; allowed is {finest:.2g}..{reach / 2:.2g}"
        )
    low, high = np.floor(least / h).astype(np.int64), np.ceil(most / h).astype(np.int64)
    slabs = max(1, int(np.prod((high - low).astype(float)) / 1e6))
    indices, contents, parts = [], [], []
    for x in np.array_split(np.arange(low[0], high[0]), slabs):
        if not x.size:
            continue
        ix, iy, iz = np.meshgrid(
            x, np.arange(low[1], high[1]), np.arange(low[2], high[2]), indexing="ij"
        )
        index = np.stack([ix.ravel(), iy.ravel(), iz.ravel()], axis=1)
        centre = (index + 0.5) * h
        s = centre @ axis
        r2 = np.einsum("ij,ij->i", centre, centre) - s * s
        near = (s > 0) & (s < reach) & (r2 < wide[-1] ** 2)
        index, s, r2 = index[near], s[near], r2[near]
        xi2 = np.maximum(r2, 0.0) / np.interp(s, along, wide) ** 2
        near = xi2 < 1
        index, s, xi2 = index[near], s[near], xi2[near]
        ratio = jet.axis_ratio(s) * profile(np.sqrt(xi2))
        part = (np.interp(s, along, edge) / np.interp(s, along, wide)) ** 2
        content = mixture.content(ratio) * part * _present(spec, jet, s, xi2)
        held = content > 0
        indices.append(index[held])
        contents.append(content[held])
        parts.append(part[held])
    if not any(content.size for content in contents):
        raise SprayError(
            f"spray.spacing_m: {h:g} is so coarse that no cell's middle lies in a plume; "
            f"allowed is {finest:.2g}..{reach / 20:.2g}"
        )
    return np.concatenate(indices), np.concatenate(contents), np.concatenate(parts)


def _edge_m(jet: Jet, mixture: Mixture, along_m: Floats) -> Floats:
    """Radius of the plume at distances (N,): what rate / speed of fuel a length needs."""
    xi = (np.arange(64) + 0.5) / 64
    ratio = jet.axis_ratio(along_m)[:, None] * profile(xi)
    content = mixture.content(ratio)
    mean = np.sum(content * 2 * xi / 64, axis=1)
    line = jet.rate_kg_s / jet.mean_speed_m_s(along_m)
    return np.asarray(np.sqrt(line / (np.pi * mean)))


def _present(spec: ConeSpray, jet: Jet, along_m: Floats, xi2: Floats) -> Floats:
    """Share (0..1) of the fuel that is there yet and not yet gone.

    Both steps are symmetric in the time of travel and the lag of the edge averages to nothing, so
    that the mass between tip and tail is what was injected.
    """
    travel = jet.travel_s(along_m)
    first = spec.time_s * (1 - ROUNDING * (xi2 - MEAN_SQUARE))
    last = first - min(spec.injection_duration_s, spec.time_s) * (first / spec.time_s)
    present = _smooth_step((first - travel) / (SOFTNESS * spec.time_s))
    if spec.time_s <= spec.injection_duration_s:
        return present
    width = SOFTNESS * (spec.time_s - spec.injection_duration_s)
    return present * _smooth_step((travel - last) / width)


def _smooth_step(x: Floats) -> Floats:
    """0 below -1, 1 above 1, a cubic between."""
    t = np.clip((x + 1) / 2, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _parcels(
    spec: ConeSpray, index: Ints, mass: Floats, temperature: Floats, evaporated: Floats
) -> tuple[Parcels | None, Floats]:
    """Parcels of all cells, and the liquid of each cell that is too fine and counts as vapour."""
    lost = np.zeros(len(mass))
    wet = np.flatnonzero(evaporated < 1)
    if spec.droplets is None or not wet.size:
        return None, lost
    count = spec.parcels_per_cell
    strata = strata_m(spec.droplets, count * _SETS)
    if not strata[-1] < 1e-3:
        raise SprayError(
            f"spray.droplets: these sizes reach {strata[-1]:.3g} m, allowed is less than 1e-3"
        )
    random = np.random.default_rng(spec.seed)
    density = heptane_density_kg_m3(temperature[wet])
    turn = random.integers(_SETS, size=wet.size)
    initial = strata.reshape(count, _SETS)[:, turn].T
    left = (1 - evaporated[wet]) * heptane_density_kg_m3(spec.fuel_temperature_K) / density
    diameter = initial * np.cbrt(left)[:, None]
    liquid = mass[wet] * (1 - evaporated[wet])
    droplets = (liquid / density / count)[:, None] / (np.pi / 6 * diameter**3)
    corner = (index[wet, None, :] + random.random((wet.size, count, 3))) * spec.spacing_m
    seen = diameter >= SMALLEST_m
    lost[wet] = liquid * np.mean(~seen, axis=1)
    if not seen.any():
        return None, lost
    parcels = Parcels(
        position_m=corner[seen],
        diameter_m=diameter[seen],
        droplets=droplets[seen],
        temperature_K=np.broadcast_to(temperature[wet, None], seen.shape)[seen],
        density_kg_m3=np.broadcast_to(density[:, None], seen.shape)[seen],
    )
    return parcels, lost


def _vapour(spec: ConeSpray, index: Ints, mass: Floats, temperature: Floats) -> Vapour | None:
    held = mass > 0
    if not held.any():
        return None
    molar = METHANE.molar_mass_kg_mol if spec.fuel == "methane" else HEPTANE_MOLAR_MASS_kg_mol
    corners = [np.asarray(place * spec.spacing_m, dtype=float) for place in (index, index + 1)]
    return Vapour(
        cells=Cells(lower_m=corners[0][held], upper_m=corners[1][held]),
        number_density_m3=mass[held] / spec.spacing_m**3 * (_AVOGADRO / molar),
        temperature_K=temperature[held],
        molar_mass_kg_mol=molar,
    )


def _mass_distance(parcels: Parcels, share: float) -> float:
    """Distance from the nozzle within which `share` of the liquid lies."""
    distance = np.linalg.norm(parcels.position_m, axis=1)
    mass = parcels.droplets * parcels.density_kg_m3 * parcels.diameter_m**3
    order = np.argsort(distance)
    reached = np.cumsum(mass[order])
    return float(distance[order][np.searchsorted(reached, share * reached[-1])])
