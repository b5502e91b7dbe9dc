"""History of one droplet in a large volume of gas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.io.text_tables import csv_text
from cldit.spray.droplet.advance import DropletStates, DropletSurroundings, advance
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import check_conditions, fuel_table, gas_table
from cldit.spray.droplet.models import MODELS
from cldit.spray.sizes import FREE_DROP_M

COLUMNS = ("time_s", "diameter_m", "temperature_K", "velocity_m_s", "mass_kg")
SMALLEST_M = 1e-8  # the mean free path is larger
LONGEST_S = 1e5


@dataclass(frozen=True)
class Life:
    """Columns (M,) over time, up to the end of the droplet or of the given duration."""

    time_s: Floats
    diameter_m: Floats
    temperature_K: Floats
    velocity_m_s: Floats
    mass_kg: Floats

    @property
    def vanished(self) -> bool:
        """True if the droplet has vanished at the end."""
        return bool(self.mass_kg[-1] == 0)

    def rows(self) -> Iterator[tuple[float, ...]]:
        """Rows, one for each time, in the order of `COLUMNS`."""
        columns = (getattr(self, name).tolist() for name in COLUMNS)
        return zip(*columns, strict=True)

    def csv(self) -> str:
        """CSV with a header, one row for each time."""
        return csv_text(COLUMNS, ([f"{value:.9g}" for value in row] for row in self.rows()))


def follow(
    *,
    fuel: str,
    diameter_m: float,
    temperature_K: float,
    gas_temperature_K: float,
    pressure_Pa: float,
    device: Device,
    velocity_m_s: float = 0.0,
    model: str = "abramzon-sirignano",
    gas: str = "nitrogen",
    vapour: float = 0.0,
    held: bool = False,
    duration_s: float | None = None,
    points: int = 201,
    tolerance: float = 1e-4,
    cache: Path | None = None,
) -> Life:
    """History of one droplet from its injection until it vanishes.

    Args:
        fuel, gas: names of the fuel and of the carrier gas.
        diameter_m, temperature_K: initial values of the droplet.
        gas_temperature_K, pressure_Pa: of the gas.
        device: which computes, in double precision.
        velocity_m_s: relative to the gas.
        model: a key of `models.MODELS`.
        vapour: mass fraction of fuel in the gas.
        held: the velocity is constant (on a fibre in a flow), else drag brings the droplet to rest.
        duration_s: earlier end; necessary if the droplet never vanishes.
        points: number of equidistant times.
        tolerance: allowed error of a step.
        cache: folder for property tables; None: no cache.

    Raises:
        SprayError: an impossible value, an unknown fuel, gas or model, or no end.
        DeviceError: the device has no double precision.
    """
    _check(diameter_m=diameter_m, velocity_m_s=velocity_m_s, vapour=vapour, model=model)
    _check_finite((temperature_K, gas_temperature_K, pressure_Pa), duration_s)
    liquid, carrier = fuel_table(fuel, cache=cache), gas_table(gas, cache=cache)
    check_conditions(
        liquid, temperature_K=temperature_K, gas_K=gas_temperature_K, pressure_Pa=pressure_Pa
    )
    start = DropletStates(
        liquid.mass_kg([diameter_m], [temperature_K]),
        np.array([temperature_K]),
        np.array([[velocity_m_s]]),
    )
    surroundings = DropletSurroundings(
        np.array([gas_temperature_K]),
        np.array([pressure_Pa]),
        np.array([vapour]),
        np.zeros((1, 1)),
    )
    kernels = DropletKernels.of(device, liquid, carrier, MODELS[model])
    return _life(
        start, surroundings, kernels, held=held, duration_s=duration_s, points=points,
        tolerance=tolerance,
    )  # fmt: skip


def _life(
    start: DropletStates,
    surroundings: DropletSurroundings,
    kernels: DropletKernels,
    *,
    held: bool,
    duration_s: float | None,
    points: int,
    tolerance: float,
) -> Life:
    """Equidistant times until the droplet vanishes or the duration ends, and its state at each."""

    def advanced(state: DropletStates, seconds: float) -> tuple[DropletStates, float]:
        result = advance(state, surroundings, seconds, kernels, tolerance=tolerance, drag=not held)
        return result.droplets, float(result.gone_s[0])

    life = advanced(start, LONGEST_S if duration_s is None else duration_s)[1]
    if duration_s is None and np.isinf(life):
        raise SprayError(
            f"a droplet of {kernels.fuel.name} does not vanish in gas of "
            f"{surroundings.temperature_K[0]:g} K with {surroundings.vapour[0]:g} vapour within "
            f"{LONGEST_S:g} s; give a duration"
        )
    end = life if duration_s is None else min(life, duration_s)
    times = np.linspace(0.0, end, points)
    states = [start]
    for step in np.diff(times):
        states.append(advanced(states[-1], float(step))[0])
    mass = np.array([state.mass_kg[0] for state in states])
    if life <= end:
        mass[-1] = 0.0  # by definition of the last time, which steps reach within the tolerance
    warm = np.array([state.temperature_K[0] for state in states])
    return Life(
        time_s=times,
        diameter_m=kernels.fuel.diameter_m(mass, warm),
        temperature_K=warm,
        velocity_m_s=np.array([state.velocity_m_s[0, 0] for state in states]),
        mass_kg=mass,
    )


def _check_finite(numbers: tuple[float, ...], duration_s: float | None) -> None:
    if not np.all(np.isfinite(numbers)):
        raise SprayError(f"temperatures and pressure of a droplet: {numbers}; must be finite")
    if duration_s is not None and not 0 < duration_s <= LONGEST_S:
        raise SprayError(f"duration {duration_s:g} s; allowed: above 0 to {LONGEST_S:g} s")


def _check(*, diameter_m: float, velocity_m_s: float, vapour: float, model: str) -> None:
    if not SMALLEST_M <= diameter_m <= FREE_DROP_M:
        raise SprayError(
            f"diameter {diameter_m * 1e6:g} um; allowed: {SMALLEST_M * 1e6:g} to "
            f"{FREE_DROP_M * 1e6:g} um (check the unit)"
        )
    if not abs(velocity_m_s) <= 1000:
        raise SprayError(f"velocity {velocity_m_s:g} m/s; allowed: -1000 to 1000 m/s")
    if not 0 <= vapour < 1:
        raise SprayError(f"vapour mass fraction {vapour:g}; allowed: 0 to below 1")
    if model not in MODELS:
        raise SprayError(f"model {model!r}; allowed: {', '.join(MODELS)}")
