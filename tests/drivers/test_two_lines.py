"""Two instruments with text commands in one process: pyvisa has one resource manager for both."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cldit.rig.clock import Clock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import DeviceTimeout, NotConnected
from cldit.testing.replies import Fault
from tests.emulators.blackbody import FlukePeer
from tests.emulators.dg645 import Dg645Peer

pyvisa = pytest.importorskip("pyvisa", reason="pyvisa is missing; install cldit[rig]")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")


@pytest.fixture
def peers() -> Iterator[tuple[FlukePeer, Dg645Peer]]:
    with FlukePeer(start_K=310.0) as body, Dg645Peer() as generator:
        yield body, generator


@pytest.fixture
def devices(peers: tuple[FlukePeer, Dg645Peer]) -> Iterator[tuple[Any, Any]]:
    """A black body and a generator, connected."""
    context = RigContext(Clock(), None, Path(), 1)
    places: dict[str, Any] = dict(zip(("fluke418x", "dg645"), peers, strict=True))
    made = [
        load_driver(name)({"host": peer.host, "port": peer.port, "answer_s": 0.2}, context)
        for name, peer in places.items()
    ]
    for device in made:
        device.connect()
    yield made[0], made[1]
    for device in made:
        device.close()


def test_closing_one_leaves_the_other_open(devices: tuple[Any, Any]) -> None:
    body, generator = devices
    generator.close()
    assert body.read_temperature() == pytest.approx(310.0, abs=0.1)
    generator.connect()
    body.close()
    assert generator.read_configuration()["trigger_source"] == 5


def test_losing_one_leaves_the_other_open(
    peers: tuple[FlukePeer, Dg645Peer], devices: tuple[Any, Any]
) -> None:
    body, generator = devices
    body.set_setpoint(420.0)
    peers[1].replies.spoil(Fault.DROP, peers[1].replies.sent + 1)
    with pytest.raises(DeviceTimeout):
        generator.read_configuration()
    assert body.read_configuration()["setpoint_K"] == pytest.approx(420.0, abs=0.01)
    assert generator.make_safe().connected and body.make_safe().did.startswith("heater off")
    assert not peers[0].heating


def test_a_manager_that_somebody_closed(
    peers: tuple[FlukePeer, Dg645Peer], devices: tuple[Any, Any]
) -> None:
    """Other code in this process may close it, and both sessions with it: both are found again."""
    body, generator = devices
    body.set_setpoint(420.0)
    pyvisa.ResourceManager("@py").close()
    for device in devices:
        with pytest.raises(NotConnected):
            device.read_configuration()
    assert "found again" in body.make_safe().did and not peers[0].heating
    assert "found again" in generator.make_safe().did


@pytest.mark.parametrize("answer", [b"NAN", b"inf", b"-INF", b"9.91E37", b"9.9E37", b"1e999", b""])
def test_no_number_is_no_temperature(
    answer: bytes, peers: tuple[FlukePeer, Dg645Peer], devices: tuple[Any, Any]
) -> None:
    """The error names the instrument, the question and the answer."""
    body, peer = devices[0], peers[0]
    peer.replies.spoil(Fault.NAN, peer.replies.sent + 1)
    peer.replies.no_number = answer
    with pytest.raises(NotConnected) as caught:
        body.read_temperature()
    assert f"background: answered {answer.decode()!r} to SOUR:SENS:DATA?" in str(caught.value)
