"""Sessions with a camera, a background and a trigger generator, between connect() and make_safe().

Each step compares the result of the driver with the state of the emulator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.rig.protocols import Background, Burst, Camera, TriggerInfo, TriggerMode
from cldit.testing.bed import Step

HOT_K = 420.0
_AGREE_K = 0.1
_INTEGRATION_s = 25e-6
_AGREE_s = 1e-8


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

    def near(got_K: float, right_K: float) -> bool:
        return bool(abs(got_K - right_K) < _AGREE_K)

    def configuration(stored: dict[str, Any]) -> bool:
        return side is None or (
            near(stored["setpoint_K"], side.setpoint_K())
            and all(stored[name] == value for name, value in side.stored().items())
        )

    def temperature(got_K: float) -> bool:
        return side is None or near(got_K, side.temperature_K())

    def stable(got: bool | None) -> bool:
        return side is None or got is side.stable()

    return [
        Step("configuration", device.read_configuration, configuration),
        Step("set point", lambda: device.set_setpoint(wanted_K), lambda got: near(got, wanted_K)),
        Step("temperature", device.read_temperature, temperature),
        Step("stable", device.is_stable, stable),
        Step("temperature again", device.read_temperature, temperature),
        Step("configuration again", device.read_configuration, configuration),
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


def camera_steps(
    device: Camera,
    edge: Callable[[], None],
    picture: Callable[[], NDArray[np.uint16]] | None = None,
) -> list[Step]:
    """Session with a camera and one image, for which `edge` pulses the trigger input; `picture` is
    the last image that the emulator sent."""

    def images() -> list[Any]:
        edge()
        return [frame.data for frame in device.read_frames(1, 0.5)]

    def seen(found: list[Any]) -> bool:
        return picture is None or np.array_equal(found, [picture()])

    def settings(got: Any) -> bool:
        seconds = got["integration_time_s"] if isinstance(got, dict) else got.integration_time_s
        return bool(abs(seconds - _INTEGRATION_s) < _AGREE_s)

    external = TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=2)
    return [
        Step("ready", lambda: device.wait_ready(1.0)),
        Step("configure", lambda: device.configure(_INTEGRATION_s), settings),
        Step("prepare", lambda: device.prepare(external)),
        Step("configuration", device.read_configuration, settings),
        Step("arm", device.arm),
        Step("images", images, seen),
    ]
