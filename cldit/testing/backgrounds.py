"""Contract of backgrounds, and a session with one."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from cldit.rig.errors import DeviceTimeout, OutOfLimits
from cldit.rig.protocols import Background, Stability
from cldit.testing.bed import Step
from cldit.testing.expect import AGREE_K, Allowed, Check, NotAllowed, expect, near, refuses

_RISE_K = 20.0
HOT_K = 420.0
_RULE = Stability(tolerance_K=0.5, hold_s=10.0, settle_s=5.0, timeout_s=3600.0)


def limits(background: Background, allowed: Allowed) -> None:
    """Checks that set points at the limits are accepted, and that those outside change nothing."""
    can = background.limits
    stored = background.read_configuration()
    for outside in (can.low_K - 1.0, can.high_K + 1.0, math.nan, math.inf):
        call = f"set_setpoint({outside:g})"
        refuses(partial(background.set_setpoint, outside), OutOfLimits, call)
    expect(background.read_configuration() == stored, "a rejected set point changed something")
    for inside in (can.high_K, can.low_K):  # it ends cold
        if inside <= allowed.warmest_K:
            near(background.set_setpoint(inside), inside, AGREE_K, "set point [K]")


def settles(background: Background, allowed: Allowed) -> None:
    """Checks that `wait_stable` returns at stability, not before, and that it times out.

    Raises NotAllowed if heating by 5 K is not allowed.
    """
    start_K = background.read_temperature()
    wanted_K = min(start_K + _RISE_K, background.limits.high_K, allowed.warmest_K)
    if wanted_K < max(start_K + 5.0, background.limits.low_K):
        raise NotAllowed(
            f"needs a set point 5 K above {start_K:.1f} K; allowed: {allowed.warmest_K:.1f} K"
        )
    background.set_setpoint(wanted_K)
    begun_K = background.read_temperature()  # an emulator may reach its set point at once
    if abs(begun_K - wanted_K) > _RULE.tolerance_K:
        expect(background.is_stable() in (False, None), "is_stable() before it can be")
    seen: list[float] = []
    got_K = background.wait_stable(wanted_K, _RULE, on_progress=seen.append)
    near(got_K, wanted_K, _RULE.tolerance_K, "wait_stable() [K]")
    expect(background.is_stable() in (True, None), "not is_stable() when it is")
    late = [K for K in seen[-15:] if abs(K - wanted_K) > _RULE.tolerance_K]
    expect(not late, f"{late} K within the last 15 s")
    soon = Stability(tolerance_K=0.5, hold_s=10.0, settle_s=5.0, timeout_s=20.0)
    refuses(lambda: background.wait_stable(wanted_K + 50.0, soon), DeviceTimeout, "a wait for it")


BACKGROUND = [
    Check("limits", "sets its lowest set point, if that is allowed", limits),
    Check("settles", "warms it by 5 to 20 K, if that is allowed", settles),
]


@dataclass(frozen=True)
class BackgroundSide:
    """State of an emulated black body.

    stored: content of read_configuration() besides the set point. stable: its own flag, if any.
    """

    setpoint_K: Callable[[], float]
    temperature_K: Callable[[], float]
    stable: Callable[[], bool | None] = lambda: None
    stored: Callable[[], Mapping[str, Any]] = dict


def hot_K(background: Background) -> float:
    """Set point of a session: 420 K, or the upper limit if that is lower."""
    return min(HOT_K, background.limits.high_K)


def background_steps(device: Background, side: BackgroundSide | None = None) -> list[Step]:
    """Session with a black body; without `side` its emulator's state is not compared."""
    wanted_K = hot_K(device)

    def agree(got_K: float, right_K: float) -> bool:
        return bool(abs(got_K - right_K) < AGREE_K)

    def configuration(stored: dict[str, Any]) -> bool:
        return side is None or (
            agree(stored["setpoint_K"], side.setpoint_K())
            and all(stored[name] == value for name, value in side.stored().items())
        )

    def temperature(got_K: float) -> bool:
        return side is None or agree(got_K, side.temperature_K())

    def stable(got: bool | None) -> bool:
        return side is None or got is side.stable()

    return [
        Step("configuration", device.read_configuration, configuration),
        Step("set point", lambda: device.set_setpoint(wanted_K), lambda got: agree(got, wanted_K)),
        Step("temperature", device.read_temperature, temperature),
        Step("stable", device.is_stable, stable),
        Step("temperature again", device.read_temperature, temperature),
        Step("configuration again", device.read_configuration, configuration),
    ]
