"""A bed for each driver: the driver before its peer, whose replies can be lost, and what to look at
on the peer's side. A driver that is installed and has none here fails the contract."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.rig.clock import SimulatedClock, SystemClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.load import open_rig
from cldit.rig.protocols import Burst, TriggerInfo, TriggerMode
from tests.aravis import needs_aravis

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.emulators.blackbody import FlukePeer, ModbusPeer
    from drivers.emulators.dg645 import Dg645Peer
    from drivers.emulators.gige_camera import GigePeer
    from drivers.emulators.replies import Replies
    from drivers.emulators.rig import CALIBRATION
else:
    from cldit.drivers.emulators.blackbody import FlukePeer, ModbusPeer
    from cldit.drivers.emulators.dg645 import Dg645Peer
    from cldit.drivers.emulators.gige_camera import GigePeer
    from cldit.drivers.emulators.rig import CALIBRATION

HOT_K = 420.0


@dataclass(frozen=True)
class Step:
    """Part of a session. right: whether what `call` gave agrees with the instrument's side."""

    name: str
    call: Callable[[], Any]
    right: Callable[[Any], bool] = lambda value: True


@dataclass(frozen=True)
class Bed:
    """One device, and the instrument's side of it.

    steps: a session between connect() and make_safe(). left_on: what
    is on at the instrument, in words, empty where nothing is. replies: their way, None for a
    simulated device, which is unplugged after its session. injections: pulses at the injector.
    told: what must be said of the instrument where it cannot be reached after the session.
    """

    device: Any
    steps: list[Step]
    left_on: Callable[[], str]
    told: tuple[str, ...]
    replies: Replies | None = None
    injections: Callable[[], int] = field(default=lambda: 0)


Make = Callable[[ExitStack, dict[str, Any], float], Bed]


def _near(wanted_K: float) -> Callable[[Any], bool]:
    return lambda got_K: bool(abs(got_K - wanted_K) < 0.1)


def _background(device: Any, peer: ModbusPeer | FlukePeer | None = None) -> list[Step]:
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


def _trigger(device: Any, peer: Dg645Peer | None = None) -> list[Step]:
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


def _camera(device: Any, edge: Callable[[], None], peer: GigePeer | None = None) -> list[Step]:
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


def _hot(peer: ModbusPeer | FlukePeer) -> str:
    if getattr(peer, "heating", peer.setpoint_K > 311.0):
        return f"set point {peer.setpoint_K:.1f} K, heater on"
    return f"set point {peer.setpoint_K:.1f} K" if peer.setpoint_K > 311.0 else ""


def _line(peer: ModbusPeer | FlukePeer) -> dict[str, Any]:
    if peer.serial is not None:
        return {"serial": peer.serial}
    return {"host": peer.host, "port": peer.port}


def _context(clock: Any) -> RigContext:
    return RigContext(clock, None, Path(), 1)


