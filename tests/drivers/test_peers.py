"""Drivers of real instruments against their peers: what the contract tests do not ask.

The peers of the DG645 and of the black bodies are checked by clients that are not ours: the maker's
driver and minimalmodbus. The camera's peer is ours alone; its clients, viva-genicam and Aravis,
are not.
"""

from __future__ import annotations

import socket
import struct
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.acquisition.journal import read_journal
from cldit.errors import SceneError
from cldit.rig.clock import SimulatedClock, SystemClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import (
    ConfigRejected,
    DeviceTimeout,
    FireUncertain,
    NotConnected,
    OutOfLimits,
    RetakesExhausted,
    RigError,
)
from cldit.rig.load import Rig, open_rig
from cldit.rig.protocols import Burst, TriggerInfo, TriggerMode

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.dg645 import Dg645, open_dg645
    from drivers.emulators.blackbody import ModbusPeer
    from drivers.emulators.dg645 import Dg645Peer
    from drivers.emulators.gige_camera import GigePeer
    from drivers.emulators.pulse_generator import PulseGeneratorPeer
    from drivers.emulators.rig import CALIBRATION, PeerRig
    from drivers.genicam_camera import GenicamCamera
    from drivers.modbus_blackbody import open_modbus_blackbody
else:
    from cldit.drivers.dg645 import open_dg645
    from cldit.drivers.emulators.blackbody import ModbusPeer
    from cldit.drivers.emulators.dg645 import Dg645Peer
    from cldit.drivers.emulators.gige_camera import GigePeer
    from cldit.drivers.emulators.pulse_generator import PulseGeneratorPeer
    from cldit.drivers.emulators.rig import CALIBRATION, PeerRig
    from cldit.drivers.modbus_blackbody import open_modbus_blackbody

CONTEXT = RigContext(SystemClock(), None, Path(), 1)


@pytest.fixture
def generator() -> Iterator[Dg645Peer]:
    with Dg645Peer() as peer:
        yield peer


@pytest.fixture
def dg645(generator: Dg645Peer) -> Iterator[Dg645]:
    device = open_dg645({"host": generator.host, "port": generator.port, "answer_s": 0.3}, CONTEXT)
    device.connect()
    yield device
    device.close()


# Delay generator


def test_dg645_agrees_with_the_makers_driver(generator: Dg645Peer, dg645: Dg645) -> None:
    maker = pytest.importorskip("srsinst.dg645", reason="srsinst.dg645 is missing")
    dg645.configure(Burst(camera_delay_s=0.95e-3, widths_s=(1e-4, 1.5e-3), inject=True))
    other = maker.DG645("tcpip", generator.host, generator.port)
    try:
        assert other.trigger.trigger_source == "single shot" and not other.burst.burst_mode
        assert tuple(other.delays.delay["A"]) == (0, 0.95e-3)
        assert tuple(other.delays.delay["B"]) == (2, 1e-4)
        assert tuple(other.delays.delay["D"]) == (4, 1.5e-3)
        assert other.outputs.amplitude["CD"] == 5.0
        other.delays.delay["A"]["T0"] = 2e-3  # what the maker's driver writes, the peer takes
        assert other.status.drain_errors() == []
        assert generator.delays[2] == pytest.approx((0, 2e-3))
    finally:
        other.disconnect()


def test_dg645_reference_leaves_the_injector_still(generator: Dg645Peer, dg645: Dg645) -> None:
    for inject, injections in ((False, 0), (True, 1), (False, 1)):
        dg645.configure(Burst(inject=inject))
        dg645.fire()
        dg645.wait_done(1.0)
        assert len(generator.pulses("CD")) == injections
    assert len(generator.pulses("AB")) == 3
    dg645.configure(Burst(inject=True))
    dg645.make_safe()
    assert not generator.injects_on_trigger and generator.values["TSRC"] == 5


