"""Contract of drivers before implausible readings, as of a broken sensor: no instrument is left on.

Making safe writes first and reads later: what counts is the state of the emulator. Where only the
sensor is broken, make_safe() must succeed, because the set point can be read back; where every
number of every answer is impossible, it may raise NotSafe.
"""

from collections.abc import Mapping
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


def check_implausible(make: Make, settings: Mapping[str, Any] | None = None) -> int:
    """Checks that implausible readings never keep an instrument from being made safe.

    `make` and `settings` are as for `cldit.testing.bed.opened`. Returns the number of sessions;
    raises ContractBroken with a line for each that failed.
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
        ways = ["connected", "closed", *(["afresh"] if bed.afresh is not None else [])]
    cases = [(reading, way) for reading in readings for way in ways]
    problems = []
    for reading, way in cases:
        with opened(make, settings, answer_s=_ANSWER_s) as bed:
            try:
                _left_on(bed, readings[reading], way)
            except ContractBroken as error:
                problems.append(f"{reading}, {way}: {error}")
    expect(not problems, "\n".join(problems))
    return len(cases)


def _made_safe(bed: Bed, way: str) -> Any:
    """Device that is to be made safe: that of the session, connected or closed while on, or another
    for the same instrument, as of the guard after a crash.
    """
    if way == "connected":
        return bed.device
    bed.device.close()
    if way == "closed":
        return bed.device
    assert bed.afresh is not None
    return bed.afresh()


def _left_on(bed: Bed, reads_K: float | None, way: str) -> None:
    """Raises ContractBroken if the instrument is left on, or a success is not reported."""
    assert bed.replies is not None
    errors = session(bed)
    expect(not errors and bed.left_on(), f"the session leaves nothing on: {errors}")
    if reads_K is not None and bed.sensor is not None:
        bed.sensor(reads_K)
    device = _made_safe(bed, way)
    if reads_K is None:
        bed.replies.spoil(Fault.ODD, bed.replies.sent + 1, last=10**9)
    connect_s = _CONNECT_s if device is not bed.device else None
    safety = make_safe({"device": device}, ("device",), connect_s=connect_s)
    bed.replies.heal()
    device.close()
    expect(not bed.left_on(), f"left on: {bed.left_on()}; make_safe(): {safety}")
    if reads_K is not None:
        expect(not safety.problems, f"off, but make_safe() raised: {safety.problems}")
