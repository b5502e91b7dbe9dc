"""Types of arrays, by their elements; results that are kept as long as arrays exist."""

import weakref
from collections.abc import Callable, Hashable, Iterator
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
_CACHED = 1 << 16  # numbers of an array, half a megabyte: a few of them stay in a core's cache


def parts(count: int) -> Iterator[slice]:
    """Consecutive parts of `count` elements, for element-wise work in the cache."""
    for begin in range(0, count, _CACHED):
        yield slice(begin, min(begin + _CACHED, count))


def kept(arrays: tuple[NDArray[Any], ...], key: Hashable, make: Callable[[], _T]) -> _T:
    """Result of `make`, made once from `key` and from arrays that do not change."""
    name = (*map(id, arrays), key)
    if name not in _KEPT:
        _KEPT[name] = make()
        for array in arrays:
            weakref.finalize(array, _KEPT.pop, name, None).atexit = False
    return _KEPT[name]  # type: ignore[no-any-return]