def test_dg645_rate_error_and_inhibit_input(generator: Dg645Peer, dg645: Dg645) -> None:
    """A trigger that the instrument did not take is never reported as fired, nor sent again."""
    dg645.configure(Burst())
    generator.fail_rate = 1
    with pytest.raises(FireUncertain, match="rate error"):
        dg645.fire()
    generator.values["INHB"], generator.inhibit_input = 1.0, True
    with pytest.raises(FireUncertain, match="inhibit input"):
        dg645.fire()
    assert generator.triggers == 0 and generator.edges == []


def test_dg645_busy(generator: Dg645Peer, dg645: Dg645) -> None:
    dg645.configure(Burst(n=3, period_s=0.05))
    dg645.fire()
    with pytest.raises(FireUncertain, match="rate error"):
        dg645.fire()
    dg645.wait_done(1.0)
    assert len(generator.pulses("AB")) == 3 and generator.triggers == 1


def test_dg645_unplugged_and_silent(generator: Dg645Peer, dg645: Dg645) -> None:
    dg645.configure(Burst(inject=True))
    generator.unplug()
    with pytest.raises(RigError):  # it shows before the trigger goes out
        dg645.fire()
    assert generator.triggers == 0
    dg645.connect()  # plugged in again: nothing fires until it is configured
    with pytest.raises(ConfigRejected, match="inhibited"):
        dg645.fire()
    generator.deaf = True
    with pytest.raises(DeviceTimeout):
        dg645.read_configuration()
    generator.deaf = False
    with pytest.raises(NotConnected, match="connect"):  # a late answer must not be misread
        dg645.read_configuration()


def test_pulse_generator_agrees_with_qmi() -> None:
    """The driver of another project reads what ours wrote, and what it writes, the peer takes."""
    pytest.importorskip("qmi", reason="qmi is missing")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of what QMI imports
        from qmi.core.context import QMI_Context
        from qmi.instruments.quantum_composers.pulse_generator9530 import (
            PulseMode,
            TriggerMode,
        )
        from qmi.instruments.quantum_composers.pulse_generator9530 import (
            QuantumComposers_PulseGenerator9530 as Qmi9530,
        )
    context = MagicMock(spec=QMI_Context)
    context.name = "tests"
    with PulseGeneratorPeer(identity="QC,9528,02345,2.1.8", outputs=8) as peer:
        ours = load_driver("pulse_generator")(
            {"series": "qc-9520", "host": peer.host, "port": peer.port}, CONTEXT
        )
        ours.connect()
        ours.configure(Burst(camera_delay_s=0.95e-3, widths_s=(1e-4, 1.5e-3), n=3, inject=True))
        theirs = Qmi9530(context, "generator", f"tcp:{peer.host}:{peer.port}")
        theirs.open()
        try:
            assert theirs.get_idn().model == ours.identify().model == "9528"
            assert theirs.get_num_channels() == 8
            assert not theirs.get_output_enabled()
            assert theirs.get_t0_mode() is PulseMode.BURST and theirs.get_t0_burst_count() == 3
            assert theirs.get_t0_period() == pytest.approx(0.1)
            assert theirs.get_trigger_mode() is TriggerMode.DISABLED
            assert theirs.get_channel_delay(1) == pytest.approx(0.95e-3, abs=1e-11)
            assert theirs.get_channel_width(2) == pytest.approx(1.5e-3, abs=1e-11)
            assert theirs.get_channel_enabled(1) and theirs.get_channel_enabled(2)
            assert theirs.get_channel_mode(1) is PulseMode.NORMAL
            theirs.set_t0_mode(PulseMode.SINGLE)
            theirs.set_channel_enabled(2, False)
            theirs.set_output_enabled(True)  # what ours calls fire()
            time.sleep(0.05)
            assert len(peer.pulses("A")) == 1 and not peer.pulses("B")
        finally:
            theirs.close()
            ours.make_safe()
            ours.close()


