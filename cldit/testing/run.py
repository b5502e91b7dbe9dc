"""Runs the contract for a driver: on its emulators, or the safe part of it on an instrument."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

from cldit.io.plain_data import parse_json
from cldit.rig.errors import NotConnected, RigError
from cldit.rig.protocols import KINDS, Device
from cldit.testing import lost_replies
from cldit.testing.backgrounds import BACKGROUND
from cldit.testing.bed import Make, beds_of, opened
from cldit.testing.cameras import CAMERA
from cldit.testing.expect import (
    EVERYTHING,
    Allowed,
    Check,
    ContractBroken,
    NotAllowed,
    expect,
    refuses,
)
from cldit.testing.implausible import check_implausible
from cldit.testing.replies import LINE_FAULTS, Fault
from cldit.testing.triggers import PULSES, TRIGGER
from cldit.testing.wheels import FAULTS, WHEEL, check_spoiled


def _life(device: Device, allowed: Allowed) -> None:
    """Checks that connect, make_safe and close may be repeated, and the error before connect."""
    device.make_safe()
    device.close()
    refuses(device.read_configuration, NotConnected, "before connect()", "connect")
    device.connect()
    device.connect()
    stored = parse_json(json.dumps(device.read_configuration(), allow_nan=False))
    expect(stored, "read_configuration() is empty")
    device.make_safe()
    device.make_safe()
    device.close()
    device.close()
    refuses(device.read_configuration, NotConnected, "after close()")
    device.connect()
    expect(device.read_configuration(), "read_configuration() is empty when connected again")


def _identity(device: Device, allowed: Allowed) -> None:
    """Checks that kind, maker and model are given."""
    info = device.identify()
    expect(info.kind in KINDS, f"kind: {info.kind!r}")
    expect(info.maker and info.model, f"{info} lacks maker or model")


LIFE = Check("life", "connects, makes safe and closes, several times", _life)
IDENTITY = Check("identity", "reads its identity", _identity)

OF_KIND: dict[str, list[Check]] = {
    "camera": [LIFE, IDENTITY, *CAMERA],
    "filter_wheel": [LIFE, IDENTITY, *WHEEL],
    "background": [LIFE, IDENTITY, *BACKGROUND],
    "trigger": [LIFE, IDENTITY, *TRIGGER],
}
"""Checks of a device of each kind, in order; the first one connects it."""
OF_BED: dict[str, list[Check]] = {"filter_wheel": FAULTS, "trigger": PULSES}
"""Checks of a whole bed, for kinds whose emulator shows or does more than the device."""
HARMLESS: dict[str, Callable[..., int]] = {"filter_wheel": check_spoiled}
"""Kinds that are harmless in every state, each with the check of its spoiled answers."""


class Verdict(StrEnum):
    """Verdict of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Result:
    """Result of a check.

    where: variant of the emulator, or `instrument`. text: the violation, the reason for skipping,
    or the number of trials. seconds: duration.
    """

    where: str
    name: str
    verdict: Verdict
    text: str
    seconds: float


def on_emulators(
    driver: str, kind: str, settings: Mapping[str, Any] | None = None, *, all_faults: bool = False
) -> Iterator[Result]:
    """Runs the contract on all emulators of a driver, with lost and damaged replies.

    Args:
        driver: its name.
        kind: one of `OF_KIND`.
        settings: of the driver, without the address.
        all_faults: tries each fault of each reply, which takes minutes; otherwise one of them each.

    Returns:
        Results, each as its check ends.

    Raises:
        SceneError: there is no emulator, or the driver rejects the settings.
    """
    for variant, make in beds_of(driver).items():
        for name, trial in trials(make, kind, settings, all_faults=all_faults).items():
            yield _tried(variant, name, trial)


