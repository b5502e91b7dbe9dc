"""Contract of drivers before implausible readings and spoiled answers: no instrument is left on.

Making safe writes first and reads later. Where only the sensor is broken, the set point is read
back. Where every answer is missing, late, damaged or of another instrument, the instrument must be
harmless all the same, and that this is not confirmed must be reported.
"""

import time
from collections.abc import Mapping
from typing import Any

from cldit.rig.safety import make_safe
from cldit.testing.bed import Bed, Make, opened, problem_of
from cldit.testing.expect import HANG_s, expect
from cldit.testing.lost_replies import all_right, session
from cldit.testing.replies import Fault

_ANSWER_s, _LATE = 0.3, 1.3  # time to wait for an answer; delay of a late one over that
_BROKEN_HIGH_K, _BROKEN_LOW_K, _FROZEN_K = 3549.85, 73.15, 295.0  # 3276.7 °C, -200 °C
_ABOVE_K = 50.0  # above the limits of the set point


def check_implausible(
    make: Make, settings: Mapping[str, Any] | None = None, *, at_once: int = 1
) -> int:
    """Checks that neither implausible readings nor a line on which no answer is right keep an
    instrument from being made safe, by its driver or by another one after a crash.

    `make`, `settings` and `at_once` are as for `cldit.testing.lost_replies.check_replies`. Returns
    the number of sessions; raises ContractBroken with a line for each that failed.
    """
    with opened(make, settings) as bed:
        troubles: dict[str, float | Fault] = {f"every answer: {fault}": fault for fault in Fault}
        if bed.sensor is not None:
            troubles |= {
                "sensor broken, high": _BROKEN_HIGH_K,
                "sensor broken, low": _BROKEN_LOW_K,
                "sensor frozen": _FROZEN_K,
                "above the limits": bed.device.limits.high_K + _ABOVE_K,
            }
        ways = ["connected", *(["afresh"] if bed.afresh is not None else [])]
    cases = [(trouble, way) for trouble in troubles for way in ways]

    def one(case: tuple[str, str]) -> str:
        def check(answer_s: float) -> None:
            with opened(make, settings, answer_s=answer_s) as bed:
                _left_on(bed, troubles[case[0]], case[1], late_s=_LATE * answer_s)

        problem = problem_of(check, answer_s=_ANSWER_s)
        return f"{', '.join(case)}: {problem}" if problem else ""

    all_right(one, cases, at_once)
    return len(cases)


def _left_on(bed: Bed, trouble: float | Fault, way: str, *, late_s: float) -> None:
    """Raises ContractBroken if it is left on; `afresh`: by another device, as after a crash."""
    assert bed.replies is not None
    errors = session(bed)
    expect(not errors and bed.left_on(), f"the session leaves nothing on: {errors}")
    if isinstance(trouble, Fault):
        bed.replies.spoil(trouble, bed.replies.sent + 1, last=10**9, late_s=late_s)
    elif bed.sensor is not None:
        bed.sensor(trouble)
    device = bed.device
    if way == "afresh" and bed.afresh is not None:
        bed.device.close()
        device = bed.afresh()
    safety = make_safe({"device": device}, ("device",), taken_over=device is not bed.device)
    end_s = time.monotonic() + HANG_s
    while bed.left_on() and time.monotonic() < end_s:
        time.sleep(0.01)
    struck = bed.replies.struck
    bed.replies.heal()
    device.close()
    expect(not bed.left_on(), f"left on: {bed.left_on()}; make_safe(): {safety}")
    if not isinstance(trouble, Fault):
        expect(not safety.problems, f"off, but make_safe() raised: {safety.problems}")
        seen = trouble <= bed.device.limits.high_K or safety.not_cooling
        expect(seen, f"reads {trouble:g} K, and it is not said that it does not cool: {safety.did}")
        return
    # A camera's acknowledgements have no data to spoil; an odd number may be none that is checked.
    camera = hasattr(bed.device, "software_trigger")
    if struck and trouble is not Fault.ODD and (trouble is Fault.DROP or not camera):
        expect(safety.problems, f"off without a right answer, but make_safe() did {safety.did}")
