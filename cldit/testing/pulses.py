"""Contract of generators as to their pulses, with an emulator that records them."""

from __future__ import annotations

import time
from itertools import pairwise

from cldit.rig.errors import RigError
from cldit.rig.protocols import Burst
from cldit.testing.bed import Bed
from cldit.testing.expect import Allowed, Check, expect, near, refuses

_PERIOD_s, _LATE_s = 0.05, 1.0
_BUSY_s = 0.02  # delay of an emulator's pulse on a busy machine


def _seen(bed: Bed, output: str, expected: int) -> list[float]:
    """Times of the pulses sent; waits for missing ones, which a busy machine may delay."""
    assert bed.pulses is not None
    end_s = time.monotonic() + _LATE_s
    while len(bed.pulses(output)) < expected and time.monotonic() < end_s:
        time.sleep(1e-3)
    return bed.pulses(output)


def references_do_not_inject(bed: Bed, allowed: Allowed) -> None:
    """Checks that each burst pulses the camera once, and the injector on request only."""
    for number, (inject, injections) in enumerate(((False, 0), (True, 1), (False, 1)), 1):
        bed.device.configure(Burst(inject=inject))
        bed.device.fire()
        bed.device.wait_done(1.0)
        injected = len(_seen(bed, "injector", injections))
        expect(injected == injections, f"{injected} injections, not {injections}")
        pulses = len(_seen(bed, "camera", number))
        expect(pulses == number, f"{pulses} pulses to the camera after {number} bursts")
    bed.device.configure(Burst(inject=True))
    bed.device.make_safe()
    expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")
    expect(bed.injections == 1, f"{bed.injections} injections, not 1")


def burst(bed: Bed, allowed: Allowed) -> None:
    """Checks a burst of three pulses, and that a second fire() within it is rejected."""
    got = bed.device.configure(Burst(n=3, period_s=_PERIOD_s))
    bed.device.fire()
    refuses(bed.device.fire, RigError, "fire() within a burst")
    bed.device.wait_done(2.0)
    times_s = _seen(bed, "camera", 3)
    expect(len(times_s) == 3, f"{len(times_s)} pulses to the camera, not 3")
    for first_s, second_s in pairwise(times_s):
        near(second_s - first_s, got.period_s, _BUSY_s, "from pulse to pulse [s]")


def abort(bed: Bed, allowed: Allowed) -> None:
    """Checks that abort() prevents the rest of the pulses."""
    bed.device.configure(Burst(n=20, period_s=_PERIOD_s))
    bed.device.fire()
    time.sleep(2.5 * _PERIOD_s)
    bed.device.abort()
    sent = len(_seen(bed, "camera", 1))
    time.sleep(4.0 * _PERIOD_s)
    late = len(_seen(bed, "camera", sent)) - sent
    expect(1 <= sent < 20 and not late, f"{sent} pulses before abort(), {late} after it")


PULSES = [
    Check("references do not inject", "injects once", references_do_not_inject),
    Check("burst", "pulses the camera", burst),
    Check("abort", "pulses the camera", abort),
]
