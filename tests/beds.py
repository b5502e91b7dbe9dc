"""A bed for each driver: the driver before its peer, whose replies can be lost, and what to look at
on the peer's side. A driver that is installed and has none here fails the contract."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.rig.clock import SimulatedClock, SystemClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.load import open_rig
from tests.aravis import needs_aravis
from tests.sessions import Step, background_steps, camera_steps, trigger_steps

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
        return Bed(device, background_steps(device, peer), lambda: _hot(peer), told, peer.replies)

    return make


def _fluke(serial: bool) -> Make:
    def make(stack: ExitStack, rig: dict[str, Any], answer_s: float) -> Bed:
        pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")
        clock = SimulatedClock()
        peer = stack.enter_context(FlukePeer(clock=clock, serial=serial, start_K=310.0))
        device = load_driver("fluke418x")({**_line(peer), "answer_s": answer_s}, _context(clock))
        where = peer.serial or f"{peer.host}:{peer.port}"
        told = (f"Fluke 418x at {where}", "heater on", "keypad")
        return Bed(device, background_steps(device, peer), lambda: _hot(peer), told, peer.replies)

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
        device,
        trigger_steps(device, peer),
        left_on,
        told,
        peer.replies,
        lambda: len(peer.pulses("CD")),
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
            camera_steps(device, peer.line, peer),
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
            "camera": lambda: camera_steps(device, lambda: device.hear(_pulse())),
            "background": lambda: background_steps(device),
            "trigger": lambda: trigger_steps(device),
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
