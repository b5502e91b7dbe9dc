"""Compiler of numba with types that mypy can check.

Compiled code is cached by the digest of the room's sources: numba itself looks only at the file of
a function, and fails on a cached one whose argument types another file no longer has.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from cldit.io.caches import default_cache
from cldit.io.content import code_digest

F = TypeVar("F", bound=Callable[..., object])

_CONFIG: Any = numba.config
_CONFIG.CACHE_DIR = str(
    Path(_CONFIG.CACHE_DIR or default_cache() / "compiled") / code_digest("spray")
)
_HOW: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def compiled(function: F) -> F:
    """Function compiled at its first call and cached for later processes."""
    return cast(F, numba.njit(**_HOW)(function))


def compiled_for(function: F, signature: tuple[Any, ...]) -> F:
    """Function compiled for the argument types of `signature`.

    These may be functions, called by their address, so that all of them share one cached code.
    """
    return cast(F, numba.njit(signature, **_HOW)(function))
