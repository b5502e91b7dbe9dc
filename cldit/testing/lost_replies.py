"""A lost instrument does not stay on: what every driver must do when an answer is lost or spoiled.

After a lost answer the link is closed, and a make_safe() that takes a closed link for "nothing to
do" leaves a black body hot and an injector armed. A session of a driver before its emulator, of
which reply number n is lost, is no number, is garbage, ends half-way, or comes when nobody waits
for it any more, for every n. After an error the session ends (even n), or connects again and goes
on (odd n). Afterwards, on the instrument's side: heater off or at its safe set point, output
disarmed, camera not armed, never a second injection; on the driver's side: each result is what the
instrument has, or it is one of the rig's errors. Where the instrument stays silent, NotSafe says
what may be on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from cldit.rig.errors import NotConnected, NotSafe, RigError
from cldit.rig.protocols import Safety
from cldit.testing.bed import Bed, Make, Step, opened
from cldit.testing.expect import ContractBroken, expect, refuses
from cldit.testing.replies import Fault

# How long an answer is waited for, and after how long a late one comes. A busy machine may lose an
# answer more by the first, which the contract allows, but not three times in a row.
_ANSWER_s, _LATE_s = 0.1, 0.15
_DEAD_ANSWER_s, _REACH_s = 0.3, 20.0
_SPOILED = [Fault.NAN, Fault.LATE, Fault.GARBAGE, Fault.HALF]
_SAMPLES = 8

C = TypeVar("C")
Numbers = Callable[[int], Sequence[int]]
Faults = Callable[[int], Sequence[Fault]]


def every(replies: int) -> Sequence[int]:
    """The number of each of so many replies."""
    return range(1, replies + 1)


def some(replies: int) -> Sequence[int]:
    """Eight of them, from the first to the last; for cameras, which have many."""
    return sorted({1 + (replies - 1) * part // (_SAMPLES - 1) for part in range(_SAMPLES)})


def lost(number: int) -> Sequence[Fault]:
    """The reply never arrives."""
    return [Fault.DROP]


def spoiled_in_turn(number: int) -> Sequence[Fault]:
    """Another kind reply by reply; with a shift, so that each kind meets even and odd replies."""
    turn = len(_SPOILED)
    return [_SPOILED[(number + number // turn) % turn]]


def any_in_turn(number: int) -> Sequence[Fault]:
    """The same with the lost ones among them."""
    return [list(Fault)[number % len(Fault)]]


def all_faults(number: int) -> Sequence[Fault]:
    """Every kind, one after the other."""
    return list(Fault)


def check_replies(
    make: Make,
    numbers: Numbers,
    faults: Faults,
    settings: Mapping[str, Any] | None = None,
    *,
    at_once: int = 1,
) -> int:
    """A session for each reply and each of its faults; the number of sessions.

    Args:
        make: of `cldit.testing.bed.beds_of`.
        numbers: which replies, of so many.
        faults: what befalls the reply with this number, in a session each.
        settings: of the driver, without the address.
        at_once: sessions side by side, each before an emulator of its own, as most of their time is
            waiting for answers that do not come.

    Raises:
        ContractBroken: one line for each session that went wrong.
    """
    with opened(make, settings) as bed:
        assert bed.replies is not None
        errors = _session(bed, go_on=False)
        expect(not errors, f"without a fault: {errors}")
        expect(bed.device.make_safe().connected, "make_safe() says that it was never connected")
        expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")
        bed.device.close()
        replies = bed.replies.sent

    def session(case: tuple[int, Fault]) -> str:
        number, fault = case
        with opened(make, settings, answer_s=_ANSWER_s) as bed:
            assert bed.replies is not None
            bed.replies.spoil(fault, number, late_s=_LATE_s)
            problem = _problem(bed, go_on=bool(number % 2))
        return f"reply {number} of {replies}, {fault}: {problem}" if problem else ""

    cases = [(number, fault) for number in numbers(replies) for fault in faults(number)]
    _all_right(session, cases, at_once)
    return len(cases)


def check_connect(
    make: Make, settings: Mapping[str, Any] | None = None, *, at_once: int = 1
) -> int:
    """One reply that is lost while it connects is no reason to give up; the number of sessions.

    Args:
        make, settings, at_once: as for `check_replies`.

    Raises:
        ContractBroken: one line for each reply without which it does not connect.
    """
    with opened(make, settings) as bed:
        assert bed.replies is not None
        bed.device.connect()
        replies = bed.replies.sent

    def session(number: int) -> str:
        with opened(make, settings, answer_s=_ANSWER_s) as bed:
            assert bed.replies is not None
            bed.replies.spoil(Fault.DROP, number)
            try:
                bed.device.connect(5.0)
                bed.device.make_safe()
            except RigError as error:
                return f"reply {number} of {replies} lost: {error}"
        return ""

    _all_right(session, every(replies), at_once)
    return replies


def check_dead(make: Make, settings: Mapping[str, Any] | None = None, *, times: int = 2) -> None:
    """Not one answer comes any more after a session: NotSafe says which instrument, where, what it
    was last told and what to do; asked again after it was closed it says so again; when it answers
    again it is made safe.

    Args:
        make, settings: as for `check_replies`.
        times: how often it is asked; each may take seconds.

    Raises:
        ContractBroken: it does not.
    """
    with opened(make, settings, answer_s=_DEAD_ANSWER_s) as bed:
        _session(bed, go_on=False)
        if bed.replies is not None:
            expect(bed.left_on(), "the session leaves nothing on, so that this checks nothing")
            bed.replies.spoil(Fault.DROP, bed.replies.sent + 1, last=10**9)
        begin_s = time.monotonic()
        for _ in range(times):
            error = refuses(bed.device.make_safe, NotSafe, "make_safe() of a dead instrument")
            for text in (*bed.told, "Last known", "By hand"):
                expect(text in str(error), f"{error}; expected {text!r} in it")
            bed.device.close()
        took_s = time.monotonic() - begin_s
        expect(took_s < _REACH_s, f"reaches for it for {took_s:.0f} s, allowed is {_REACH_s:g} s")
        if bed.replies is not None:
            bed.replies.heal()
            did = bed.device.make_safe().did
            expect("found again" in did, f"make_safe() says {did!r}, expected 'found again' in it")
            expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")


def check_states(make: Make, settings: Mapping[str, Any] | None = None) -> None:
    """Never connected, connected, let go of harmless, and let go of hot are different.

    Args:
        make, settings: as for `check_replies`.

    Raises:
        ContractBroken: they are not.
    """
    with opened(make, settings) as bed:
        expect(not bed.device.make_safe().connected, "it says it was connected before connect()")
        bed.device.connect()
        expect(bed.device.make_safe().connected, "it says it was not connected after connect()")
        bed.device.close()
        expect(not bed.device.make_safe().connected, "it says it was connected after close()")
        refuses(bed.device.read_configuration, NotConnected, "after close()", "connect()")
        if bed.replies is None:
            return
        _session(bed, go_on=False)
        bed.device.close()
        expect(bed.device.make_safe().connected, "closed while on, it does not reach for it")
        expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")


def _all_right(session: Callable[[C], str], cases: Sequence[C], at_once: int) -> None:
    """Raises ContractBroken with what each case's session finds wrong; `at_once` of them a time."""
    with ThreadPoolExecutor(at_once) as pool:
        failures = [problem for problem in pool.map(session, cases) if problem]
    expect(not failures, "\n".join(failures))


def _session(bed: Bed, *, go_on: bool) -> list[str]:
    """Each error of the rig's. Raises ContractBroken at once for a result that is wrong."""
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
            expect(step.right(got), f"{step.name} gives {got!r}")
    return errors


def _problem(bed: Bed, *, go_on: bool) -> str:
    """What a session with a fault left wrong; empty where nothing."""
    try:
        _session(bed, go_on=go_on)
    except ContractBroken as error:
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
    if bed.injections > 1:
        return f"{bed.injections} injections"
    return ""
