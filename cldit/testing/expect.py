"""How a check says what is broken, and what it may do on the instrument before it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cldit.errors import ClditError


class ContractBroken(ClditError, AssertionError):
    """A driver does not do what every driver must."""


class NotAllowed(ClditError):
    """A check would do what it is not allowed to do on this instrument; nothing was done."""


@dataclass(frozen=True)
class Allowed:
    """What a check may do. warmest_K: the highest set point; inject: a burst with injection may be
    configured and fired."""

    warmest_K: float
    inject: bool


EVERYTHING = Allowed(warmest_K=math.inf, inject=True)
"""On an emulator."""


@dataclass(frozen=True)
class Check:
    """One part of the contract.

    name: of the check. does: what it does with an instrument, in words. run: takes the device and
    what is allowed; raises ContractBroken, NotAllowed.
    """

    name: str
    does: str
    run: Callable[[Any, Allowed], None]


def expect(right: object, text: str) -> None:
    """Raises ContractBroken with `text` where it is not `right`."""
    if not right:
        raise ContractBroken(text)


def near(got: float, wanted: float, within: float, what: str) -> None:
    """`got` must be `wanted`.

    Args:
        got, wanted: values of one unit.
        within: the same unit; what may lie between them.
        what: for the message.

    Raises:
        ContractBroken: it is not.
    """
    expect(abs(got - wanted) <= within, f"{what}: {got:g}, expected {wanted:g} within {within:g}")


def refuses(
    call: Callable[[], object], error: type[Exception], what: str, saying: str = ""
) -> Exception:
    """The error with which `call` refuses.

    Args:
        call: what must be refused.
        error: its class.
        what: for the message.
        saying: part of the error's text.

    Raises:
        ContractBroken: it does not refuse, or otherwise.
    """
    try:
        got = call()
    except error as refusal:
        expect(saying in str(refusal), f"{what}: {refusal}; expected {saying!r} in it")
        return refusal
    except Exception as other:
        raise ContractBroken(
            f"{what}: {type(other).__name__}: {other}; expected {error.__name__}"
        ) from other
    raise ContractBroken(f"{what}: gives {got!r}; expected {error.__name__}")
