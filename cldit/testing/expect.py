"""Checks of the contract: their errors, and what they are allowed to do with an instrument."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cldit.errors import ClditError

HANG_s = 60.0
"""Limit for what takes milliseconds where all is well, on a machine that is busy with much else."""
AGREE_K = 0.1
"""Difference of a set point from the one read back, which controllers round to a tenth."""


class ContractBroken(ClditError, AssertionError):
    """A driver violates the contract of drivers."""


class NotAllowed(ClditError):
    """A check is not allowed on this instrument; nothing was done."""


@dataclass(frozen=True)
class Allowed:
    """Limits of a check: the highest set point, and if a burst may be fired with injection."""

    warmest_K: float
    inject: bool


EVERYTHING = Allowed(warmest_K=math.inf, inject=True)
"""No limits, as on an emulator."""


@dataclass(frozen=True)
class Check:
    """One part of the contract.

    does: describes its effect on an instrument. run: takes the device and the limits; raises
    ContractBroken, NotAllowed.
    """

    name: str
    does: str
    run: Callable[[Any, Allowed], None]


def expect(right: object, text: str) -> None:
    """Raises ContractBroken with `text` if `right` is false."""
    if not right:
        raise ContractBroken(text)


def near(got: float, wanted: float, within: float, what: str) -> None:
    """Checks that a value is the wanted one.

    Args:
        got, wanted: values of one unit.
        within: largest difference between them.
        what: name of the quantity, for the message.

    Raises:
        ContractBroken: they differ by more.
    """
    expect(abs(got - wanted) <= within, f"{what}: {got:g}, expected {wanted:g} within {within:g}")


def refuses(
    call: Callable[[], object], error: type[Exception], what: str, saying: str = ""
) -> Exception:
    """Checks that a call raises an error, and returns the error.

    Args:
        call: without arguments.
        error: its class.
        what: name of the call, for the message.
        saying: part of the error's text.

    Raises:
        ContractBroken: the call raises no error, or another.
    """
    try:
        got = call()
    except error as refusal:
        expect(saying in str(refusal), f"{what}: {refusal}; expected {saying!r} in it")
        return refusal
    except Exception as fault:
        raise ContractBroken(
            f"{what}: {type(fault).__name__}: {fault}; expected {error.__name__}"
        ) from fault
    raise ContractBroken(f"{what}: returned {got!r}; expected {error.__name__}")