def test_pulse_generator_refusals() -> None:
    """Another model, another keyword, a generator that runs by itself: each in words, and still."""
    with PulseGeneratorPeer(system="SPULSE", trigger="EXT:MOD") as peer:
        line = {"host": peer.host, "port": peer.port, "answer_s": 0.3}
        other = load_driver("pulse_generator")({"series": "qc-9520", **line}, CONTEXT)
        with pytest.raises(NotConnected, match="expected a 95"):
            other.connect(1.0)
        wrong = load_driver("pulse_generator")({"series": "bnc-575", **line}, CONTEXT)
        with pytest.raises(ConfigRejected, match=r"refuses :PULSE0:STAT 0 \(\?3\)"):
            wrong.connect(1.0)
    with PulseGeneratorPeer() as peer:
        peer.values |= {"PULSE0:STAT": 1.0, "PULSE0:TRIG:MOD": "TRIG", "PULSE2:STAT": 1.0}
        line = {"host": peer.host, "port": peer.port}
        left_on = load_driver("pulse_generator")({"series": "bnc-575", **line}, CONTEXT)
        left_on.connect()
        assert not peer.running and not peer.injects("B")
        assert peer.values["PULSE0:TRIG:MOD"] == "DIS"
        left_on.close()
    for settings, text in (
        ({"camera": "B"}, "both are B"),
        ({"host": None}, "one of the two"),
        ({"series": "bnc-600"}, "series"),
    ):
        with pytest.raises(SceneError, match=text):
            load_driver("pulse_generator")({"series": "bnc-575", "host": "x", **settings}, CONTEXT)


def test_dg645_settings() -> None:
    with pytest.raises(SceneError, match="both are AB"):
        open_dg645({"host": "x", "camera": "AB", "injector": "AB"}, CONTEXT)
    nobody = open_dg645({"host": "127.0.0.1", "port": 1}, CONTEXT)
    with pytest.raises(NotConnected, match="switched on"):
        nobody.connect(0.5)


# Black bodies


@pytest.mark.parametrize("model", ["eurotherm-3200", "ir-2100"])
def test_modbus_agrees_with_minimalmodbus(model: str) -> None:
    """Another Modbus implementation reads, on the serial line, what the driver wrote."""
    minimal = pytest.importorskip("minimalmodbus", reason="minimalmodbus is missing")
    clock = SimulatedClock()
    with ModbusPeer(model, clock=clock, serial=True) as peer:
        device = open_modbus_blackbody(
            {"model": model, "serial": peer.serial, "limits_K": [253.0, 873.0]},
            RigContext(clock, None, Path(), 1),
        )
        device.connect()
        assert device.set_setpoint(440.35) == pytest.approx(440.35, abs=0.05)
        device.close()
        other = minimal.Instrument(peer.serial, 1)
        other.serial.baudrate, other.serial.timeout = 19200, 1.0
        try:
            if model == "eurotherm-3200":
                celsius = other.read_float(0x8000 + 2 * 24)
            else:
                celsius = other.read_register(300, 1, signed=True)
        finally:
            other.serial.close()
    assert celsius == pytest.approx(440.35 - 273.15, abs=0.06)


def test_modbus_writes_a_setpoint_once() -> None:
    """The controller's memory for it wears out."""
    with ModbusPeer("eurotherm-3200") as peer:
        device = open_modbus_blackbody(
            {"model": "eurotherm-3200", "host": peer.host, "port": peer.port,
             "limits_K": [283.0, 873.0]},
            CONTEXT,
        )  # fmt: skip
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


# Camera


def camera_before(peer: GigePeer, client: str, **settings: Any) -> GenicamCamera:
    made: GenicamCamera = load_driver(client)(
        {"address": peer.host, "interface": "127.0.0.1", "calibration": CALIBRATION, **settings},
        CONTEXT,
    )
    return made


