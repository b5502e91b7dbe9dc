"""Sums in fixed point, to which the work-items of a kernel add in any order (fixed_point.h)."""

import numpy as np

from cldit.arrays import Floats
from cldit.errors import KernelError
from cldit.gpu.buffers import Numbers, download
from cldit.gpu.device import Device

_BITS = 62  # of the bound; one more for rounding of each addition by half a unit, and the sign
_LARGEST = 2.0**127  # largest power of two in single precision
_EXTENSION = "cl_khr_int64_base_atomics"


def fixed_point_defines(device: Device) -> dict[str, int]:
    """Defines of a kernel that includes fixed_point.h."""
    has = device.opened.handle.extensions.split()
    return {} if _EXTENSION in has else {"FIXED_POINT_WORDS": 1}


def fixed_point_scale(bound: float) -> float:
    """Units per number of sums whose terms have magnitudes of at most `bound` in total.

    A power of two that single precision contains. A unit is at most 2^-61 of the bound, or 2^-127;
    each term is rounded to the nearest.
    """
    if not 0 <= bound <= _LARGEST:
        raise KernelError(f"sums in fixed point: bound {bound:g}; allowed: 0 to {_LARGEST:.3g}")
    return float(2.0 ** min(_BITS - int(np.frexp(bound)[1]), 127))


def fixed_point_sums(device: Device, sums: Numbers, count: int, scale: float) -> Floats:
    """The first `count` sums of a buffer of int64, as numbers."""
    units = download(device, sums, np.empty(count, np.int64))
    return np.asarray(units / scale)
