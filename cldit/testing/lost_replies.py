"""Contract of drivers after a lost or damaged answer: no instrument is left on.

After a lost answer the link is closed, and a make_safe() that takes a closed link for "nothing to
do" leaves a black body hot and an injector armed. Here a driver runs a session with its emulator in
which reply number n is lost, is not a number, is garbage, ends half-way, or arrives too late, for
every n. After an error the session ends (even n), or connects again and continues (odd n).
Afterwards the instrument must have its heater off or at its safe set point, its output disarmed,
its camera not armed, and never a second injection; each result of the driver must agree with the
instrument or be a RigError. If the instrument stays silent, NotSafe must say what may be on.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from cldit.rig.errors import NotConnected, NotSafe, RigError
from cldit.rig.protocols import Safety
from cldit.testing.bed import Bed, Make, Step, opened, problem_of
from cldit.testing.expect import ContractBroken, HANG_s, expect, refuses
from cldit.testing.replies import Fault

_ANSWER_s, _LATE = 0.1, 1.5  # time to wait for an answer; delay of a late one over that
_DEAD_ANSWER_s = 0.3
SPOILED = [Fault.NAN, Fault.LATE, Fault.GARBAGE, Fault.HALF]
_SAMPLES = 8

C = TypeVar("C")
Numbers = Callable[[int], Sequence[int]]


def every(replies: int) -> Sequence[int]:
    """Numbers of all replies."""
    return range(1, replies + 1)


def some(replies: int) -> Sequence[int]:
    """Numbers of eight replies, from the first to the last; for cameras, which send many."""
    return sorted({1 + (replies - 1) * part // (_SAMPLES - 1) for part in range(_SAMPLES)})


def check_replies(
    make: Make,
    numbers: Numbers,
    faults: Sequence[Fault],
    settings: Mapping[str, Any] | None = None,
    *,
    in_turn: bool = True,
    at_once: int = 1,
) -> int:
    """Runs a session for each reply and each of its faults, and returns the number of sessions.

    Args:
        make: from `cldit.testing.bed.beds_of`.
        numbers: gives the numbers of the replies to damage, from the number of all replies.
        faults: of the replies, `LINE_FAULTS` or some of them.
        settings: of the driver, without the address.
        in_turn: each reply has the next fault, each fault with even and odd numbers; False: each
            reply has each fault.
        at_once: sessions in parallel, each with its own emulator, because they mostly wait for
            answers that do not arrive.

    Raises:
        ContractBroken: one line for each session that failed.
    """
    with opened(make, settings) as bed:
        assert bed.replies is not None
        errors = session(bed)
        expect(not errors, f"without a fault: {errors}")
        expect(bed.device.make_safe().connected, "make_safe() says that it was never connected")
        expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")
        bed.device.close()
        replies = bed.replies.sent

    def one(case: tuple[int, Fault]) -> str:
        number, fault = case

        def check(answer_s: float) -> None:
            with opened(make, settings, answer_s=answer_s) as bed:
                assert bed.replies is not None
                bed.replies.spoil(fault, number, late_s=_LATE * answer_s)
                problem = _problem(bed, go_on=bool(number % 2))
            expect(not problem, f"reply {number} of {replies}, {fault}: {problem}")

        return problem_of(check, answer_s=_ANSWER_s)

    turn = len(faults)
    cases = [
        (number, fault)
        for index, number in enumerate(numbers(replies))
        for fault in ([faults[(index + index // turn) % turn]] if in_turn else faults)
    ]
    all_right(one, cases, at_once)
    return len(cases)


def check_connect(
    make: Make, settings: Mapping[str, Any] | None = None, *, at_once: int = 1
) -> int:
    """Checks that it connects in spite of any one lost reply, and returns the number of sessions.

    Args:
        make, settings, at_once: as for `check_replies`.

    Raises:
        ContractBroken: one line for each reply without which it does not connect.
    """
    with opened(make, settings) as bed:
        assert bed.replies is not None
        bed.device.connect()
        replies = bed.replies.sent

    def one(number: int) -> str:
        def check(answer_s: float) -> None:
            with opened(make, settings, answer_s=answer_s) as bed:
                assert bed.replies is not None
                bed.replies.spoil(Fault.DROP, number)
                bed.device.connect(50.0 * answer_s)
                bed.device.make_safe()

        problem = problem_of(check, answer_s=_ANSWER_s)
        return f"reply {number} of {replies} lost: {problem}" if problem else ""

    all_right(one, every(replies), at_once)
    return replies


def check_dead(make: Make, settings: Mapping[str, Any] | None = None) -> None:
    """Checks an instrument that is silent after a session.

    NotSafe must name the instrument, its address, its last known settings and what to do; an
    instrument that answers again, also after close(), must be made safe.

    Args:
        make, settings: as for `check_replies`.

    Raises:
        ContractBroken: the driver does otherwise.
    """
    with opened(make, settings, answer_s=_DEAD_ANSWER_s) as bed:
        session(bed)
        if bed.replies is not None:
            expect(bed.left_on(), "the session leaves nothing on, so nothing is checked")
            bed.replies.spoil(Fault.DROP, bed.replies.sent + 1, last=10**9)
        begin_s = time.monotonic()
        error = refuses(bed.device.make_safe, NotSafe, "make_safe() of a dead instrument")
        took_s = time.monotonic() - begin_s
        for part in (*bed.told, "Last known", "By hand"):
            expect(part in str(error), f"{error}; expected {part!r} in it")
        expect(took_s < HANG_s, f"tries to reach it for {took_s:.0f} s; allowed: {HANG_s:g} s")
        bed.device.close()
        if bed.replies is not None:
            bed.replies.heal()
            did = bed.device.make_safe().did
            expect("found again" in did, f"make_safe() says {did!r}, expected 'found again' in it")
            expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")


def check_states(make: Make, settings: Mapping[str, Any] | None = None) -> None:
    """Checks that a device distinguishes four states: never connected, connected, closed while
    harmless, and closed while on.

    Args:
        make, settings: as for `check_replies`.

    Raises:
        ContractBroken: it does not.
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
        session(bed)
        left_on = bed.left_on()
        bed.device.close()
        if left_on:
            safety = bed.device.make_safe()
            expect(safety.connected, "closed while on, it does not connect again")
        expect(not bed.left_on(), f"on after make_safe(): {bed.left_on()}")


