"""A session with a camera, a background and a trigger generator between connect() and make_safe().

Each step knows whether what the driver gave agrees with the instrument, that is with its peer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.rig.protocols import Burst, TriggerInfo, TriggerMode

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.emulators.blackbody import FlukePeer, ModbusPeer
    from drivers.emulators.dg645 import Dg645Peer
    from drivers.emulators.gige_camera import GigePeer
else:
    from cldit.drivers.emulators.blackbody import FlukePeer

HOT_K = 420.0


@dataclass(frozen=True)
class Step:
    """Part of a session. right: whether what `call` gave agrees with the instrument's side."""

    name: str
    call: Callable[[], Any]
    right: Callable[[Any], bool] = lambda value: True


def _near(wanted_K: float) -> Callable[[Any], bool]:
    return lambda got_K: bool(abs(got_K - wanted_K) < 0.1)


def background_steps(device: Any, peer: ModbusPeer | FlukePeer | None = None) -> list[Step]:
    def configuration(stored: dict[str, Any]) -> bool:
        heating = getattr(peer, "heating", None)
        return peer is None or (
            _near(peer.setpoint_K)(stored["setpoint_K"]) and stored.get("heating") == heating
        )

    def temperature(got_K: float) -> bool:
        return peer is None or _near(peer.heater.now_K())(got_K)

    def stable(got: bool | None) -> bool:
        if not isinstance(peer, FlukePeer):
            return peer is None or got is None
        return got is (peer.heating and abs(peer.heater.now_K() - peer.setpoint_K) < 0.2)

    return [
        Step("configuration", device.read_configuration, configuration),
        Step("set point", lambda: device.set_setpoint(HOT_K), _near(HOT_K)),
        Step("temperature", device.read_temperature, temperature),
        Step("stable", device.is_stable, stable),
        Step("temperature again", device.read_temperature, temperature),
        Step("configuration again", device.read_configuration, configuration),
    ]


def trigger_steps(device: Any, peer: Dg645Peer | None = None) -> list[Step]:
    burst = Burst(camera_delay_s=1e-3, inject=True)

    def configuration(stored: dict[str, Any]) -> bool:
        return peer is None or (
            np.allclose(
                [stored["delays"][f"DLAY {channel}"] for channel in (2, 3, 4, 5)],
                [peer.delays[channel] for channel in (2, 3, 4, 5)],
                atol=1e-11,
                rtol=0.0,
            )
            and stored["levels_V"] == [peer.values["LAMP 1"], peer.values["LAMP 2"]]
            and stored["trigger_source"] == peer.values["TSRC"]
        )

    return [
        Step("configuration", device.read_configuration, configuration),
        Step("configure", lambda: device.configure(burst), lambda got: bool(got == burst)),
        Step("fire", device.fire),
        Step("wait", lambda: device.wait_done(1.0)),
        Step("configure again", lambda: device.configure(burst), lambda got: bool(got == burst)),
        Step("configuration again", device.read_configuration, configuration),
    ]


def camera_steps(device: Any, edge: Callable[[], None], peer: GigePeer | None = None) -> list[Step]:
    def pictures() -> list[Any]:
        edge()
        return [frame.data for frame in device.read_frames(1, 0.5)]

    def seen(images: list[Any]) -> bool:
        return peer is None or np.array_equal(images, [peer.image(peer.taken)])

    def settings(got: Any) -> bool:
        seconds = got["integration_time_s"] if isinstance(got, dict) else got.integration_time_s
        return bool(abs(seconds - 25e-6) < 1e-8)

    external = TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=2)
    return [
        Step("ready", lambda: device.wait_ready(1.0)),
        Step("configure", lambda: device.configure(25e-6), settings),
        Step("prepare", lambda: device.prepare(external)),
        Step("configuration", device.read_configuration, settings),
        Step("arm", device.arm),
        Step("pictures", pictures, seen),
    ]
