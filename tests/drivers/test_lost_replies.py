"""A lost instrument does not stay on: what every driver must do when an answer is lost or spoiled.

Rationale: after a lost answer the link is closed, and a make_safe() that takes a closed link for
"nothing to do" leaves a black body hot and an injector armed.
Set-up: a session (connect, configure, arm, fire or read, make_safe, close) of each installed driver
before its peer, of which reply number n is lost, is no number, is garbage, ends half-way, or comes
when nobody waits for it any more, for every n. After an error the session ends (even n), or
connects again and goes on (odd n).
Expected, on the instrument's side: heater off or at its safe set point, output disarmed, camera not
armed, never a second injection; on the driver's side: each result is what the instrument has, or
it is one of the rig's errors. Where the instrument stays silent, NotSafe says what may be on.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest

from cldit.rig.drivers import describe_drivers
from cldit.rig.errors import NotConnected, NotSafe, RigError
from cldit.rig.protocols import Safety
from tests.beds import BEDS, Bed, bed_of
from tests.sessions import Step

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.emulators.replies import Fault
else:
    from cldit.drivers.emulators.replies import Fault

# How long an answer is waited for, and after how long a late one comes. A busy machine may lose an
# answer more by the first, which the contract allows, but not three times in a row.
_ANSWER_s, _LATE_s = 0.1, 0.15
_CAMERAS = ("gige_camera", "aravis_camera")  # a session takes a second, and has many replies


def _cases(
    *, simulated: bool = True, cameras: bool = True, slow_cameras: bool = False
) -> list[Any]:
    """Every bed of every installed driver; a driver without one fails. What is simulated has no
    replies that could be lost."""
    camera_marks = [pytest.mark.loopback_only, *([pytest.mark.slow] if slow_cameras else [])]
    return [
        pytest.param(
            name,
            variant,
            id=f"{name}-{variant}",
            marks=camera_marks if name in _CAMERAS else [],
        )
        for name, about in describe_drivers().items()
        if about.kind != "bench"
        and (simulated or about.tested != "simulated")
        and (cameras or name not in _CAMERAS)
        for variant in BEDS.get(name, {"no bed": None})
    ]


def _session(bed: Bed, *, go_on: bool) -> list[str]:
    """Each error of the rig's; a result that is wrong fails at once."""
    errors: list[str] = []
    for step in [Step("connect", bed.device.connect), *bed.steps]:
        try:
            got = step.call()
        except RigError as error:
            errors.append(f"{step.name}: {error}")
            if not go_on:
                break
            try:
                bed.device.connect()
            except RigError:
                break
        else:
            assert step.right(got), f"{step.name} gives {got!r}"
    return errors


def _check(driver: str, variant: str, rig: dict[str, Any], numbers: Any, faults: Any) -> None:
    """A session for each number and its faults."""
    with bed_of(driver, variant, rig) as bed:
        assert bed.replies is not None
        assert _session(bed, go_on=False) == []
        assert bed.device.make_safe().connected and not bed.left_on()
        bed.device.close()
        replies = bed.replies.sent
    failures = []
    for number in numbers(replies):
        for fault in faults(number):
            with bed_of(driver, variant, rig, answer_s=_ANSWER_s) as bed:
                assert bed.replies is not None
                bed.replies.spoil(fault, number, late_s=_LATE_s)
                problem = _problem(bed, go_on=bool(number % 2))
                if problem:
                    failures.append(f"reply {number} of {replies}, {fault}: {problem}")
    assert not failures, "\n".join(failures)


def _problem(bed: Bed, *, go_on: bool) -> str:
    """What a session with a fault left wrong; empty where nothing."""
    try:
        _session(bed, go_on=go_on)
    except AssertionError as error:
        return str(error)
    hot = bed.left_on()
    try:
        safety = bed.device.make_safe()
    except RigError as error:
        return f"not made safe: {error}"
    if not isinstance(safety, Safety):
        return f"make_safe() gives {safety!r}"
    if bed.left_on():
        return f"make_safe() did {safety.did!r}, and the instrument is left on: {bed.left_on()}"
    if hot and not safety.connected:
        return f"make_safe() says that it was never connected, but it was on: {hot}"
    bed.device.close()
    if bed.left_on():
        return f"on after close(): {bed.left_on()}"
    if bed.injections() > 1:
        return f"{bed.injections()} injections"
    return ""


