"""Parcels of droplets on a device, and their exchange with the gas.

What a parcel gives goes to its cell in fixed point (kernels/spray/parcels.cl), and is spread before
the gas receives it: across the rays over the extent of its droplets (`SPOT`), along them over its
flight in the step. So finer cells do not resolve single parcels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats, Reals
from cldit.errors import SprayError
from cldit.gpu.buffers import clear, download, upload, zeros
from cldit.gpu.fixed_point import fixed_point_defines, fixed_point_scale, fixed_point_sums
from cldit.gpu.program import Define, build
from cldit.scene.spray import LagrangianSpray
from cldit.spray.droplet.advance import GAS_TOLERANCE
from cldit.spray.droplet.fluids import Fuel, Gas, property_table
from cldit.spray.droplet.models import MODELS, inert
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.injector import Injection
from cldit.spray.flow.ray_fields import GROUP

SPOT = 0.02  # standard deviation of a parcel's droplets, over the distance from the tip
REACH_m = 1e-3  # that a parcel flies in a step: jets change over several
NEAR_m = 10e-3  # distance up to which it flies as fast
STATION_m = 15e-3  # below the injector, where the ECN measures droplets

_EXCHANGED, _GIVEN = 8, 5  # planes of sums
# Bounds of the sums in terms of the injected mass: coefficients reach some hundred times the mass
# where droplets are small and boil.
_MOST_EXCHANGED, _MOST_J_kg, _HOTTEST_K = 1e6, 1e7, 1e4


@dataclass(frozen=True)
class FlyingParcels:
    """Parcels in flight.

    mass_kg, temperature_K: of one droplet, (N,). droplets: (N,). position_m, velocity_m_s:
    (N, 3).
    """

    mass_kg: Floats
    temperature_K: Floats
    droplets: Floats
    position_m: Floats
    velocity_m_s: Floats

    @property
    def liquid_kg(self) -> Floats:
        """Liquid mass of each parcel (N,)."""
        return self.mass_kg * self.droplets


class Cloud:
    """All parcels of an injection, in the order of their birth; numbers are in single precision."""

    def __init__(
        self,
        spec: LagrangianSpray,
        injection: Injection,
        flow: GasFlow,
        *,
        fuel: Fuel,
        carrier: Gas,
    ) -> None:
        self.flow, self.device, self._injection = flow, flow.device, injection
        fields = flow.fields
        self._width = fields.simd_width
        count = len(injection.time_s)
        packet = self._width * GROUP
        self.capacity = -(-max(count, 1) // packet) * packet
        self.born, self.number = 0, 0
        hot_K = np.full(count, spec.fuel_temperature_K)
        self._each_kg = fuel.mass_kg(injection.diameter_m, hot_K)
        state, droplets, birth = self._initial(spec.fuel_temperature_K)
        self.state = upload(self.device, "parcels", state.reshape(-1))
        exchanged, released, crossed = self._bounds()
        self._total_scales = [fixed_point_scale(bound) for bound in crossed]
        exchange_scales, exchange_units = self._scales(exchanged)
        scales, units = self._scales(released)
        self._sums = zeros(self.device, "sums", _EXCHANGED * fields.cells, np.int64)
        self._totals = zeros(self.device, "totals", 3, np.int64)
        self._failed = zeros(self.device, "failed", 1, np.int32)
        self._exchange = fields.plane("exchange of parcels", _EXCHANGED)
        shared = self._arguments(spec, property_table(fuel, carrier), droplets, birth)
        defines: dict[str, Define] = {
            "SIMD_WIDTH": self._width,
            "EVAPORATION": MODELS.get(spec.evaporation, inert).function,
            "GAS_REAL": "double" if fields.real is np.float64 else "float",
            **fixed_point_defines(self.device),
        }
        self._program = build(self.device, "spray/parcels.cl", defines)

        def bind(kernel: str, items: int = GROUP, **extra: Any) -> Any:
            available = {**shared, **extra}
            names = self._program.takes(kernel)
            arguments = {name: available[name] for name in names}
            return self._program.bind(kernel, (items,), (GROUP,), arguments)

        self._pack_gas, self._pack_exchange = (
            bind(kernel, fields.cells) for kernel in ("pack_gas", "pack_exchange")
        )
        self._add_exchange = bind("add_exchange", scales=exchange_scales)
        self._move = bind("move", scales=scales)
        self._give_birth = bind("give_birth")
        self._exchanged, self._released = self._receipts(shared, exchange_units, units)

    def _arguments(
        self, spec: LagrangianSpray, properties: Floats, droplets: Reals, birth: Reals
    ) -> dict[str, Any]:
        """Arguments of the kernels by name, those of the gas included."""
        flow, fields = self.flow, self.flow.fields
        return {
            **flow.arguments,
            **fields.places(),
            "state": self.state,
            "droplets": upload(self.device, "droplets", droplets),
            "birth": upload(self.device, "birth", birth),
            "properties": self._single("properties", properties),
            "sums": self._sums,
            "exchange": self._exchange,
            "packed_gas": zeros(self.device, "packed gas", 8 * fields.cells, np.float32),
            "packed_exchange": zeros(self.device, "packed sums", 8 * fields.cells, np.float32),
            "totals": self._totals,
            "total_scales": self._single("scales of totals", np.array(self._total_scales)),
            "failed": self._failed,
            "capacity": self.capacity,
            "tolerance": GAS_TOLERANCE,
            "zero_enthalpy": flow.mixture.zero_J_kg,
            "station": -STATION_m,
            "seed": spec.seed,
            "copies": flow.grid.copies,
            "born": 0,
            "number": 0,
            "time": 0.0,
            "first": 0,
            "last": 0,
        }

    def _initial(self, fuel_K: float) -> tuple[Reals, Reals, Reals]:
        """State (8, capacity), droplets and birth (capacity,) of the parcels; zeros beyond them."""
        injection, count = self._injection, len(self._injection.time_s)
        state = np.zeros((8, self.capacity), np.float32)
        state[0, :count], state[1] = self._each_kg, fuel_K
        state[2:5, :count], state[5:8, :count] = injection.velocity_m_s.T, injection.position_m.T
        droplets = np.zeros(self.capacity, np.float32)
        droplets[:count] = injection.droplets
        birth = np.zeros(self.capacity, np.float32)
        birth[:count] = injection.time_s
        return state, droplets, birth

    def _bounds(self) -> tuple[Floats, Floats, list[float]]:
        """Bounds of the sums in fixed point: exchange with the gas, amounts that the parcels
        release to it, and totals of the parcels that cross the station."""
        injection = self._injection
        mass_kg = float(self._each_kg @ injection.droplets) or 1.0
        speed = 4 * injection.speed_m_s
        exchanged = np.full(_EXCHANGED, _MOST_EXCHANGED * mass_kg)
        exchanged[1:4] *= speed
        exchanged[5] *= _HOTTEST_K
        released = mass_kg * np.array([1.0, _MOST_J_kg, speed, speed, speed])
        areas = float(injection.diameter_m**2 @ injection.droplets) or 1.0
        return exchanged, released, [2 * mass_kg, 4 * areas, 4e-3 * areas]

    def _receipts(
        self, shared: dict[str, Any], exchange_units: Any, units: Any
    ) -> tuple[list[Any], list[Any]]:
        """Kernels that convert the sums of exchange and of amounts to fields, and spread them."""
        flow, fields, grid = self.flow, self.flow.fields, self.flow.grid
        spread = [self._extent(axis) for axis in (1, 0)]
        volume = fields.plane("volume", value=1.0)
        fields.write(volume, grid.volume_m3)
        still, along = fields.plane("still", 3), fields.plane("along", 2)
        dr_m = np.diff(grid.radius_m)
        half_m2 = (dr_m**2 + REACH_m**2 * np.minimum(1.0, NEAR_m / grid.middle[2]) ** 2) / 24
        between_m2 = np.concatenate([[0.0], np.minimum(half_m2[1:], half_m2[:-1])])
        fields.write(along, grid.angle[:, :, None] * grid.conductance[2] * between_m2, 1)

        def receive(target: Any, planes: int, unit: Any) -> list[Any]:
            as_fields = fields.bind(
                "spray/gas_receipt.cl", "as_fields", shared, kinds=planes, fields=target, units=unit
            )
            mixed = flow.mixing.launches(
                target,
                planes,
                mass=volume,
                flux=still,
                exchange=(spread[0], spread[1]),
                factor=1.0,
            )
            radial = flow.mixing.along(target, planes, mass=volume, flux=still, diffusions=along)
            return [as_fields, *mixed, radial]

        exchange = receive(self._exchange, _EXCHANGED, exchange_units)
        return exchange, receive(flow.amounts, _GIVEN, units)

    def _single(self, name: str, values: Floats) -> Any:
        return upload(self.device, name, np.asarray(values, np.float32).reshape(-1))

    def _scales(self, bounds: Floats) -> tuple[Any, Any]:
        """Buffers of the scales for these bounds, and of the gas's units."""
        scales = np.array([fixed_point_scale(float(bound)) for bound in bounds])
        return self._single("scales", scales), self.flow.fields.table("units", 1 / scales)

    def _extent(self, axis: int) -> Any:
        """Plane of half of the variance by which to spread along an axis, in m2."""
        fields, grid = self.flow.fields, self.flow.grid
        polar, radius = grid.middle[1:]
        wide = np.diff(grid.azimuth)[:, None] * np.sin(polar)
        size = np.broadcast_to(wide if axis == 0 else np.diff(grid.polar), grid.shape[:2])
        # A parcel's place in its cell has a variance of 1/12; linear weights have 1/6.
        half = 0.5 * (np.maximum(SPOT**2, size**2 / 6) - size**2 / 12)
        plane = fields.plane("extent")
        fields.write(plane, half[:, :, None] * radius**2)
        return plane

    def step(self, step_s: float) -> bool:
        """Moves the parcels that were born, and sets the sources of the gas, `flow.amounts`; False
        if there are none, so that the gas is at rest."""
        if not self.born:
            return False
        fields = self.flow.fields
        size = (-(-self.born // (self._width * GROUP)) * GROUP,)
        self._pack_gas()
        clear(self.device, self._sums, _EXCHANGED * fields.cells, np.int64)
        self._add_exchange.resized(size)(step=step_s, born=self.born)
        for launch in self._exchanged:
            launch()
        self._pack_exchange()
        clear(self.device, self._sums, _GIVEN * fields.cells, np.int64)
        self._move.resized(size)(step=step_s, born=self.born, number=self.number)
        for launch in self._released:
            launch()
        self.number += 1
        return True

    def give_birth(self, time_s: float) -> None:
        """Adds the parcels that left their holes before the time."""
        until = int(np.searchsorted(self._injection.time_s, time_s, side="left"))
        if until > self.born:
            count = -(-(until - self.born) // GROUP) * GROUP
            launch = self._give_birth.resized((count,))
            launch(time=time_s, first=self.born, last=until)
            self.born = until

    def check(self) -> None:
        """Raises SprayError if a droplet could not be integrated; reads from the device."""
        failed = int(download(self.device, self._failed, np.empty(1, np.int32))[0])
        if failed:
            raise SprayError(f"{failed} steps of droplets could not be integrated")

    def read(self) -> FlyingParcels:
        """Parcels that were born and have not vanished."""
        shape = (8, self.capacity)
        state = download(self.device, self.state, np.empty(shape, np.float32))[:, : self.born]
        state = state.astype(np.float64)
        flying = state[0] > 0
        injection, born = self._injection, self.born
        return FlyingParcels(
            mass_kg=state[0, flying],
            temperature_K=state[1, flying],
            droplets=injection.droplets[:born][flying].astype(np.float32).astype(np.float64),
            velocity_m_s=state[2:5, flying].T.copy(),
            position_m=state[5:8, flying].T.copy(),
        )

    @property
    def injected_kg(self) -> float:
        """Fuel that has left the holes."""
        return float(self._each_kg[: self.born] @ self._injection.droplets[: self.born])

    @property
    def wall_kg(self) -> float:
        """Liquid that has reached a wall."""
        return self._total(0)

    @property
    def station_sauter_m(self) -> float:
        """Sauter mean diameter of the droplets that have crossed `STATION_m`; NaN without any."""
        area = self._total(1)
        return self._total(2) / area if area > 0 else float("nan")

    def _total(self, number: int) -> float:
        scale = self._total_scales[number]
        return float(fixed_point_sums(self.device, self._totals, 3, scale)[number])

    def fastest_m_s(self) -> float:
        """Speed of the fastest parcel; reads from the device."""
        velocity = self.read().velocity_m_s
        return float(np.linalg.norm(velocity, axis=1).max(initial=0.0))