def check_idle(make: Make, settings: Mapping[str, Any] | None = None) -> int:
    """Runs a session in which the emulator closes the connection before one step, for each step, as
    instruments and gateways close idle ones: it continues as if nothing had happened.

    Args:
        make, settings: as for `check_replies`.

    Returns:
        Number of sessions.

    Raises:
        ContractBroken: a line for each step that failed, returned something wrong, or after which
            the instrument is left on or has injected twice.
    """
    problems: list[str] = []
    with opened(make, settings) as bed:
        steps = bed.steps if bed.hang_up is not None else []
    for number, name in enumerate(step.name for step in steps):
        with opened(make, settings) as bed:
            assert bed.hang_up is not None
            bed.device.connect()
            for index, step in enumerate(bed.steps):
                if index == number:
                    bed.hang_up()
                try:
                    if not step.right(step.call()):
                        problems.append(f"closed before {name}: {step.name} returned a wrong value")
                except RigError as error:
                    if name != "fire":  # only the session that configured a burst sends it
                        problems.append(f"closed before {name}: {step.name}: {error}")
                    break
            bed.hang_up()
            bed.device.make_safe()
            if bed.left_on() or bed.injections > 1:
                state = f"left on: {bed.left_on()}, {bed.injections} injections"
                problems.append(f"closed before {name}: {state}")
    expect(not problems, "\n".join(problems))
    return len(steps)


def all_right(check: Callable[[C], str], cases: Sequence[C], at_once: int) -> None:
    """Raises ContractBroken with the problems of all cases.

    Args:
        check: gives the problem of a case, empty if there is none.
        cases, at_once: cases, and sessions in parallel.
    """
    with ThreadPoolExecutor(at_once) as pool:
        failures = [problem for problem in pool.map(check, cases) if problem]
    expect(not failures, "\n".join(failures))


def session(bed: Bed, *, go_on: bool = False) -> list[str]:
    """RigErrors of the session of a `bed`, which connects again after each with `go_on`; a wrong
    result raises ContractBroken at once."""
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
            expect(step.right(got), f"{step.name} returned {got!r}")
    return errors


def _problem(bed: Bed, *, go_on: bool) -> str:
    """Problem after a session with a fault; empty if there is none."""
    try:
        session(bed, go_on=go_on)
    except ContractBroken as error:
        return str(error)
    hot = bed.left_on()
    try:
        safety = bed.device.make_safe()
    except RigError as error:
        return f"not made safe: {error}"
    if not isinstance(safety, Safety):
        return f"make_safe() returned {safety!r}"
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
