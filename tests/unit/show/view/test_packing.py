"""What the page reads is what was packed, and rounding errs by what it states."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.show.view.packing import MANTISSA_BITS, packed, rounded


def unpacked(head: Mapping[str, Any], text: str) -> NDArray[np.float32]:
    """As unpack.js does it for float32."""
    data = zlib.decompress(base64.b64decode(text))
    planes = np.frombuffer(data, np.uint8).reshape(4, head["count"])
    folded = np.ascontiguousarray(planes.T).view("<u4").reshape(-1)
    step = (folded >> 1) ^ (0 - (folded & 1)).astype(np.uint32)
    return np.cumsum(step, dtype=np.uint32).view(np.float32)


def test_a_rounded_number_errs_by_half_of_its_last_bit() -> None:
    """2^-(b + 1) of the number, for a mantissa of b bits beside the leading one."""
    rng = np.random.default_rng(3)
    values = (rng.standard_normal(20_000) * 10.0 ** rng.uniform(-30, 30, 20_000)).astype(np.float32)
    for bits in (MANTISSA_BITS, 10):
        off = np.abs(rounded(values, bits).astype(float) / values - 1.0)
        assert 0.9 * 2.0 ** -(bits + 1) < off.max() <= 2.0 ** -(bits + 1)
    assert np.array_equal(rounded(values, 23), values)


def test_rounding_keeps_what_is_no_usual_number() -> None:
    values = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -2.0], np.float32)
    assert np.array_equal(rounded(values, 10), values, equal_nan=True)


def test_numbers_come_back_bit_for_bit() -> None:
    rng = np.random.default_rng(4)
    values = rng.standard_normal((30, 40)).astype(np.float32)
    values[3, 4] = np.nan
    values[5, 6:9] = [0.0, -np.inf, 3e38]
    back = unpacked(*packed(values)).reshape(values.shape)
    assert np.array_equal(back.view(np.uint32), values.view(np.uint32))


def test_neighbours_that_are_alike_take_little_room() -> None:
    even = np.linspace(1.0, 1.01, 10_000, dtype=np.float32)
    mixed = np.random.default_rng(5).permutation(even)
    assert len(packed(even)[1]) < 0.2 * len(packed(mixed)[1])


def test_other_numbers_are_refused() -> None:
    with pytest.raises(TypeError, match="int64: allowed: float32, float64, uint8, uint16"):
        packed(np.arange(3))