@pytest.mark.parametrize("legacy", [False, True])
def test_memory_of_a_genicam_1_0_camera(legacy: bool) -> None:
    """The peer is what the drivers must cope with: in READMEM (0x84) the width's bytes are the
    other way round, in READREG (0x80) they never are; what GigE Vision defines is as ever."""
    with (
        GigePeer((64, 48), legacy=legacy) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        client.settimeout(2.0)

        def ask(command: int, body: bytes) -> bytes:
            head = struct.pack(">BBHHH", 0x42, 1, command, len(body), 1)
            client.sendto(head + body, (peer.host, 3956))
            return client.recv(1024)

        number, other = (64).to_bytes(4, "big"), (64).to_bytes(4, "little" if legacy else "big")
        assert ask(0x80, struct.pack(">I", 0xA000))[8:] == number
        assert ask(0x84, struct.pack(">IHH", 0xA000, 0, 4))[12:] == other
        assert ask(0x84, struct.pack(">IHH", 0x0, 0, 4))[12:] == bytes((0, 1, 0, 2))
        schema = 0 if legacy else 1
        assert f'SchemaMinorVersion="{schema}"'.encode() in ask(
            0x84, struct.pack(">IHH", 0x10000, 0, 512)
        )


@pytest.mark.loopback_only
def test_camera_loses_packets(client: str) -> None:
    """At 0.5 % loss every whole picture is bit-exact, and the resends are few."""
    with GigePeer(loss=0.005, seed=3) as peer:
        camera = camera_before(peer, client)
        camera.connect()
        camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, n_frames=60))
        camera.arm()
        whole = 0
        for number in range(1, 61):
            time.sleep(0.007)
            peer.line()
            (frame,) = camera.read_frames(1, 1.0)
            if frame.complete:
                whole += 1
                assert np.array_equal(frame.data, peer.image(number))
        camera.close()
        # 60 x 83 packets: 25 are lost; a picture is, where a resend is lost too (1 in 5 runs).
        assert peer.lost_packets >= 10 and whole >= 57
        assert whole + camera.statistics()["incomplete"] == 60


@pytest.mark.loopback_only
def test_camera_frames_that_never_come(client: str) -> None:
    """A gap shows in the ids; half a picture is incomplete, and says so."""
    with GigePeer((64, 48)) as peer:
        camera = camera_before(peer, client, packet_size=1000)
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
                (frame,) = camera.read_frames(1, 1.0)
                ids.append(frame.frame_id - number)
        assert len(set(ids)) == 1
        camera.disarm()
        camera.close()


@pytest.mark.loopback_only
def test_camera_is_free_after_its_clients_death(client: str) -> None:
    """A client that dies keeps the camera no longer than the heartbeat; alive, it keeps it."""
    with GigePeer((64, 48)) as peer:
        first = camera_before(peer, client, heartbeat_s=1.5)
        first.connect()
        first.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
        first.arm()
        time.sleep(2.0)  # longer than a heartbeat
        assert peer.armed and peer.controlled
        peer.unheard()
        time.sleep(1.6)
        assert not peer.armed and not peer.controlled
        second = camera_before(peer, client)
        second.connect(5.0)
        assert peer.controlled
        second.close()
        first.close()


@pytest.mark.loopback_only
def test_camera_unplugged(client: str) -> None:
    with GigePeer((64, 48)) as peer:
        camera = camera_before(peer, client)
        camera.connect()
        peer.switch_off()
        with pytest.raises(NotConnected, match="the link failed"):
            camera.prepare(TriggerInfo(TriggerMode.SOFTWARE))
        camera.close()
        with pytest.raises(NotConnected, match="check its power"):
            camera.connect(0.5)


# The runner, unchanged, over sockets


def plan(**changes: Any) -> Plan:
    return Plan.model_validate(
        {
            "backgrounds_K": [440.0, 460.0, 480.0],
            "shots": 3,
            "references": 2,
            "pause_s": 0.0,
            "frame_timeout_s": 0.5,
            "stability": {"tolerance_K": 0.2, "hold_s": 0.1, "settle_s": 0.0, "timeout_s": 20.0},
            **changes,
        }
    )


