"""Arrays as text for a page: rounded, differences taken, deflated, in base64.

The page reverses this in `unpack.js`. Numbers of 32 bits are rounded to some bits of their mantissa
(`rounded`), so that the relative error of each is known. The difference of their bits from those of
the number before is written in four planes of bytes: neighbours are alike, so the upper planes are
mostly zeros, which compress well.
"""

import zlib
from base64 import b64encode
from typing import Any

import numpy as np
from numpy.typing import NDArray

MANTISSA_BITS = 18
"""Bits kept of weights and maps: a relative error of at most 2^-19 = 2e-6."""

ERROR_BITS = 10
"""Bits kept of standard errors: a relative error of at most 5e-4."""

_WHOLE_BITS = np.finfo(np.float32).nmant
_NAN = np.array(np.nan, np.float32).view(np.uint32)


def rounded(values: NDArray[Any], bits: int) -> NDArray[np.float32]:
    """Numbers (...,) with a mantissa of `bits`, 0 to 23, rounded to the nearest; NaN stays."""
    plain = np.asarray(values, np.float32)
    drop = _WHOLE_BITS - bits
    if drop == 0:
        return plain
    word = np.ascontiguousarray(plain).view(np.uint32)
    half = np.uint32(1 << (drop - 1))
    kept = (word + half) & np.uint32(0xFFFFFFFF << drop & 0xFFFFFFFF)
    kept = np.where(np.isnan(plain), _NAN, kept)
    return np.asarray(kept, np.uint32).view(np.float32)


def packed(values: NDArray[Any]) -> tuple[dict[str, Any], str]:
    """Head and text of an array (...,), row by row: float32 by differences, other types unchanged.

    The head has what the page needs to read the text: the numpy type, and the count of numbers.
    Raises TypeError for types other than float32, float64, uint8 and uint16.
    """
    if values.dtype.name not in ("float32", "float64", "uint8", "uint16"):
        raise TypeError(f"{values.dtype.name}: allowed: float32, float64, uint8, uint16")
    flat = np.ascontiguousarray(values).reshape(-1)
    little = flat.astype(flat.dtype.newbyteorder("<"), copy=False)
    data = little.tobytes()
    if values.dtype == np.float32:
        word = little.view("<i4").astype(np.int32)
        step = np.diff(word, prepend=np.int32(0)).astype(np.int32)  # wraps, as the page's sum does
        folded = (step << 1) ^ (step >> 31)  # small for either sign
        data = np.ascontiguousarray(folded.astype("<i4").view(np.uint8).reshape(-1, 4).T).tobytes()
    encoded = b64encode(zlib.compress(data, 6)).decode("ascii")
    return {"dtype": values.dtype.name, "count": flat.size}, encoded
