"""The `lagrangian` spray: time integration of parcels and gas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.scene.spray import LagrangianSpray
from cldit.spray.droplet.fluids import Fuel, check_conditions, check_gas, fuel_table, gas_table
from cldit.spray.flow.gas import GasFlow, UnstableGas
from cldit.spray.flow.gas_jets import GasJets, inject_gas
from cldit.spray.flow.injector import inject
from cldit.spray.flow.measures import VAPOUR_SHARE, History, measures
from cldit.spray.flow.mixture import gas_mixture
from cldit.spray.flow.parcels import Cloud, FlyingParcels, REACH_m
from cldit.spray.flow.ray_choice import DEPTH_KEY, domain_time_s, ray_grid
from cldit.spray.flow.sampled import sampled
from cldit.spray.result import Parcels, Spray

LONGEST_STEP_S = 2e-5
CELLS_A_STEP = 1.2  # parcels' cells of the scene's spacing in a step of the gas
MOST_GAS_STEPS = 32  # of a step of the parcels
SLACK = 1.5  # of the speed of the gas over that of the liquid; a lump of parcels overshoots
_CHECKED = 16  # steps between two looks at the state
_REMARKED = 1e-3  # share of the fuel that has left the gas, or is beside its walls


Watch = Callable[[float, float, int], None]  # time, end time, number of parcels
Result = tuple[Spray, History, GasFlow]


def simulate_spray(
    spec: LagrangianSpray,
    device: Device,
    *,
    cache: Path | None = None,
    watch: Watch | None = None,
) -> Result:
    """Computes the spray at `spec.time_s`, its history, and the gas.

    `notes` of the spray: injected, liquid, vapour and wall mass (kg), parcels, steps, cells, speed
    at the hole, flow coefficient, Sauter mean diameter (of all present droplets, and of those that
    crossed the plane 15 mm below the injector), penetrations, coldest gas, pressure.

    Args:
        spec: the scene's spray.
        device: computes parcels and gas.
        cache: folder for property tables.
        watch: called after every step.

    Raises:
        SprayError: an impossible combination of values, or a flow that cannot be computed.
    """
    times_s = (spec.time_s,)
    return next(simulate_times(spec, times_s, device, cache=cache, watch=watch, records=100))


def simulate_times(
    spec: LagrangianSpray,
    times_s: tuple[float, ...],
    device: Device,
    *,
    cache: Path | None = None,
    watch: Watch | None = None,
    records: int = 0,
) -> Iterator[Result]:
    """The spray at increasing `times_s`, from one integration for each size of the domain.

    A step ends at each of the times, so a later result depends on them by the error of the steps.
    The history has so many `records`, and those of the results. Raises as `simulate_spray`.
    """
    spaces = groupby(
        times_s, lambda time_s: domain_time_s(spec.model_copy(update={"time_s": time_s}))
    )
    for _, group in spaces:
        times, gas_steps = tuple(group), 0
        done = 0
        while done < len(times):
            final = spec.model_copy(update={"time_s": times[-1]})
            state = _State(final, device, cache, records, gas_steps)
            try:
                for number, time_s in enumerate(times):
                    state.until(time_s, watch)
                    if number < done:  # its result preceded the restart
                        state.record()
                        continue
                    result = state.result()  # may raise: not done before
                    done += 1
                    yield result
            except UnstableGas:
                # Lumps of few parcels need shorter steps of the gas.
                gas_steps = 2 * state.gas_steps
                if gas_steps > MOST_GAS_STEPS:
                    raise


class _State:
    """Parcels and gas, and what is counted of them."""

    def __init__(
        self,
        spec: LagrangianSpray,
        device: Device,
        cache: Path | None,
        records: int,
        gas_steps: int = 0,
    ) -> None:
        self.spec, self.records = spec, records
        self.fuel, carrier = fuel_table(spec.fuel, cache=cache), gas_table(spec.gas, cache=cache)
        ambient = spec.ambient
        _check(spec, self.fuel)
        if spec.droplets is None:
            self.injection, jet = inject_gas(spec, self.fuel)
        else:
            self.injection, jet = inject(spec, self.fuel), None
        self.flow = GasFlow(
            ray_grid(spec, self.injection, gas_kg_mol=carrier.molar_mass_kg_mol),
            gas_mixture(self.fuel, carrier, reference_K=ambient.temperature_K),
            pressure_Pa=ambient.pressure_Pa,
            temperature_K=ambient.temperature_K,
            device=device,
            mixing_length=spec.mixing_length,
            fastest_m_s=SLACK * self.injection.speed_m_s,
            jet_speed_m_s=0.0 if jet is None else jet.speed_m_s,
        )
        self.cloud: Cloud | GasJets
        if jet is None:
            self.cloud = Cloud(spec, self.injection, self.flow, fuel=self.fuel, carrier=carrier)
        else:
            self.cloud = GasJets(spec, self.injection, jet, self.flow)
        # A gas step takes no parcel farther than a cell where cells have the scene's spacing.
        steps = math.ceil(CELLS_A_STEP * REACH_m / spec.box.cell_m)
        # Near the tip cells are shorter, and the gas's divergence is a step late: at least two.
        # A source of gas, `REACH_m` long, moves by a third of it.
        fewest = 2 if jet is None else 3
        self.gas_steps = gas_steps or max(fewest, steps)
        self.time_s, self.steps, self._fastest_m_s = 0.0, 0, self.injection.speed_m_s
        self.rows: list[tuple[float, ...]] = []

    def longest_step_s(self) -> float:
        """Time step in which the parcels fly by `REACH_m` at most: that of the injection's speed,
        doubled when they are half as fast, so that it is the same on different grids.

        After the injection it reads the parcels, every `_CHECKED` steps.
        """
        step_s = REACH_m / self.injection.speed_m_s
        if self.time_s < self.injection.end_s:
            return min(step_s, LONGEST_STEP_S)
        if self.steps % _CHECKED == 0:
            self._fastest_m_s = self.cloud.fastest_m_s()
        doubled = math.floor(math.log2(self.injection.speed_m_s / max(self._fastest_m_s, 1e-9)))
        return min(step_s * 2.0 ** max(doubled, 0), LONGEST_STEP_S)

    def until(self, time_s: float, watch: Watch | None) -> None:
        """Advances to a time."""
        while time_s > self.time_s + 1.5 * (step_s := self.longest_step_s()):
            self.step(step_s)
            if watch is not None:
                watch(self.time_s, self.spec.time_s, self.cloud.born)
        # It is at least half as long as the others: a very short one would need large changes of
        # the gas.
        self.step(time_s - self.time_s)

    def step(self, step_s: float) -> None:
        """Advances parcels and gas."""
        if self.cloud.step(step_s):
            self.flow.step(step_s, steps=self.gas_steps)
        self.time_s, self.steps = self.time_s + step_s, self.steps + 1
        self.cloud.give_birth(self.time_s)
        if self.steps % _CHECKED == 0:
            self.flow.check()
            self.cloud.check()
        if len(self.rows) < self.time_s / self.spec.time_s * self.records:
            self.record()

    def record(self) -> None:
        """Adds a row to the history."""
        if self.rows and self.rows[-1][0] == self.time_s:
            return
        measured = measures(self.cloud.read(), self.flow, self.fuel, self.injection.axes)
        self.rows.append((self.time_s, self.cloud.injected_kg, *measured))

    def result(self) -> Result:
        """The spray, its history, and the gas."""
        self.flow.check()
        self.cloud.check()
        self.record()
        spec, flow, fuel = self.spec, self.flow, self.fuel
        cloud = self.cloud.read()
        history = History(*np.array(self.rows).T)
        injected, wall_kg = self.cloud.injected_kg, self.cloud.wall_kg
        notes = {
            "injected_mass_kg": injected,
            "liquid_mass_kg": float(cloud.liquid_kg.sum()),
            "vapour_mass_kg": flow.fuel_kg,
            "wall_mass_kg": wall_kg,
            "parcels": float(len(cloud.mass_kg)),
            "sauter_mean_diameter_m": float(history.sauter_mean_diameter_m[-1]),
            "sauter_mean_diameter_at_15_mm_m": self.cloud.station_sauter_m,
            "liquid_penetration_m": float(history.liquid_m[-1]),
            "thin_liquid_penetration_m": float(history.thin_liquid_m[-1]),
            "vapour_penetration_m": float(history.vapour_m[-1]),
            "coldest_K": float(history.coldest_K[-1]),
            "jet_speed_m_s": self.injection.speed_m_s,
            "flow_coefficient": self.injection.flow_coefficient,
            "pressure_Pa": flow.pressure_Pa,
            "steps": float(self.steps),
            "gas_spacing_m": spec.box.cell_m,
            "equal_plumes": float(max(flow.grid.symmetry, 1)),
            "grid_cells": float(np.prod(flow.grid.shape)),
        }
        remarks = _hot_liquid(cloud, fuel)
        share, vapour = flow.read("share"), flow.read("fuel")
        if wall_kg > _REMARKED * injected:
            remarks += (
                f"{100 * wall_kg / injected:.2g} % of the fuel left the gas as liquid, at its wall "
                f"of {flow.grid.radius_m[-1]:.3g} m or beside it; allowed: a larger "
                f"{DEPTH_KEY}, or smaller inclinations",
            )
        elif share[:, :, -1].max() >= VAPOUR_SHARE:
            remarks += (
                f"vapour has reached the wall of the gas, {flow.grid.radius_m[-1]:.3g} m from the "
                f"tip; allowed: a larger {DEPTH_KEY}",
            )
        beside = flow.grid.beside(vapour * flow.grid.volume_m3) / max(injected, 1e-300)
        if beside > _REMARKED:
            remarks += (
                f"{100 * beside:.2g} % of the fuel is vapour beside the walls of the gas, behind "
                "the plumes; allowed: smaller inclinations",
            )
        notes = {name: value for name, value in notes.items() if np.isfinite(value)}
        parcels, lattice = _parcels(cloud, fuel), sampled(flow, fuel)
        return Spray(parcels=parcels, vapour=lattice, notes=notes, remarks=remarks), history, flow


def _check(spec: LagrangianSpray, fuel: Fuel) -> None:
    ambient, hot_K = spec.ambient, spec.fuel_temperature_K
    ambient_key = "spray.ambient."
    names = f"{ambient_key}temperature_K", f"{ambient_key}pressure_Pa"
    conditions = {"gas_K": ambient.temperature_K, "pressure_Pa": ambient.pressure_Pa}
    if spec.droplets is None:
        check_gas(fuel, **conditions, names=names)
        return
    check_conditions(
        fuel, temperature_K=hot_K, **conditions, names=("spray.fuel_temperature_K", *names)
    )
    boiling_K = float(fuel.boiling_K(ambient.pressure_Pa))
    if spec.evaporation != "none" and hot_K >= boiling_K:
        raise SprayError(
            f"spray.fuel_temperature_K {hot_K:g} K: {fuel.name} boils at {boiling_K:.1f} K and "
            f"{ambient_key}pressure_Pa {ambient.pressure_Pa:g}, and flash boiling is not computed; "
            f"allowed: below {boiling_K:.1f} K"
        )


def _hot_liquid(cloud: FlyingParcels, fuel: Fuel) -> tuple[str, ...]:
    """Remark on droplets as hot as the end of their properties."""
    hot = cloud.temperature_K >= fuel.liquid.high_K - 0.5
    if not hot.any():
        return ()
    share = float(cloud.liquid_kg[hot].sum() / cloud.liquid_kg.sum())
    return (
        f"{100 * share:.2g} % of the liquid is at {fuel.liquid.high_K:.1f} K, where its properties "
        f"end below the critical temperature of {fuel.name}, {fuel.critical_K:.1f} K; it is not "
        "heated further",
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
        density_kg_m3=fuel.liquid.value("density", cloud.temperature_K[seen]),
        velocity_m_s=cloud.velocity_m_s[seen],
    )