@pytest.mark.loopback_only
def test_plan_over_sockets(client: str, tmp_path: Path) -> None:
    """Three backgrounds with 0.5 % packet loss, a rate error and a picture that is never sent:
    every shot once and bit-exact, every injection accounted for, all devices safe."""
    with ExitStack() as stack:
        peers = stack.enter_context(PeerRig(camera=GigePeer(loss=0.005, seed=2)))
        data = peers.rig_data()
        data["camera"]["driver"] = client
        rig: Rig = stack.enter_context(open_rig(data))
        seen = 0

        def watch(progress: Any) -> None:
            nonlocal seen
            if progress.done == 4 and not seen:
                peers.camera.skip = seen = 1

        record = acquire(rig, plan(), tmp_path / "a", progress=watch)
        assert record.complete and record.rejected >= 1
        acquisition = open_acquisition(tmp_path / "a")
        assert len(acquisition.shots) == 15 and not acquisition.simulated
        sent = {peers.camera.image(n).tobytes() for n in range(1, peers.camera.taken + 1)}
        pictures = {acquisition.load(shot).tobytes() for shot in acquisition.shots}
        assert len(pictures) == 15 and pictures <= sent
        fired = [
            entry for entry in read_journal(tmp_path / "a" / "journal.jsonl")
            if entry["event"] == "fired"
        ]  # fmt: skip
        assert peers.injections == sum(entry["inject"] for entry in fired) >= 9
        assert peers.generator.triggers == len(fired)
        assert not peers.camera.armed and not peers.generator.injects_on_trigger
        assert peers.blackbody.setpoint_K == pytest.approx(295.0, abs=0.01)
    assert not peers.camera.controlled


@pytest.mark.loopback_only
def test_shots_of_several_frames_over_sockets(tmp_path: Path) -> None:
    """With 0.5 % packet loss: each shot one trigger and four pictures, bit-exact and in order; a
    picture that never comes costs the whole shot, which is taken again; a misfire is found."""
    with ExitStack() as stack:
        peers = stack.enter_context(PeerRig(camera=GigePeer((320, 256), loss=0.005, seed=5)))
        rig: Rig = stack.enter_context(open_rig(peers.rig_data()))

        def watch(progress: Any) -> None:
            if progress.done == 3 and not peers.camera.skipped:
                peers.camera.skip = 1

        record = acquire(rig, plan(frames=4), tmp_path / "a", progress=watch)
        assert record.complete and record.rejected >= 1
        acquisition = open_acquisition(tmp_path / "a")
        images = {peers.camera.image(n).tobytes(): n for n in range(1, peers.camera.taken + 1)}
        for shot in acquisition.shots:
            frames, meta = acquisition.load_frames(shot)
            numbers = [images[frame.tobytes()] for frame in frames]
            assert numbers == list(range(numbers[0], numbers[0] + 4))
            assert len(meta["frame_timestamps_ns"]) == 4
        fired = sum(e["event"] == "fired" for e in read_journal(tmp_path / "a" / "journal.jsonl"))
        assert peers.generator.triggers == fired
        peers.fuel_pressure = False
        with pytest.raises(RetakesExhausted, match="failed injection"):
            acquire(rig, plan(retakes=1), tmp_path / "b")


@pytest.mark.loopback_only
def test_rate_error_ends_the_run_without_a_second_trigger(tmp_path: Path) -> None:
    with PeerRig(camera=GigePeer((64, 48))) as peers:
        peers.generator.fail_rate = 1
        with open_rig(peers.rig_data()) as rig, pytest.raises(FireUncertain, match="rate error"):
            acquire(rig, plan(), tmp_path / "a")
        assert peers.generator.triggers == 0
        events = [e["event"] for e in read_journal(tmp_path / "a" / "journal.jsonl")]
        assert events[-3:] == ["fired", "lost", "made safe"]
        with open_rig(peers.rig_data()) as rig:
            assert acquire(rig, plan(), tmp_path / "a").complete
