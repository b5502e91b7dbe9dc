"""Drivers of black bodies and cameras against their peers: what the contract tests do not ask.

The peers of the black bodies are checked by minimalmodbus, which is not ours. The camera's peer is
ours alone; its client, viva-genicam, is not.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import ConfigRejected, NotConnected, OutOfLimits
from cldit.rig.protocols import TriggerInfo, TriggerMode
from cldit.testing.bed import opened
from tests.emulators.beds import BEDS
from tests.emulators.blackbody import ModbusPeer
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import CALIBRATION, blackbody_choice
from tests.patience import HANG_s, until

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.gige_camera import GenicamCamera
    from drivers.modbus_blackbody import open_modbus_blackbody
    from drivers.modbus_registers import RegisterMap
else:
    from cldit.drivers.modbus_blackbody import open_modbus_blackbody
    from cldit.drivers.modbus_registers import RegisterMap

CONTEXT = RigContext(Clock(), None, Path(), 1)


# Black bodies


# Eurotherm's remote set point (26) in tenths, as its integer registers have it.
REMOTE = {
    "maker": "Eurotherm",
    "model": "eurotherm-3216, remote set point",
    "unit": "celsius",
    "temperature": {"address": 1, "format": "int16", "decimals": 1},
    "setpoint": {"address": 26, "format": "int16", "decimals": 1},
}


@pytest.mark.parametrize(
    ("settings", "read"),
    [
        ({"model": "eurotherm-3200"}, lambda other: other.read_float(0x8000 + 2 * 24)),
        ({"model": "ir-2100"}, lambda other: other.read_register(300, 1, signed=True)),
        ({"registers": REMOTE}, lambda other: other.read_register(26, 1, signed=True)),
    ],
)
def test_modbus_agrees_with_minimalmodbus(
    settings: dict[str, Any], read: Callable[[Any], float]
) -> None:
    """Another Modbus implementation reads, on the serial line, what the driver wrote."""
    minimal = pytest.importorskip("minimalmodbus", reason="minimalmodbus is missing")
    clock = SimulatedClock()
    registers = RegisterMap.model_validate(REMOTE) if "registers" in settings else None
    unit = {} if registers else {"temperature_unit": "celsius"}
    with ModbusPeer(settings.get("model"), registers=registers, clock=clock, serial=True) as peer:
        device = open_modbus_blackbody(
            {**settings, **unit, "serial": peer.serial, "limits_K": [253.0, 873.0]},
            RigContext(clock, None, Path(), 1),
        )
        device.connect()
        assert device.identify().model == settings.get("model", REMOTE["model"])
        assert device.set_setpoint(440.35) == pytest.approx(440.35, abs=0.05)
        device.close()
        other = minimal.Instrument(peer.serial, 1)
        other.serial.baudrate, other.serial.timeout = 19200, HANG_s
        try:
            celsius = read(other)
        finally:
            other.serial.close()
    assert celsius == pytest.approx(440.35 - 273.15, abs=0.06)


def test_modbus_writes_a_setpoint_once() -> None:
    """The controller's memory for it wears out."""
    with ModbusPeer("eurotherm-3200") as peer:
        device = open_modbus_blackbody(blackbody_choice(peer)["settings"], CONTEXT)
        device.connect()
        for _ in range(5):
            device.set_setpoint(400.0)
        assert peer.writes == 1 and peer.setpoint_K == pytest.approx(400.0, abs=1e-3)
        with pytest.raises(OutOfLimits):
            device.set_setpoint(900.0)
        device.make_safe()
        assert peer.setpoint_K == pytest.approx(295.0, abs=1e-3) and peer.writes == 2
        peer.unplug()
        with pytest.raises(NotConnected):
            device.read_temperature()
        device.close()
        with pytest.raises(NotConnected, match="does not answer"):
            device.connect(0.5)
        device.close()


