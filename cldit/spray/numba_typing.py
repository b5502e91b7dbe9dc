"""Compiler of numba with types that mypy can check."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

_HOW: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def compiled(function: F) -> F:
    """Function compiled at its first call and cached for later processes."""
    return cast(F, numba.njit(**_HOW)(function))


def compiled_for(function: F, signature: tuple[Any, ...]) -> F:
    """Function compiled for the argument types of `signature`.

    These may be functions, called by their address, so that all of them share one cached code.
    """
    return cast(F, numba.njit(signature, **_HOW)(function))