@pytest.mark.parametrize(("driver", "variant"), _cases(simulated=False, cameras=False))
def test_each_reply_lost(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    _check(driver, variant, tiny_rig, lambda n: range(1, n + 1), lambda n: [Fault.DROP])


@pytest.mark.parametrize(("driver", "variant"), _cases(simulated=False, cameras=False))
def test_each_reply_spoiled(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    """The kinds of faults in turn; all of each in the slow test."""
    kinds = [Fault.NAN, Fault.LATE, Fault.GARBAGE, Fault.HALF]
    turn = len(kinds)  # with another turn of reply by reply, each kind meets even and odd replies
    _check(
        driver,
        variant,
        tiny_rig,
        lambda n: range(1, n + 1),
        lambda n: [kinds[(n + n // turn) % turn]],
    )


@pytest.mark.parametrize(
    ("driver", "variant"), [case for case in _cases() if case.values[0] in _CAMERAS]
)
def test_some_replies_of_cameras(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    """Eight replies from the first to the last, each fault at least once; all in the slow test."""
    kinds = list(Fault)
    _check(
        driver,
        variant,
        tiny_rig,
        lambda n: sorted({1 + (n - 1) * part // 7 for part in range(8)}),
        lambda n: [kinds[n % len(kinds)]],
    )


@pytest.mark.slow
@pytest.mark.parametrize(("driver", "variant"), _cases(simulated=False))
def test_each_reply_each_fault(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    """Of a camera's some 140 replies, each lost and each with one other fault in turn."""

    def faults(number: int) -> list[Fault]:
        kinds = list(Fault)
        return [Fault.DROP, kinds[1 + number % 4]] if driver in _CAMERAS else kinds

    _check(driver, variant, tiny_rig, lambda n: range(1, n + 1), faults)


@pytest.mark.parametrize(("driver", "variant"), _cases(slow_cameras=True))
def test_dead_after_its_session(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    """Not one answer comes any more: NotSafe says which instrument, where, what it was last told
    and what to do; asked again after it was closed it says so again; when it answers again it is
    made safe."""
    with bed_of(driver, variant, tiny_rig, answer_s=0.3) as bed:
        _session(bed, go_on=False)
        if bed.replies is not None:
            assert bed.left_on()
            bed.replies.spoil(Fault.DROP, bed.replies.sent + 1, last=10**9)
        begin = time.monotonic()
        for _ in range(1 if driver in _CAMERAS else 2):  # they take seconds
            with pytest.raises(NotSafe) as caught:
                bed.device.make_safe()
            for text in (*bed.told, "Last known", "By hand"):
                assert text in str(caught.value), caught.value
            bed.device.close()
        assert time.monotonic() - begin < 20.0  # reaching for it is bounded
        if bed.replies is not None:
            bed.replies.heal()
            assert "found again" in bed.device.make_safe().did and not bed.left_on()


def test_a_driver_without_a_bed_fails(tiny_rig: dict[str, Any]) -> None:
    """In words, where a package brings one."""
    with pytest.raises(
        pytest.fail.Exception, match=r"'my_pump' is installed, but .* tests/beds.py"
    ):
        with bed_of("my_pump", "no bed", tiny_rig):
            pass


@pytest.mark.parametrize(("driver", "variant"), _cases())
def test_states(driver: str, variant: str, tiny_rig: dict[str, Any]) -> None:
    """Never connected, connected, let go of harmless, and let go of hot are different."""
    with bed_of(driver, variant, tiny_rig) as bed:
        assert not bed.device.make_safe().connected
        bed.device.connect()
        assert bed.device.make_safe().connected
        bed.device.close()
        assert not bed.device.make_safe().connected
        with pytest.raises(NotConnected, match=r"connect\(\)"):
            bed.device.read_configuration()
        if bed.replies is None:
            return
        _session(bed, go_on=False)
        bed.device.close()
        assert bed.device.make_safe().connected and not bed.left_on()
