"""The `lagrangian` spray: time integration of parcels and gas."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from cldit.errors import SprayError
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cone.jet import Jet
from cldit.spray.droplet.evaporation import MODELS, inert
from cldit.spray.droplet.fluids import Fuel, check_conditions, fuel_table, gas_table
from cldit.spray.flow.coupling import FlyingParcels, LiquidModel, move
from cldit.spray.flow.gas import FlowGrid, GasFlow
from cldit.spray.flow.gasjet import Jets
from cldit.spray.flow.injector import Injection, inject
from cldit.spray.flow.measures import History, Station, measures
from cldit.spray.flow.mixture import gas_mixture
from cldit.spray.result import Cells, Parcels, Spray, Vapour

Floats = NDArray[np.float64]

LONGEST_STEP_S = 2e-5
MOST_CELLS = 2e7
NEGLIGIBLE = 1e-6  # mass fraction of vapour below which cells are omitted from the result
_AVOGADRO = 6.02214076e23
_RECORDS = 100


Watch = Callable[[float, float, int], None]  # time, end time, number of parcels


def simulate_spray(
    spec: LagrangianSpray, *, cache: Path | None = None, watch: Watch | None = None
) -> tuple[Spray, History, GasFlow]:
    """Computes the spray at `spec.time_s`, its history, and the gas.

    `notes` of the spray: injected, liquid, vapour and wall mass (kg), parcels, steps, cells, speed
    at the hole, flow coefficient, Sauter mean diameter (of all present droplets, and of those that
    crossed the plane 15 mm below the injector), penetrations, coldest gas, pressure.

    Args:
        spec: the scene's spray.
        cache: folder for property tables.
        watch: called after every step.

    Raises:
        SprayError: an impossible combination of values, or a flow that cannot be computed.
    """
    fuel, carrier = fuel_table(spec.fuel, cache=cache), gas_table(spec.gas, cache=cache)
    ambient = spec.ambient
    check_conditions(
        fuel,
        temperature_K=spec.fuel_temperature_K,
        gas_K=ambient.temperature_K,
        pressure_Pa=ambient.pressure_Pa,
    )
    injection = inject(spec, fuel)
    flow = GasFlow(
        make_box(spec, injection),
        gas_mixture(fuel, carrier, reference_K=ambient.temperature_K),
        pressure_Pa=ambient.pressure_Pa,
        temperature_K=ambient.temperature_K,
    )
    model = inert if spec.evaporation == "none" else MODELS[spec.evaporation]
    jets = Jets(
        len(injection.holes),
        speed_m_s=injection.speed_m_s,
        density_kg_m3=flow.far_density_kg_m3,
        spacing_m=flow.box.spacing_m,
    )
    liquid = LiquidModel(fuel=fuel, carrier=carrier, model=model, injection=injection)
    random = np.random.default_rng([spec.seed, 1])
    each = fuel.mass_kg(injection.diameter_m, np.full(1, spec.fuel_temperature_K))
    cloud = _born(injection, each, spec, 0, 0, 0.0)
    time, steps, next_parcel, wall_kg = 0.0, 0, 0, 0.0
    rows: list[tuple[float, ...]] = []
    station, axes = Station(), np.array([hole.axis for hole in injection.holes])
    while time < spec.time_s * (1 - 1e-9):
        step = _step_s(spec, injection, flow, cloud, time)
        until = int(np.searchsorted(injection.time_s, time + step, side="left"))
        if len(cloud.mass_kg):
            moved, gain = move(cloud, flow, jets, liquid, time_s=time, step_s=step, random=random)
            station.watch(cloud, moved, fuel)
            cloud = moved
            flow.step(step, mass=gain.mass, enthalpy=gain.enthalpy, momentum=gain.momentum)
            inside = np.all(cloud.position_m > flow.box.origin_m, axis=1)
            inside &= np.all(cloud.position_m < flow.box.upper_m, axis=1)
            wall_kg += float(cloud.liquid_kg[~inside].sum())
            cloud = cloud.where(inside & (cloud.mass_kg > 0))
        time, steps = time + step, steps + 1
        cloud = cloud + _born(injection, each, spec, next_parcel, until, time)
        next_parcel = until
        injected = float(np.sum((each * injection.droplets)[:until]))
        if len(rows) < time / spec.time_s * _RECORDS or time >= spec.time_s * (1 - 1e-9):
            rows.append((time, injected, *measures(cloud, flow, fuel, axes)))
        if watch is not None:
            watch(time, spec.time_s, len(cloud.mass_kg))
    history = History(*np.array(rows).T)
    notes = {
        "injected_mass_kg": injected,
        "liquid_mass_kg": float(cloud.liquid_kg.sum()),
        "vapour_mass_kg": float(flow.fuel.sum() * flow.box.cell_m3),
        "wall_mass_kg": wall_kg,
        "parcels": float(len(cloud.mass_kg)),
        "sauter_mean_diameter_m": float(history.sauter_mean_diameter_m[-1]),
        "sauter_mean_diameter_at_15_mm_m": station.sauter_m,
        "liquid_penetration_m": float(history.liquid_m[-1]),
        "thin_liquid_penetration_m": float(history.thin_liquid_m[-1]),
        "vapour_penetration_m": float(history.vapour_m[-1]),
        "coldest_K": float(history.coldest_K[-1]),
        "jet_speed_m_s": injection.speed_m_s,
        "flow_coefficient": injection.flow_coefficient,
        "pressure_Pa": flow.pressure_Pa,
        "steps": float(steps),
        "grid_cells": float(np.prod(flow.box.shape)),
    }
    remarks: tuple[str, ...] = ()
    if wall_kg > 1e-3 * injected:
        remarks = (
            f"{100 * wall_kg / injected:.2g} % of the fuel left the gas box as liquid; increase "
            "spray.box.width_m and depth_m",
        )
    notes = {name: value for name, value in notes.items() if np.isfinite(value)}
    spray = Spray(
        parcels=_parcels(cloud, fuel), vapour=_vapour(flow, fuel), notes=notes, remarks=remarks
    )
    return spray, history, flow


def make_box(spec: LagrangianSpray, injection: Injection) -> FlowGrid:
    """Grid of the gas, as large as the plumes, with the injector's tip in the middle of its top.

    Raises SprayError if there are too many cells.
    """
    h = spec.box.spacing_m
    gas = spec.ambient.pressure_Pa * 0.028 / (8.314 * spec.ambient.temperature_K)
    below, beside = 5e-3, 5e-3
    for plume, hole in zip(spec.plumes, injection.holes, strict=True):
        if not hole.diameter_m > 0:
            continue
        half = np.radians(plume.cone_angle_deg / 2)
        area = np.pi / 4 * hole.diameter_m**2
        jet = Jet(
            rate_kg_s=area * injection.density_kg_m3 * injection.speed_m_s,
            speed_m_s=injection.speed_m_s,
            half_angle_rad=float(half),
            fuel_kg_m3=injection.density_kg_m3,
            gas_kg_m3=gas,
        )
        reach = 1.1 * jet.tip_m(spec.time_s) + 4e-3
        lean = np.radians(plume.inclination_deg)
        below = max(below, reach * float(np.cos(max(lean - half / 2, 0.0))))
        beside = max(beside, reach * float(np.sin(min(lean + half / 2, np.pi / 2))))
    width = spec.box.width_m or 2 * beside
    depth = spec.box.depth_m or below
    cells = np.array([width, width, depth + spec.box.above_m]) / h
    if np.prod(cells) > MOST_CELLS:
        least = h * float(np.prod(cells) / MOST_CELLS) ** (1 / 3)
        raise SprayError(
            f"spray.box.spacing_m: {h:g} gives {np.prod(cells):.3g} cells in a box of "
            f"{width:.3g} x {width:.3g} x {depth + spec.box.above_m:.3g} m; at least {least:.2g}"
        )
    across, high = (int(next_fast_len(max(8, int(np.ceil(n))), real=True)) for n in cells[1:])
    above = round(spec.box.above_m / h)
    origin = np.array([-0.5 * across * h, -0.5 * across * h, (above - high) * h])
    return FlowGrid(origin, h, (across, across, high))


def _step_s(
    spec: LagrangianSpray, injection: Injection, flow: GasFlow, cloud: FlyingParcels, time: float
) -> float:
    """Time step by the CFL number of the gas, in which parcels move by a cell at most."""
    fastest = float(np.abs(cloud.velocity_m_s).max(initial=0.0))
    if time < injection.end_s:
        fastest = max(fastest, injection.speed_m_s)
    free = flow.box.spacing_m / max(fastest, 1e-9)
    left = spec.time_s - time
    # Equal steps up to the end, since a very short last step would need large changes of the gas.
    return left / math.ceil(left / min(free, flow.longest_step_s(), LONGEST_STEP_S))


def _born(
    injection: Injection,
    each_kg: Floats,
    spec: LagrangianSpray,
    first: int,
    last: int,
    time_s: float,
) -> FlyingParcels:
    """Parcels that left the holes, at their positions at `time_s` after free flight."""
    new = slice(first, last)
    velocity = injection.velocity_m_s[new]
    flown = velocity * (time_s - injection.time_s[new])[:, None]
    return FlyingParcels(
        mass_kg=each_kg[new],
        temperature_K=np.full(last - first, spec.fuel_temperature_K),
        droplets=injection.droplets[new],
        hole=injection.hole[new],
        position_m=injection.position_m[new] + flown,
        velocity_m_s=velocity,
    )


def _parcels(cloud: FlyingParcels, fuel: Fuel) -> Parcels | None:
    diameter = fuel.diameter_m(cloud.mass_kg, cloud.temperature_K)
    seen = diameter >= 1e-8
    if not seen.any():
        return None
    return Parcels(
        position_m=cloud.position_m[seen],
        diameter_m=diameter[seen],
        droplets=cloud.droplets[seen],
        temperature_K=cloud.temperature_K[seen],
        density_kg_m3=fuel.liquid.one("density", cloud.temperature_K[seen]),
    )


def _vapour(flow: GasFlow, fuel: Fuel) -> Vapour | None:
    index = np.flatnonzero(flow.share >= NEGLIGIBLE)
    if not index.size:
        return None
    box = flow.box
    spacing = np.full(3, box.spacing_m)
    return Vapour(
        cells=Cells.regular(origin_m=box.origin_m, spacing_m=spacing, shape=box.shape, index=index),
        number_density_m3=flow.fuel.reshape(-1)[index] * (_AVOGADRO / fuel.molar_mass_kg_mol),
        temperature_K=flow.temperature_K.reshape(-1)[index],
        molar_mass_kg_mol=fuel.molar_mass_kg_mol,
    )
