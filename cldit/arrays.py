"""Types of arrays, by their elements; results that are kept as long as arrays exist."""

import weakref
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Image = NDArray[np.float32]  # (rows, columns) of a map or of weights
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Reals = NDArray[np.floating]  # of the precision of a device or a file
_T = TypeVar("_T")
_KEPT: dict[Hashable, Any] = {}


def kept(arrays: tuple[NDArray[Any], ...], key: Hashable, make: Callable[[], _T]) -> _T:
    """Result of `make`, made once from `key` and from arrays that do not change."""
    name = (*map(id, arrays), key)
    if name not in _KEPT:
        _KEPT[name] = make()
        for array in arrays:
            weakref.finalize(array, _KEPT.pop, name, None).atexit = False
    return _KEPT[name]  # type: ignore[no-any-return]
