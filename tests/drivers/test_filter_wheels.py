"""The FW102C with its emulator, beyond the contract of filter wheels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.errors import SceneError
from cldit.rig import locks
from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import ConfigRejected, DeviceTimeout, NotConnected
from cldit.rig.protocols import FilterWheel
from tests.emulators.beds import FILTERS, line_to
from tests.emulators.filter_wheel import FilterWheelPeer

if TYPE_CHECKING:  # the same file, by the name under which mypy finds it
    from drivers.fw102c import open_fw102c
else:
    from cldit.drivers.fw102c import open_fw102c


@contextmanager
def wheel(peer: FilterWheelPeer, clock: Any = None, **settings: Any) -> Iterator[Any]:
    """A driver, closed at the end."""
    context = RigContext(clock or Clock(), None, Path(), 1)
    usual = {"filters": FILTERS, "moving_s": 0.3, "answer_s": 0.1}
    made: FilterWheel = open_fw102c({**usual, **line_to(peer), **settings}, context)
    try:
        yield made
    finally:
        made.close()


def test_the_prompt_may_come_at_the_end_of_a_move() -> None:
    """The move takes twice the time to wait for an answer, and no answer is taken for lost."""
    with FilterWheelPeer(takes_s=0.2, waits=True) as peer, wheel(peer) as device:
        device.connect()
        device.move("droplets")
        assert peer.position == 2 and peer.commands.count("pos=2") == 1


def test_a_wheel_that_is_slower_than_stated() -> None:
    clock = SimulatedClock()
    with FilterWheelPeer(takes_s=2.0, clock=clock) as peer, wheel(peer, clock) as device:
        device.connect()
        with pytest.raises(DeviceTimeout, match=r"is at position 1 0\.3 s after 2 \(droplets\)"):
            device.move("droplets")
        clock.sleep(2.0)
        assert device.read_filter() == "droplets"


def test_what_could_move_the_wheel_or_hide_it_is_set() -> None:
    with FilterWheelPeer() as peer, wheel(peer) as device:
        device.connect()
        assert {"trig=1", "sensors=1", "speed=1"} <= set(peer.commands)
        assert "save" not in peer.commands and not any("pos=" in c for c in peer.commands)
    with FilterWheelPeer() as peer, wheel(peer, sensors=False, fast=False) as device:
        device.connect()
        assert {"trig=1", "sensors=0", "speed=0"} <= set(peer.commands)


@pytest.mark.parametrize("serial", [False, True])
def test_it_is_locked_while_used(serial: bool) -> None:
    with FilterWheelPeer(serial=serial) as peer, wheel(peer) as device:
        device.connect()
        assert [name for name in locks._HELD if str(peer.serial or peer.port) in name]
        device.close()
        assert not locks._HELD


def test_another_instrument_is_refused() -> None:
    with FilterWheelPeer(identity="ACME,9000,1,2") as peer, wheel(peer) as device:
        with pytest.raises(NotConnected, match="expected an FW102C or FW212C"):
            device.connect(1.0)


def test_more_positions_than_the_wheel_has() -> None:
    filters = [FILTERS[0], {**FILTERS[1], "position": 8}]
    with FilterWheelPeer(size=6) as peer, wheel(peer, filters=filters) as device:
        with pytest.raises(ConfigRejected, match=r"droplets: position 8; allowed: 1\.\.6"):
            device.connect()
    with FilterWheelPeer(size=12) as peer, wheel(peer, filters=filters) as device:
        device.connect()
        peer.turn()
        assert device.read_filter() is None  # at position 2 there is no filter


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"filters": []}, "filters: none; allowed: one filter or more"),
        ({"filters": [FILTERS[0], FILTERS[0]]}, "filters: position: 1 twice"),
        ({"filters": [{**FILTERS[0], "filter_um": [3.5, 3.3]}]}, "3.5 to 3.3 is empty"),
        ({"filters": [{**FILTERS[0], "name": "a/b"}]}, "filters[0].name"),
        ({"filters": [{**FILTERS[0], "position": 0}]}, "filters[0].position: 0 is outside 1..100"),
        ({"filters": [{"name": "a"}]}, "filters[0].position: is missing"),
        ({"serial": "/dev/ttyUSB0", "host": "here"}, "host, serial: allowed: one of the two"),
        ({"moving": 1.0}, "moving: unknown key; did you mean moving_s?"),
    ],
)
def test_refused_settings(change: dict[str, Any], message: str) -> None:
    context = RigContext(SimulatedClock(), None, Path(), 1)
    settings = {"serial": "/dev/ttyUSB0", "filters": FILTERS, **change}
    with pytest.raises(SceneError) as caught:
        load_driver("fw102c")(settings, context)
    assert message in str(caught.value)


def test_a_transmission_file_is_relative_to_the_rig_file(tmp_path: Path) -> None:
    (tmp_path / "narrow.csv").write_text("3.3,0\n3.4,0.9\n3.5,0\n")
    context = RigContext(SimulatedClock(), None, tmp_path, 1)
    filters = [{**FILTERS[0], "filter_um": "narrow.csv"}]
    made = load_driver("fw102c")({"serial": "/dev/ttyUSB0", "filters": filters}, context)
    assert made.filters[0].filter_um == ((3.3, 0.0), (3.4, 0.9), (3.5, 0.0))


def test_the_calibration_is_that_through_the_filter() -> None:
    """Counts per radiance follow the exposure, and the offset is the camera's unless stated."""
    camera = {
        "integration_time_s": 50e-6,
        "calibration": {
            "filter_um": [1.0, 5.0],
            "counts_per_radiance": 7e-18,
            "offset_counts": 1000.0,
            "electrons_per_count": 430.0,
            "read_noise_electrons": 200.0,
            "saturation_counts": 16383,
        },
    }
    context = RigContext(SimulatedClock(), None, Path(), 1)
    made = load_driver("fw102c")({"serial": "/dev/ttyUSB0", "filters": FILTERS}, context)
    fuel, droplets = (item.calibration(camera) for item in made.filters)
    assert fuel["filter_um"] == [3.3, 3.5] and fuel["offset_counts"] == 1000.0
    assert fuel["counts_per_radiance"] == pytest.approx(2e-18, rel=1e-12)
    assert droplets["filter_um"][1] == [3.9, 0.8] and droplets["offset_counts"] == 900.0
    assert droplets["saturation_counts"] == 16383