def on_instrument(
    device: Any, kind: str, allowed: Allowed, *, pause_s: float = 1.0
) -> Iterator[Result]:
    """Runs the part of the contract that is safe on an instrument; the caller makes it safe.

    Args:
        device: not connected.
        kind: one of `OF_KIND`.
        allowed: limits of the checks.
        pause_s: time between checks.

    Returns:
        Results, each as its check ends. If the connection fails, the rest is not tried.
    """
    for number, check in enumerate(OF_KIND[kind]):
        if number:
            time.sleep(pause_s)
        if kind == "camera":  # the check before may have left it armed
            with suppress(RigError):
                device.disarm()
        result = _tried("instrument", check.name, partial(check.run, device, allowed))
        yield result
        if result.verdict is Verdict.FAILED and check is LIFE:
            return


def _alone(make: Make, settings: Mapping[str, Any] | None, check: Check, *, with_bed: bool) -> None:
    """Runs a check on its own bed: of the whole bed, or of its device alone."""
    with opened(make, settings) as bed:
        if check is not LIFE:
            bed.device.connect()
        check.run(bed if with_bed else bed.device, EVERYTHING)


def trials(
    make: Make,
    kind: str,
    settings: Mapping[str, Any] | None = None,
    *,
    all_faults: bool = False,
    at_once: int = 1,
) -> dict[str, Callable[[], object]]:
    """Everything that is tried on an emulator, by name.

    Args:
        make: from `cldit.testing.bed.beds_of`.
        kind: one of `OF_KIND`.
        settings: of the driver, without the address.
        all_faults: tries each fault of each reply; otherwise one of them each.
        at_once: sessions in parallel, for trials of many.

    Returns:
        Functions without arguments, which raise what a check raises. Those of trials with many
        sessions return their number in words.
    """

    def sessions(check: Callable[..., int], *args: Any, **options: Any) -> Callable[[], str]:
        return lambda: f"{check(make, *args, settings, **options)} sessions"

    def replies(numbers: lost_replies.Numbers, faults: list[Fault]) -> Callable[[], str]:
        return sessions(
            lost_replies.check_replies, numbers, faults, in_turn=not all_faults, at_once=at_once
        )

    work: dict[str, Callable[[], object]] = {
        check.name: partial(_alone, make, settings, check, with_bed=with_bed)
        for checks, with_bed in ((OF_KIND[kind], False), (OF_BED.get(kind, []), True))
        for check in checks
    }
    work["states"] = partial(lost_replies.check_states, make, settings)
    if all_faults:
        work["each reply, each fault"] = replies(lost_replies.every, LINE_FAULTS)
    elif kind == "camera":
        work["some replies lost, spoiled"] = replies(lost_replies.some, LINE_FAULTS)
    else:
        work["each reply lost"] = replies(lost_replies.every, [Fault.DROP])
        work["each reply spoiled"] = replies(lost_replies.every, lost_replies.SPOILED)
    if kind != "camera":
        connect = sessions(lost_replies.check_connect, at_once=at_once)
        work["a reply lost while it connects"] = connect
    work["sessions closed while idle"] = sessions(lost_replies.check_idle)
    if kind in HARMLESS:
        work["spoiled answers"] = sessions(HARMLESS[kind])
    else:
        work["readings that cannot be"] = sessions(check_implausible, at_once=at_once)
        work["dead after its session"] = partial(lost_replies.check_dead, make, settings)
    return work


def _tried(where: str, name: str, work: Callable[[], object]) -> Result:
    begin_s = time.monotonic()
    try:
        outcome = work()
        verdict, message = Verdict.PASSED, outcome if isinstance(outcome, str) else ""
    except NotAllowed as error:
        verdict, message = Verdict.SKIPPED, str(error)
    except Exception as error:  # errors of any class violate the contract
        kind = "" if isinstance(error, ContractBroken) else f"{type(error).__name__}: "
        verdict, message = Verdict.FAILED, f"{kind}{error}"
    return Result(where, name, verdict, message, time.monotonic() - begin_s)
