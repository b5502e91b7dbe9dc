"""The `cone` spray: one quasi-steady jet per plume with evaporating droplets, added on a grid.

1. Each plume is a jet (`jet.py`). Fuel that leaves the hole at one time travels with the mean speed
   of the jet, so that the fuel in a length ds is rate / speed ds, and the injected fuel is between
   the positions of the first and of the last fuel: after the end of injection the plume leaves the
   nozzle. Tip and tail are smooth (a tenth of the travel time), and the tip is rounded.
2. Across the plume the fuel-to-gas ratio falls from the axis as `profile`. The width of the plume
   is that of this fuel, mixed in that ratio and cooled by its evaporation: somewhat less than the
   given cone in hot gas, and equal to it without evaporation.
3. The evaporated share is the smaller of two: that of equilibrium, which heat and saturation of the
   entrained gas allow, and that of kinetics (`kinetics.py`): droplets of every size class, with
   their slip, in the gas and vapour of their own plume.
4. The fuel of all plumes is added in the cells of a lattice, which are divided near the holes
   (`plume_cells.py`). Fuel content and evaporated share give the state (`mixing.py`): the gas has
   the temperature that conserves enthalpy, the liquid that of the wet bulb in this gas; in
   equilibrium both are equal.
"""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats, Ints
from cldit.constants import (
    AVOGADRO_PER_MOL,
    HEPTANE_MOLAR_MASS_kg_mol,
    SECOND_RADIATION_CONSTANT_m_K,
)
from cldit.gpu.device import Device
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.fluid_properties import heptane_density_kg_m3
from cldit.spray.cone.nozzle import NozzleFlow, flow_coefficient, nozzle_flow
from cldit.spray.cone.plume_cells import plume_cells, thinnest
from cldit.spray.extent import Box
from cldit.spray.result import Cells, Parcels, Spray, Vapour

THIN = 2e-4  # share of the liquid in the thinnest cells, which counts as evaporated
SMALLEST_m = 1e-7  # smaller droplets count as evaporated
# h c / (k lambda) at 3.4 um, of the radiance whose mean a cell's vapour has; 4232 K
_WIEN_K = float(np.rint(SECOND_RADIATION_CONSTANT_m_K / 3.4e-6))


def make_cone(spec: ConeSpray, device: Device) -> Spray:
    """Parcels and vapour of the spray at `spec.time_s`; fuel mass is conserved to rounding.

    `notes`: injected_mass_kg, liquid_mass_kg, vapour_mass_kg, jet_speed_m_s, flow_coefficient
    (ratio to the flow that fills the holes at that speed), vapour_penetration_m (farthest cell with
    a vapour mass fraction of 1e-3), coldest_K, cells. With droplets: parcels,
    sauter_mean_diameter_m, liquid_penetration_m (depth below the nozzle of 97 % of the liquid).
    With evaporation: wet_bulb_K and evaporation_rate_m2_s (K of the d^2 law) in the undisturbed
    gas, saturation_K and saturation_fuel_ratio (where no liquid remains in equilibrium).

    Raises:
        SprayError: the combination of values is impossible: pressure, flow, sizes, grid.
    """
    source = nozzle_flow(spec, device)
    rate = spec.injected_mass_kg / spec.injection_duration_s
    flow = flow_coefficient(spec, rate_kg_s=rate, flux_kg_m2_s=source.flux_kg_m2_s)
    injected = spec.injected_mass_kg * min(spec.time_s / spec.injection_duration_s, 1.0)
    notes = {"injected_mass_kg": injected, "flow_coefficient": flow}
    remarks = _without_effect(spec)
    if injected == 0:
        return Spray(notes=notes, remarks=remarks)
    cells = plume_cells(spec, device, injected=injected)
    hot_K, liquid_K, evaporated, ratio = source.mixture.at(cells.content_kg_m3, cells.kinetic)
    liquid_parts = cells.mass_kg * (1 - evaporated)
    means = (cells.mean(values, liquid_parts) for values in (liquid_K, evaporated))
    parcels, liquid = _parcels(spec, source, cells.cell, cells.total(liquid_parts), *means)
    gone = cells.total(cells.mass_kg) - liquid
    fraction = evaporated * ratio / (1 + ratio)
    seen = (cells.cell[cells.mean(fraction, cells.mass_kg) >= 1e-3] + 0.5) * spec.lattice_m
    notes |= {
        "jet_speed_m_s": source.speed_m_s,
        "cells": float(len(cells.cell)),
        "coldest_K": float(hot_K.min()),
        "vapour_penetration_m": float(np.linalg.norm(seen, axis=1).max(initial=0.0)),
        "vapour_mass_kg": float(gone.sum()),
        "liquid_mass_kg": 0.0 if parcels is None else parcels.mass_kg,
    }
    if source.kernels is not None:
        notes |= {"wet_bulb_K": source.wet_bulb_K, "evaporation_rate_m2_s": source.rate_m2_s}
    if np.isfinite(source.mixture.saturation_K):
        notes["saturation_K"] = source.mixture.saturation_K
        notes["saturation_fuel_ratio"] = source.mixture.saturation_B
    if parcels is not None:
        notes |= {
            "parcels": float(len(parcels.diameter_m)),
            "sauter_mean_diameter_m": parcels.sauter_mean_diameter_m,
            "liquid_penetration_m": _mass_depth_m(
                cells.cell, liquid, 0.97, spacing_m=spec.lattice_m
            ),
        }
    # The mean radiance of the parts; those without vapour have a millionth of their fuel.
    weight = cells.mass_kg - (1 - 1e-6) * liquid_parts
    gas_K = _WIEN_K / -np.log(cells.mean(np.exp(-_WIEN_K / hot_K), weight))
    vapour = _vapour(spec, cells.cell, gone, gas_K)
    return Spray(parcels=parcels, vapour=vapour, notes=notes, remarks=remarks)