@pytest.mark.parametrize(("busy", "works"), [(3, True), (6, False)])
def test_a_busy_controller_is_asked_again_within_a_bound(busy: int, works: bool) -> None:
    from pymodbus.pdu import ExceptionResponse

    with opened(BEDS["modbus_blackbody"]["eurotherm-tcp"]) as bed:
        bed.device.connect()
        client = bed.device._client
        plain, refused = client.read_holding_registers, [ExceptionResponse(3, 6)] * busy
        client.read_holding_registers = lambda *args, **named: (
            refused.pop() if refused else plain(*args, **named)
        )
        if works:
            assert bed.device.read_temperature() > 0.0
        else:
            with pytest.raises(ConfigRejected):
                bed.device.read_temperature()
        assert not refused


# Camera


def camera_before(peer: GigePeer, **settings: Any) -> GenicamCamera:
    made: GenicamCamera = load_driver("gige_camera")(
        {"address": peer.host, "interface": "127.0.0.1", "calibration": CALIBRATION, **settings},
        CONTEXT,
    )
    return made


@pytest.mark.gige
def test_a_camera_on_loopback_is_searched_there_alone() -> None:
    """A datagram that is broadcast on a network returns to a socket for all addresses."""
    with (
        GigePeer((64, 48)) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as everywhere,
    ):
        everywhere.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        everywhere.bind(("", 3956))
        everywhere.settimeout(0.5)
        for interface in ({"interface": "127.0.0.1"}, {"interface": None}):
            camera = camera_before(peer, **interface)
            camera.connect()
            camera.close()
        with pytest.raises(TimeoutError):
            everywhere.recv(1024)


@pytest.mark.gige
def test_camera_loses_packets() -> None:
    """At 0.5 % loss every whole picture is bit-exact, and the resends are few."""
    with GigePeer(loss=0.005, seed=3) as peer:
        camera = camera_before(peer)
        camera.connect()
        camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=60))
        camera.arm()
        whole = 0
        for number in range(1, 61):
            time.sleep(0.007)
            peer.line()
            (frame,) = camera.read_frames(1, HANG_s)
            if frame.complete:
                whole += 1
                assert np.array_equal(frame.data, peer.image(number))
        camera.close()
        # 60 x 83 packets: 25 are lost; a picture is, where a resend is lost too (1 in 5 runs).
        assert peer.lost_packets >= 10 and whole >= 57
        assert whole + camera.statistics()["incomplete"] == 60


@pytest.mark.gige
def test_camera_frames_that_never_come() -> None:
    """A gap shows in the ids; half a picture is incomplete, and says so."""
    with GigePeer((64, 48)) as peer:
        camera = camera_before(peer, packet_size=1000)
        camera.connect()
        camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=4))
        camera.arm()
        ids = []
        for number in range(4):
            if number == 1:
                peer.skip = 1
            time.sleep(0.01)
            peer.line()
            if number != 1:
                (frame,) = camera.read_frames(1, HANG_s)
                ids.append(frame.frame_id - number)
        assert len(set(ids)) == 1
        camera.disarm()
        camera.close()


@pytest.mark.gige
def test_camera_is_free_after_its_clients_death() -> None:
    """A client that dies keeps the camera no longer than the heartbeat; alive, it keeps it."""
    with GigePeer((64, 48)) as peer:
        first = camera_before(peer, heartbeat_s=1.5)
        first.connect()
        first.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
        first.arm()
        time.sleep(2.0)  # longer than a heartbeat
        assert peer.armed and peer.controlled
        peer.unheard()
        until(lambda: not peer.armed and not peer.controlled)
        second = camera_before(peer)
        second.connect(HANG_s)
        assert peer.controlled
        second.close()
        first.close()


@pytest.mark.gige
def test_camera_unplugged() -> None:
    with GigePeer((64, 48)) as peer:
        camera = camera_before(peer)
        camera.connect()
        peer.switch_off()
        with pytest.raises(NotConnected, match="the link failed"):
            camera.prepare(TriggerInfo(TriggerMode.SOFTWARE))
        camera.close()
        with pytest.raises(NotConnected, match="check its power"):
            camera.connect(0.5)
        camera.close()
