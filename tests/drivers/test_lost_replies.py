"""A lost instrument does not stay on: `cldit.testing.lost_replies`, for every installed
driver before its emulator. See there for what is done, and why."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from cldit.rig.drivers import describe_drivers
from cldit.testing import lost_replies
from cldit.testing.bed import opened
from cldit.testing.expect import EVERYTHING, Check
from cldit.testing.replies import LINE_FAULTS, Fault
from cldit.testing.triggers import PULSES
from tests.beds import CAMERAS, MANY, cases, make_of

ON_LINES = cases(simulated=False, cameras=False)
CAN_STAY_ON = cases(simulated=False, cameras=False, harmless=False)
SHORT = [case for case in ON_LINES if case.values[0] not in MANY]
GENERATORS = [case for case in ON_LINES if describe_drivers()[case.values[0]].kind == "trigger"]
# Sessions side by side: their time is waiting. More of them would hold each other's answers up.
AT_ONCE = 4


@pytest.mark.parametrize(("driver", "variant"), SHORT)
def test_each_reply_lost(driver: str, variant: str) -> None:
    make = make_of(driver, variant, {})
    sessions = lost_replies.check_replies(make, lost_replies.every, [Fault.DROP], at_once=AT_ONCE)
    assert sessions > 5


@pytest.mark.parametrize(("driver", "variant"), SHORT)
def test_each_reply_spoiled(driver: str, variant: str) -> None:
    """The kinds of faults in turn; all of each in the slow test."""
    make = make_of(driver, variant, {})
    lost_replies.check_replies(make, lost_replies.every, lost_replies.SPOILED, at_once=AT_ONCE)


@pytest.mark.parametrize(
    ("driver", "variant"),
    [
        pytest.param(*case.values, id=case.id, marks=[] if case in SHORT else pytest.mark.slow)
        for case in ON_LINES
    ],
)
def test_a_reply_lost_while_it_connects(driver: str, variant: str) -> None:
    assert lost_replies.check_connect(make_of(driver, variant, {}), at_once=AT_ONCE) > 0


@pytest.mark.parametrize(
    ("driver", "variant"),
    [case for case in cases() if case.id in ("gige_camera-gige", "pulse_generator-bnc575-tcp")],
)
def test_some_replies_of_many(driver: str, variant: str) -> None:
    """Eight replies from the first to the last, each fault at least once; all in the slow test."""
    make = make_of(driver, variant, {})
    lost_replies.check_replies(make, lost_replies.some, LINE_FAULTS)


@pytest.mark.slow
@pytest.mark.parametrize(("driver", "variant"), cases(simulated=False))
def test_each_reply_each_fault(driver: str, variant: str) -> None:
    """Of a camera's some 140 replies, each lost by one variant, each spoiled by the other."""
    faults = LINE_FAULTS
    if driver in CAMERAS:
        faults = [Fault.DROP] if variant == "gige" else lost_replies.SPOILED
    lost_replies.check_replies(
        make_of(driver, variant, {}),
        lost_replies.every,
        faults,
        in_turn=driver in CAMERAS,
        at_once=1 if driver in CAMERAS else AT_ONCE,  # a camera is found by its port
    )


@pytest.fixture(scope="module")
def dead() -> Iterator[dict[tuple[str, str], Future[None]]]:
    """What becomes of each driver on a line, all at once: each waits seconds for a dead one."""

    def check(driver: str, variant: str) -> None:
        lost_replies.check_dead(make_of(driver, variant, {}), times=2)

    lines = [
        (str(driver), str(variant)) for driver, variant in (case.values for case in CAN_STAY_ON)
    ]
    with ThreadPoolExecutor(len(lines)) as pool:
        yield {line: pool.submit(check, *line) for line in lines}


@pytest.mark.parametrize(("driver", "variant"), CAN_STAY_ON)
def test_dead_after_its_session(
    driver: str, variant: str, dead: dict[tuple[str, str], Future[None]]
) -> None:
    dead[driver, variant].result()


@pytest.mark.parametrize(
    ("driver", "variant"),
    [
        case
        for case in cases(slow_cameras=True, harmless=False)
        if case.id not in {line.id for line in ON_LINES}
    ],
)
def test_dead_camera_or_simulated(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    times = 1 if driver in CAMERAS else 2  # they take seconds
    lost_replies.check_dead(make_of(driver, variant, tiny_rig), times=times)


@pytest.mark.parametrize(("driver", "variant"), cases())
def test_states(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    lost_replies.check_states(make_of(driver, variant, tiny_rig))


@pytest.mark.parametrize("check", PULSES, ids=lambda check: check.name)
@pytest.mark.parametrize(("driver", "variant"), GENERATORS)
def test_pulses(driver: str, variant: str, check: Check) -> None:
    with opened(make_of(driver, variant, {})) as bed:
        bed.device.connect()
        check.run(bed, EVERYTHING)


def test_a_driver_without_a_bed_fails() -> None:
    """In words, where a package brings one."""
    with pytest.raises(pytest.fail.Exception, match=r"'my_pump' has no emulator.*cldit.emulators"):
        make_of("my_pump", "no bed", {})