def _without_effect(spec: ConeSpray) -> tuple[str, ...]:
    """Remarks on keys without effect, which scenes of older versions may have."""
    keys = [name for name in ("parcels_per_cell", "seed") if getattr(spec, name) is not None]
    return tuple(
        f"spray.{name} has no effect: the droplets of a cell fill it uniformly, in "
        "spray.size_classes classes of size"
        for name in keys
    )


def _parcels(
    spec: ConeSpray,
    source: NozzleFlow,
    cell: Ints,
    liquid: Floats,
    liquid_K: Floats,
    evaporated: Floats,
) -> tuple[Parcels | None, Floats]:
    """Parcels of all cells (C, 3), and the liquid of each (C,); the rest of its fuel is vapour.

    `liquid` (C,) is that of the mixture, with its mean temperature and evaporated share. A cell has
    a parcel for each size class. The classes have equal mass and fill the cell uniformly: nothing
    is random.
    """
    if source.kernels is not None:
        liquid[thinnest(liquid, THIN * liquid.sum())] = 0.0
    wet = np.flatnonzero(liquid > 0)
    if not wet.size:
        return None, np.zeros(len(liquid))
    count = spec.classes
    temperature = liquid_K[wet]
    density = heptane_density_kg_m3(temperature)
    diameter = source.sizes.diameters_m(evaporated[wet], count)
    diameter *= np.cbrt(source.density_kg_m3 / density)[:, None]
    droplets = diameter * diameter
    droplets *= diameter
    droplets *= np.pi / 6
    np.divide((liquid[wet] / density / count)[:, None], droplets, out=droplets)
    seen = diameter >= SMALLEST_m
    complete = bool(seen.all())
    if not complete:
        liquid[wet] *= np.mean(seen, axis=1)
    if not seen.any():
        return None, liquid

    def for_each(values: Floats) -> Floats:
        """Values of the parcels (N,), from those of cells (W, 1) or of their classes (W, count)."""
        wide = np.broadcast_to(values, seen.shape)
        return wide.reshape(-1) if complete else wide[seen]

    place = np.empty((3, np.count_nonzero(seen)))  # rows of three would be slow
    for row, along in zip(place, cell.T, strict=True):
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
    molar = HEPTANE_MOLAR_MASS_kg_mol
    index = np.stack([along[held] for along in index.T]).T
    lower, upper = (np.asarray(at * spec.lattice_m, dtype=float) for at in (index, index + 1))
    return Vapour(
        cells=Cells(lower_m=lower, upper_m=upper),
        number_density_m3=mass[held] / spec.lattice_m**3 * (AVOGADRO_PER_MOL / molar),
        temperature_K=temperature[held],
        molar_mass_kg_mol=molar,
    )


def _mass_depth_m(index: Ints, liquid: Floats, share: float, *, spacing_m: float) -> float:
    """Depth below the nozzle of a `share` of the liquid, which fills its cells uniformly."""
    wet = liquid > 0
    layer = -1 - index[wet, 2]
    top = int(layer.min())
    below = np.append(0.0, np.cumsum(np.bincount(layer - top, liquid[wet])))
    depth = np.interp(share * below[-1], below, np.arange(len(below)) + top)
    return float(depth * spacing_m)
