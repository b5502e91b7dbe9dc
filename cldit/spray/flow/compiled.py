"""numba's compiler with types that mypy can follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Machine code on the first call, kept for the next process."""
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
