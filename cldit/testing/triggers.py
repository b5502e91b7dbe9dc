"""Contract of trigger generators, a session with one, and the contract of their pulses, with an
emulator that records them.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

from cldit.rig.errors import ConfigRejected, RigError
from cldit.rig.protocols import Burst, TriggerGenerator
from cldit.testing.bed import Bed, Step
from cldit.testing.expect import Allowed, Check, ContractBroken, HANG_s, expect, near, refuses

_QUANTUM_s = 1e-6  # no instrument is coarser
_PERIOD_s, _LONG_s = 0.05, 0.5  # the longer one outlasts two calls of a busy machine
_MANY = 1000  # pulses of a burst of 50 s, which a busy machine aborts in time too
_BUSY_s = 0.02  # delay of an emulator's pulse on a busy machine


def starts_inhibited(trigger: TriggerGenerator, allowed: Allowed) -> None:
    """Checks that nothing fires before `configure`, or after `inhibit` and `make_safe`."""
    refuses(trigger.fire, ConfigRejected, "fire() before configure()", "configure")
    trigger.configure(Burst())
    trigger.inhibit()
    refuses(trigger.fire, ConfigRejected, "fire() after inhibit()")
    trigger.configure(Burst())
    trigger.make_safe()
    refuses(trigger.fire, ConfigRejected, "fire() after make_safe()")


def quantises_a_little(trigger: TriggerGenerator, allowed: Allowed) -> None:
    """Checks that `configure` returns the quantised burst, which it then accepts exactly."""
    asked = Burst(
        n=3,
        period_s=_PERIOD_s,
        camera_delay_s=0.95e-3 + 1e-10,
        injector_delay_s=1e-5,
        widths_s=(1e-4, 1.5e-3),
        inject=allowed.inject,
    )
    got = trigger.configure(asked)
    for name in ("period_s", "camera_delay_s", "injector_delay_s"):
        near(getattr(got, name), getattr(asked, name), _QUANTUM_s, f"{name} [s]")
    for width_s, asked_s in zip(got.widths_s, asked.widths_s, strict=True):
        near(width_s, asked_s, _QUANTUM_s, "widths_s [s]")
    expect((got.n, got.inject) == (3, asked.inject), f"{got} for {asked}")
    again = trigger.configure(got)
    expect(again == got, f"{again} for {got}, which it supports")
    trigger.inhibit()


def refuses_bursts(trigger: TriggerGenerator, allowed: Allowed) -> None:
    """Checks that impossible bursts are rejected, and that nothing fires afterwards."""
    good = Burst()
    for burst in (
        replace(good, n=0),
        replace(good, camera_delay_s=-1e-3),
        replace(good, widths_s=(0.0, 1e-3)),
        replace(good, n=2, period_s=1e-3, camera_delay_s=2e-3),
    ):
        trigger.configure(good)
        refuses(partial(trigger.configure, burst), ConfigRejected, f"configure({burst})")
        refuses(trigger.fire, ConfigRejected, f"fire() after configure({burst})")


def reference(trigger: TriggerGenerator, allowed: Allowed) -> None:
    """Checks that a burst without injection is sent, and ends."""
    trigger.configure(Burst(camera_delay_s=1e-3))
    trigger.fire()
    trigger.wait_done(HANG_s)
    trigger.inhibit()


TRIGGER = [
    Check("starts inhibited", "sets bursts without injection", starts_inhibited),
    Check("read-back", "sets delays and widths, without injection", quantises_a_little),
    Check("refusals", "requests impossible bursts", refuses_bursts),
    Check("reference", "sends ONE pulse to the camera, none to the injector", reference),
]


def trigger_steps(
    device: Any, agrees: Callable[[Mapping[str, Any]], bool] = lambda stored: True
) -> list[Step]:
    """Session with a generator and one injection; `agrees` checks the configuration read."""
    burst = Burst(camera_delay_s=1e-3, inject=True)
    return [
        Step("configuration", device.read_configuration, agrees),
        Step("configure", lambda: device.configure(burst), lambda got: bool(got == burst)),
        Step("fire", device.fire),
        Step("wait", lambda: device.wait_done(HANG_s)),
        Step("configure again", lambda: device.configure(burst), lambda got: bool(got == burst)),
        Step("configuration again", device.read_configuration, agrees),
    ]


def _seen(bed: Bed, output: str, expected: int) -> list[float]:
    """Times of the pulses sent; waits for missing ones, which a busy machine may delay."""
    assert bed.pulses is not None
    end_s = time.monotonic() + HANG_s
    while len(bed.pulses(output)) < expected and time.monotonic() < end_s:
        time.sleep(1e-3)
    return bed.pulses(output)


def references_do_not_inject(bed: Bed, allowed: Allowed) -> None:
    """Checks that each burst pulses the camera once, and the injector on request only, whose output
    is otherwise at its lowest level: a step to a higher one may open it without a pulse."""
    if bed.armed is None:
        raise ContractBroken("the bed lacks `armed`, which describes the injector's output")
    for number, (inject, injections) in enumerate(((False, 0), (True, 1), (False, 1)), 1):
        bed.device.configure(Burst(inject=inject))
        armed = bed.armed()
        expect(bool(armed) is inject, f"before a burst with inject {inject}: {armed or 'nothing'}")
        bed.device.fire()
        bed.device.wait_done(HANG_s)
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
    got = bed.device.configure(Burst(n=3, period_s=_LONG_s))
    bed.device.fire()
    refuses(bed.device.fire, RigError, "fire() within a burst")
    bed.device.wait_done(HANG_s)
    near(got.period_s, _LONG_s, _QUANTUM_s, "period_s [s]")
    times_s = _seen(bed, "camera", 3)
    expect(len(times_s) == 3, f"{len(times_s)} pulses to the camera, not 3")
    for first_s, second_s in pairwise(times_s):
        near(second_s - first_s, _LONG_s, _BUSY_s, "from pulse to pulse [s]")


def abort(bed: Bed, allowed: Allowed) -> None:
    """Checks that abort() prevents the rest of the pulses."""
    bed.device.configure(Burst(n=_MANY, period_s=_PERIOD_s))
    bed.device.fire()
    time.sleep(2.5 * _PERIOD_s)
    bed.device.abort()
    sent = len(_seen(bed, "camera", 1))
    time.sleep(4.0 * _PERIOD_s)
    late = len(_seen(bed, "camera", sent)) - sent
    expect(1 <= sent < _MANY and not late, f"{sent} pulses before abort(), {late} after it")


PULSES = [
    Check("references do not inject", "injects once", references_do_not_inject),
    Check("burst", "pulses the camera", burst),
    Check("abort", "pulses the camera", abort),
]
