"""Contract of drivers before implausible readings, as of a broken sensor: no instrument is left on.

Making safe writes first and reads later: what counts is the state of the emulator. Where only the
sensor is broken, make_safe() must succeed, because the set point can be read back; where every
number of every answer is impossible, it may raise NotSafe.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cldit.rig.safety import make_safe
from cldit.testing.bed import Bed, Make, opened
from cldit.testing.expect import ContractBroken, expect
from cldit.testing.lost_replies import session
from cldit.testing.replies import Fault

_ANSWER_s = 0.3
_CONNECT_s = 3.0
_BROKEN_HIGH_K, _BROKEN_LOW_K, _FROZEN_K = 3549.85, 73.15, 295.0  # 3276.7 °C, -200 °C
_ABOVE_K = 50.0  # above the limits of the set point


def _connected(bed: Bed) -> Any:
    """The device of the session, still connected."""
    return bed.device


def _closed(bed: Bed) -> Any:
    """The device of the session, closed while on."""
    bed.device.close()
    return bed.device


def _afresh(bed: Bed) -> Any:
    """Another device for the same instrument, as of the guard after a crash."""
    bed.device.close()
    assert bed.afresh is not None
    return bed.afresh()


_WAYS: dict[str, Callable[[Bed], Any]] = {
    "connected": _connected,
    "closed": _closed,
    "afresh": _afresh,
}


def check_implausible(make: Make, settings: Mapping[str, Any] | None = None) -> int:
    """Checks that implausible readings never keep an instrument from being made safe, and returns
    the number of sessions.

    Args:
        make: from `cldit.testing.bed.beds_of`.
        settings: of the driver, without the address.

    Raises:
        ContractBroken: one line for each session that failed.
    """
    with opened(make, settings) as bed:
        readings: dict[str, float | None] = {"impossible answers": None}
        if bed.sensor is not None:
            readings |= {
                "sensor broken, high": _BROKEN_HIGH_K,
                "sensor broken, low": _BROKEN_LOW_K,
                "sensor frozen": _FROZEN_K,
                "above the limits": bed.device.limits.high_K + _ABOVE_K,
            }
        ways = [way for way in _WAYS if bed.afresh is not None or way != "afresh"]
    cases = [(reading, way) for reading in readings for way in ways]
    problems = []
    for reading, way in cases:
        with opened(make, settings, answer_s=_ANSWER_s) as bed:
            try:
                _left_on(bed, readings[reading], _WAYS[way])
            except ContractBroken as error:
                problems.append(f"{reading}, {way}: {error}")
    expect(not problems, "\n".join(problems))
    return len(cases)


def _left_on(bed: Bed, reads_K: float | None, way: Callable[[Bed], Any]) -> None:
    """Raises ContractBroken if the instrument is left on, or a success is not reported."""
    assert bed.replies is not None
    errors = session(bed)
    expect(not errors and bed.left_on(), f"the session leaves nothing on: {errors}")
    if reads_K is not None and bed.sensor is not None:
        bed.sensor(reads_K)
    device = way(bed)
    if reads_K is None:
        bed.replies.spoil(Fault.ODD, bed.replies.sent + 1, last=10**9)
    connect_s = _CONNECT_s if device is not bed.device else None
    safety = make_safe({"device": device}, ("device",), connect_s=connect_s)
    bed.replies.heal()
    device.close()
    expect(not bed.left_on(), f"left on: {bed.left_on()}; make_safe(): {safety}")
    if reads_K is not None:
        expect(not safety.problems, f"off, but make_safe() raised: {safety.problems}")
