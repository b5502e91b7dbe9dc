"""numba's compiler with types that mypy can follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

_HOW: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def compiled(function: F) -> F:
    """Machine code on the first call, kept for the next process."""
    return cast(F, numba.njit(**_HOW)(function))


def compiled_for(function: F, signature: tuple[Any, ...]) -> F:
    """`function` as machine code for the argument types of `signature`.

    Among them may be functions, called by their address, so that one cached machine code serves for
    all of them.
    """
    return cast(F, numba.njit(signature, **_HOW)(function))
