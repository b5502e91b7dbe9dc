"""Contract of backgrounds."""

from __future__ import annotations

import math

from cldit.rig.errors import DeviceTimeout, OutOfLimits
from cldit.rig.protocols import Background, Stability
from cldit.testing.expect import Allowed, Check, NotAllowed, expect, near, refuses

_RISE_K = 20.0
_AGREE_K = 0.1
_RULE = Stability(tolerance_K=0.5, hold_s=10.0, settle_s=5.0, timeout_s=3600.0)


def limits(background: Background, allowed: Allowed) -> None:
    """Checks that set points at the limits are accepted, and that those outside change nothing."""
    can = background.limits
    before = background.read_configuration()
    for outside in (can.low_K - 1.0, can.high_K + 1.0, math.nan, math.inf):
        what = f"set_setpoint({outside:g})"
        refuses(lambda K=outside: background.set_setpoint(K), OutOfLimits, what)  # type: ignore[misc]
    expect(background.read_configuration() == before, "a rejected set point changed something")
    for inside in (can.low_K, can.high_K):
        if inside <= allowed.warmest_K:
            near(background.set_setpoint(inside), inside, _AGREE_K, "set point [K]")


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
    expect(background.is_stable() in (False, None), "is_stable() before it can be")
    seen: list[float] = []
    got_K = background.wait_stable(wanted_K, _RULE, on_progress=seen.append)
    near(got_K, wanted_K, _RULE.tolerance_K, "wait_stable() [K]")
    expect(background.is_stable() in (True, None), "not is_stable() when it is")
    expect(seen[0] < wanted_K - 0.5 * (wanted_K - start_K), f"the first reading is {seen[0]:g} K")
    late = [K for K in seen[-15:] if abs(K - wanted_K) > _RULE.tolerance_K]
    expect(not late, f"{late} K within the last 15 s")
    soon = Stability(0.5, 10.0, 5.0, 20.0)
    refuses(lambda: background.wait_stable(wanted_K + 50.0, soon), DeviceTimeout, "a wait for it")


BACKGROUND = [
    Check("limits", "sets its lowest set point, if that is allowed", limits),
    Check("settles", "warms it by 5 to 20 K, if that is allowed", settles),
]
