"""Drivers of the trigger generators against their peers: what the contract tests do not ask.

The peers are checked by clients that are not ours: the maker's driver of the DG645, and QMI.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import MagicMock

import pytest

from cldit.errors import SceneError
from cldit.rig.clock import Clock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import ConfigRejected, DeviceTimeout, FireUncertain, NotConnected, RigError
from cldit.rig.protocols import Burst
from tests.emulators.dg645 import Dg645Peer
from tests.emulators.pulse_generator import PulseGeneratorPeer
from tests.patience import until

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.dg645 import Dg645, open_dg645
else:
    from cldit.drivers.dg645 import open_dg645

CONTEXT = RigContext(Clock(), None, Path(), 1)


@pytest.fixture
def generator() -> Iterator[Dg645Peer]:
    with Dg645Peer() as peer:
        yield peer


@pytest.fixture
def dg645(generator: Dg645Peer) -> Iterator[Dg645]:
    device = open_dg645({"host": generator.host, "port": generator.port, "answer_s": 30.0}, CONTEXT)
    device.connect()
    yield device
    device.close()


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


def test_dg645_unplugged_and_silent(generator: Dg645Peer, dg645: Dg645) -> None:
    dg645.configure(Burst(inject=True))
    generator.unplug()
    with pytest.raises(RigError):  # it shows before the trigger goes out
        dg645.fire()
    assert generator.triggers == 0
    dg645.connect(0.5)  # plugged in again: nothing fires until it is configured
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
            until(lambda: peer.pulses("A"))
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
        with pytest.raises(ConfigRejected, match=r"rejects :PULSE0:STAT 0 \(\?3\)"):
            wrong.connect(1.0)
        wrong.close()
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