def _modbus(model: str, serial: bool) -> Make:
    def make(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
        pytest.importorskip("pymodbus", reason="pymodbus is missing; install cldit[rig]")
        clock = SimulatedClock()
        peer = stack.enter_context(ModbusPeer(model, clock=clock, serial=serial))
        settings = {"model": model, "limits_K": [253.0, 873.0], "answer_s": answer_s}
        device = load_driver("modbus_blackbody")({**settings, **_line(peer)}, _context(clock))
        where = peer.serial or f"{peer.host}:{peer.port}"
        told = (f"{model} at {where}", "set point 420.0 K", "front panel")
        return Bed(device, _background(device, peer), lambda: _hot(peer), told, peer.replies)

    return make


def _fluke(serial: bool) -> Make:
    def make(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
        pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")
        clock = SimulatedClock()
        peer = stack.enter_context(FlukePeer(clock=clock, serial=serial, start_K=310.0))
        device = load_driver("fluke418x")({**_line(peer), "answer_s": answer_s}, _context(clock))
        where = peer.serial or f"{peer.host}:{peer.port}"
        told = (f"Fluke 418x at {where}", "heater on", "keypad")
        return Bed(device, _background(device, peer), lambda: _hot(peer), told, peer.replies)

    return make


def _dg645(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")
    peer = stack.enter_context(Dg645Peer())
    settings = {"host": peer.host, "port": peer.port, "answer_s": answer_s}
    device = load_driver("dg645")(settings, _context(SystemClock()))

    def left_on() -> str:
        values = peer.values
        on = [
            text
            for text, bad in (
                ("a trigger injects", peer.injects_on_trigger),
                (f"CD at {values['LAMP 2']} V", peer.triggers > 0 and values["LAMP 2"] > 0.5),
                ("burst mode", values["BURM"] != 0),
                ("triggers by itself", values["TSRC"] != 5),
            )
            if bad
        ]
        return ", ".join(on)

    told = (f"DG645 at {peer.host}:{peer.port}", "CD 5 V", "output CD")
    return Bed(
        device, _trigger(device, peer), left_on, told, peer.replies, lambda: len(peer.pulses("CD"))
    )


def _gige(driver: str) -> Make:
    def make(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
        if driver == "aravis_camera":
            needs_aravis()
        else:
            pytest.importorskip("viva_genicam", reason="viva_genicam is missing")
        peer = stack.enter_context(GigePeer((64, 48)))
        settings = {"address": peer.host, "interface": "127.0.0.1", "calibration": CALIBRATION}
        device = load_driver(driver)({**settings, "heartbeat_s": 1.5}, _context(SystemClock()))
        told = (f"camera at {peer.host}", "armed for 2 frames", "trigger cable")
        return Bed(
            device,
            _camera(device, peer.line, peer),
            lambda: "armed" if peer.armed else "",
            told,
            peer.replies,
        )

    return make


def _simulated(part: str) -> Make:
    def make(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
        after = {"camera": 1, "background": 2, "trigger": 1}[part]
        rig[part]["settings"]["unplug_after"] = after
        opened = open_rig(rig)
        device: Any = opened.devices[part]
        steps = {
            "camera": lambda: _camera(device, lambda: device.hear(_pulse())),
            "background": lambda: _background(device),
            "trigger": lambda: _trigger(device),
        }[part]()
        if part == "background":
            opened.camera.connect()
        told = {
            "camera": ("simulated camera", "armed"),
            "background": ("simulated black body", "set point 420.0 K"),
            "trigger": ("simulated injector", "a trigger injects"),
        }[part]
        return Bed(device, steps, lambda: "", told)

    return make


def _pulse() -> Any:
    if TYPE_CHECKING:
        from drivers.simulated_scene import Pulse
    else:
        from cldit.drivers.simulated_scene import Pulse
    return Pulse(0.0, False, 1)


BEDS: dict[str, dict[str, Make]] = {
    "simulated_camera": {"simulated": _simulated("camera")},
    "simulated_blackbody": {"simulated": _simulated("background")},
    "simulated_injector": {"simulated": _simulated("trigger")},
    "dg645": {"tcp": _dg645},
    "fluke418x": {"tcp": _fluke(False), "serial": _fluke(True)},
    "modbus_blackbody": {
        "eurotherm-tcp": _modbus("eurotherm-3200", False),
        "ir2100-serial": _modbus("ir-2100", True),
    },
    "gige_camera": {"gige": _gige("gige_camera")},
    "aravis_camera": {"gige": _gige("aravis_camera")},
}


@contextmanager
def bed_of(
    driver: str, variant: str, rig: dict[str, Any], *, answer_s: float = 1.0
) -> Iterator[Bed]:
    """A new bed, its peer switched on, its device not connected; where that can be set, it waits
    `answer_s` for an answer."""
    if driver not in BEDS:
        pytest.fail(
            f"the driver {driver!r} is installed, but nobody tries what it does when an answer is "
            "lost: give it a bed in tests/beds.py, with a peer whose replies go through "
            "cldit.drivers.emulators.replies.Replies"
        )
    with ExitStack() as stack:
        bed = BEDS[driver][variant](stack, rig, answer_s)
        try:
            yield bed
        finally:
            bed.device.close()
