"""The whole contract of `cldit.testing`, for every installed driver: simulated, or on its emulator.

The first tier has all checks of every variant, and the lost and spoiled answers of one driver of
each family; those of the others are in the second tier.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from cldit.rig.drivers import describe_drivers
from cldit.rig.load import Rig, open_rig
from cldit.testing import lost_replies
from cldit.testing.expect import EVERYTHING, Check
from cldit.testing.replies import LINE_FAULTS
from cldit.testing.run import HARMLESS, OF_BED, OF_KIND, trials
from tests.beds import CAMERAS, FIRST, SIMULATED, cases, make_of
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig
from tests.together import TOGETHER

DEAD, SOME = "dead after its session", "some replies lost, spoiled"


def every_trial() -> Iterator[Any]:
    """Driver, variant and name of a trial, with its tier."""
    for case in cases():
        driver, variant = case.values
        kind = describe_drivers()[driver].kind
        alone = {check.name for check in OF_KIND[kind]} | {"states"}
        quick = alone | {check.name for check in OF_BED.get(kind, [])} | {SOME}
        for name in trials(lambda *_: pytest.fail("not to be made"), kind):
            if driver in SIMULATED and name not in alone | {DEAD}:
                continue  # it has no emulator
            first = case.id in FIRST or name in quick or driver in SIMULATED
            marks = [*case.marks, *([] if first else [pytest.mark.slow])]
            yield pytest.param(driver, variant, name, id=f"{case.id}-{name}", marks=marks)


@pytest.mark.parametrize(("driver", "variant", "name"), list(every_trial()))
def test_contract(driver: str, variant: str, name: str, tiny_rig: dict[str, Any]) -> None:
    kind = describe_drivers()[driver].kind
    unplugged = driver in SIMULATED and name == DEAD and kind not in HARMLESS
    # The time of sessions is waiting, but of several cameras the newest is found.
    work = trials(
        make_of(driver, variant, tiny_rig),
        kind,
        {"unplug_after": 2 if kind == "background" else 1} if unplugged else None,
        at_once=1 if driver in CAMERAS else 4,
    )
    assert work[name]() != "0 sessions"


@pytest.mark.slow
@pytest.mark.parametrize(("driver", "variant"), cases(simulated=False))
def test_each_reply_each_fault(driver: str, variant: str) -> None:
    """Of a camera's some 140 replies, each has one fault."""
    at_once = 1 if driver in CAMERAS else 4
    lost_replies.check_replies(
        make_of(driver, variant, {}), lost_replies.every, LINE_FAULTS,
        in_turn=driver in CAMERAS, at_once=at_once,
    )  # fmt: skip


@pytest.fixture(params=["simulated", pytest.param("sockets", marks=pytest.mark.gige)])
def rig(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Rig]:
    """A rig whose generator triggers its camera, connected."""
    with ExitStack() as stack:
        data = tiny_rig
        if request.param == "sockets":
            for module in ("viva_genicam", "pyvisa_py", "pymodbus"):
                pytest.importorskip(module, reason=f"{module} is missing; install cldit[rig]")
            data = stack.enter_context(PeerRig(camera=GigePeer((64, 48)))).rig_data()
        opened = open_rig(data)
        stack.callback(opened.close)
        opened.connect()
        yield opened


@pytest.mark.parametrize("check", TOGETHER, ids=lambda check: check.name)
def test_together(rig: Rig, check: Check) -> None:
    check.run(rig, EVERYTHING)


def test_a_driver_without_a_bed_fails() -> None:
    """In words, where a package brings one."""
    with pytest.raises(pytest.fail.Exception, match=r"'my_pump' has no emulator.*cldit.emulators"):
        make_of("my_pump", "no bed", {})
