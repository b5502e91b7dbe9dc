"""Arrays as text for a page: rounded, told by differences, deflated, in base64.

The page undoes this in `unpack.js`. Numbers of 32 bits are rounded to some bits of their mantissa
(`rounded`), so that each errs by a known share of itself. What is written of each is the difference
of its bits from those of the number before, in four planes of bytes: neighbours are alike, so the
upper planes are mostly zeros, which deflate takes to nothing.
"""

from __future__ import annotations

import zlib
from base64 import b64encode
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

MANTISSA_BITS = 18
"""Kept of weights and maps: each number errs by 2^-19 = 2e-6 of itself at most."""

ERROR_BITS = 10
"""Kept of standard errors: 5e-4 of themselves."""

_WHOLE_BITS = 23  # of float32
_NAN = 0x7FC00000


@dataclass(frozen=True)
class Packed:
    """An array as text. dtype: numpy's name of what the text holds. count: numbers in it."""

    dtype: str
    count: int
    text: str

    @property
    def head(self) -> dict[str, Any]:
        """What the page must know to read the text."""
        return {"dtype": self.dtype, "count": self.count}


def rounded(values: NDArray[Any], bits: int) -> NDArray[np.float32]:
    """Numbers with a shorter mantissa, rounded to the nearest; NaN stays.

    Args:
        values: any shape, within the range of float32.
        bits: of the mantissa, 0 to 23.

    Returns:
        Of the same shape.
    """
    plain = np.asarray(values, np.float32)
    drop = _WHOLE_BITS - bits
    if drop == 0:
        return plain
    word = np.ascontiguousarray(plain).view(np.uint32)
    half = np.uint32(1 << (drop - 1))
    kept = (word + half) & np.uint32(0xFFFFFFFF << drop & 0xFFFFFFFF)
    kept = np.where(np.isnan(plain), np.uint32(_NAN), kept)
    return np.asarray(kept, np.uint32).view(np.float32)


def packed(values: NDArray[Any]) -> Packed:
    """An array of any shape, row by row.

    Args:
        values: float32 by differences; float64, uint8 and uint16 as they are.

    Raises:
        TypeError: numbers of another type.
    """
    if values.dtype.name not in ("float32", "float64", "uint8", "uint16"):
        raise TypeError(f"{values.dtype.name}: allowed is float32, float64, uint8 or uint16")
    flat = np.ascontiguousarray(values).reshape(-1)
    little = flat.astype(flat.dtype.newbyteorder("<"), copy=False)
    data = little.tobytes()
    if values.dtype == np.float32:
        word = little.view("<i4").astype(np.int32)
        step = np.diff(word, prepend=np.int32(0)).astype(np.int32)  # wraps, as the page's sum does
        folded = (step << 1) ^ (step >> 31)  # small whatever the sign
        data = np.ascontiguousarray(folded.astype("<i4").view(np.uint8).reshape(-1, 4).T).tobytes()
    text = b64encode(zlib.compress(data, 6)).decode("ascii")
    return Packed(values.dtype.name, flat.size, text)
