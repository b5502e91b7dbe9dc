"""The contract for one driver: before its emulators, or its safe part before an instrument."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from cldit.rig.errors import RigError
from cldit.rig.protocols import Device
from cldit.testing import lost_replies
from cldit.testing.backgrounds import BACKGROUND
from cldit.testing.bed import Bed, Make, beds_of, opened
from cldit.testing.cameras import CAMERA
from cldit.testing.devices import IDENTITY, LIFE
from cldit.testing.expect import EVERYTHING, Allowed, Check, ContractBroken, NotAllowed
from cldit.testing.pulses import PULSES
from cldit.testing.triggers import TRIGGER

OF_KIND: dict[str, list[Check]] = {
    "camera": [LIFE, IDENTITY, *CAMERA],
    "background": [LIFE, IDENTITY, *BACKGROUND],
    "trigger": [LIFE, IDENTITY, *TRIGGER],
}
"""What a device of each kind must do, in this order; the first one connects it."""


class Verdict(StrEnum):
    """Of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Result:
    """What came of a check. where: the emulator's variant, or `instrument`; text: what is broken,
    why it was skipped, or how much was tried; seconds: that it took."""

    where: str
    name: str
    verdict: Verdict
    text: str
    seconds: float


def on_emulators(
    driver: str,
    kind: str,
    settings: Mapping[str, Any] | None = None,
    *,
    all_faults: bool = False,
) -> Iterator[Result]:
    """The contract before every emulator of a driver, lost and spoiled replies included.

    Args:
        driver: its name.
        kind: camera, background or trigger.
        settings: the driver's, without the address.
        all_faults: each fault of each reply, which takes minutes; else the faults in turn.

    Returns:
        A result as each check ends.

    Raises:
        SceneError: there is no emulator, or the settings are not the driver's.
    """
    for variant, make in beds_of(driver).items():
        for check in OF_KIND[kind]:
            connects = check is not LIFE
            yield _tried(variant, check.name, _alone(make, settings, check, connects, whole=False))
        if kind == "trigger":
            for check in PULSES:
                yield _tried(variant, check.name, _alone(make, settings, check, True, whole=True))
        for name, work in _lines(make, kind, settings, all_faults).items():
            yield _tried(variant, name, work)


def on_instrument(
    device: Device, kind: str, allowed: Allowed, *, pause_s: float = 1.0
) -> Iterator[Result]:
    """The part of the contract that is safe before an instrument; whoever calls makes it safe.

    Args:
        device: not connected.
        kind: camera, background or trigger.
        allowed: what may be done.
        pause_s: from check to check.

    Returns:
        A result as each check ends. After a link that failed the rest is not tried.
    """
    for number, check in enumerate(OF_KIND[kind]):
        if number:
            time.sleep(pause_s)
        if kind == "camera":
            _disarm(device)
        result = _tried("instrument", check.name, lambda c=check: c.run(device, allowed))  # type: ignore[misc]
        yield result
        if result.verdict is Verdict.FAILED and check is LIFE:
            return


def _disarm(device: Any) -> None:
    """What the check before left armed, if it is connected at all."""
    try:
        device.disarm()
    except RigError:
        return


def _alone(
    make: Make, settings: Mapping[str, Any] | None, check: Check, connects: bool, *, whole: bool
) -> Callable[[], None]:
    """A check on a bed of its own; of the whole bed, or of its device alone."""

    def work() -> None:
        with opened(make, settings) as bed:
            if connects:
                bed.device.connect()
            subject: Bed | Any = bed if whole else bed.device
            check.run(subject, EVERYTHING)

    return work


def _lines(
    make: Make, kind: str, settings: Mapping[str, Any] | None, all_faults: bool
) -> dict[str, Callable[[], object]]:
    """What is tried with the line, by name."""

    def replies(numbers: lost_replies.Numbers, faults: lost_replies.Faults) -> Callable[[], str]:
        return lambda: f"{lost_replies.check_replies(make, numbers, faults, settings)} sessions"

    work: dict[str, Callable[[], object]] = {
        "states": lambda: lost_replies.check_states(make, settings)
    }
    if all_faults:
        work["each reply, each fault"] = replies(lost_replies.every, lost_replies.all_faults)
    elif kind == "camera":
        work["some replies lost, spoiled"] = replies(lost_replies.some, lost_replies.any_in_turn)
    else:
        work["each reply lost"] = replies(lost_replies.every, lost_replies.lost)
        work["each reply spoiled"] = replies(lost_replies.every, lost_replies.spoiled_in_turn)
    if kind != "camera":
        work["a reply lost while it connects"] = lambda: (
            f"{lost_replies.check_connect(make, settings)} sessions"
        )
    work["dead after its session"] = lambda: lost_replies.check_dead(make, settings, times=1)
    return work


def _tried(where: str, name: str, work: Callable[[], object]) -> Result:
    begin_s = time.monotonic()
    try:
        said = work()
        verdict, text = Verdict.PASSED, said if isinstance(said, str) else ""
    except NotAllowed as error:
        verdict, text = Verdict.SKIPPED, str(error)
    except ContractBroken as error:
        verdict, text = Verdict.FAILED, str(error)
    except Exception as error:  # a driver that raises whatever it likes breaks the contract
        verdict, text = Verdict.FAILED, f"{type(error).__name__}: {error}"
    return Result(where, name, verdict, text, time.monotonic() - begin_s)
