"""Contract of trigger generators, and a session with one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from cldit.rig.errors import ConfigRejected
from cldit.rig.protocols import Burst, TriggerGenerator
from cldit.testing.bed import Step
from cldit.testing.expect import Allowed, Check, expect, near, refuses

_QUANTUM_s = 1e-6  # no instrument is coarser
_DONE_s = 5.0


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
        camera_delay_s=0.95e-3 + 1e-10,
        injector_delay_s=1e-5,
        widths_s=(1e-4, 1.5e-3),
        inject=allowed.inject,
    )
    got = trigger.configure(asked)
    near(got.camera_delay_s, asked.camera_delay_s, _QUANTUM_s, "camera_delay_s [s]")
    expect((got.n, got.inject) == (1, asked.inject), f"{got} for {asked}")
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
        refuses(lambda b=burst: trigger.configure(b), ConfigRejected, f"configure({burst})")  # type: ignore[misc]
        refuses(trigger.fire, ConfigRejected, f"fire() after configure({burst})")


def reference(trigger: TriggerGenerator, allowed: Allowed) -> None:
    """Checks that a burst without injection is sent, and ends."""
    trigger.configure(Burst(camera_delay_s=1e-3))
    trigger.fire()
    trigger.wait_done(_DONE_s)
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
        Step("wait", lambda: device.wait_done(1.0)),
        Step("configure again", lambda: device.configure(burst), lambda got: bool(got == burst)),
        Step("configuration again", device.read_configuration, agrees),
    ]
