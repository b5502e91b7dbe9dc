"""Indices of tables of more than 2^31 numbers, without such a table."""

from __future__ import annotations

import re
from importlib import resources
from typing import Any

import numpy as np
import pytest

PRIME = 1_000_003  # a remainder that single precision contains exactly

# A product with a number that grows with cells or pixels, in an index. u: a random number.
_GROWS = r"(?:m->)?(?:count|stored|planes|packets|RECORD)"
_PRODUCT = re.compile(rf"(?<!\bu) \* {_GROWS}\b|\b{_GROWS} \* [\w(]")
_LONG = re.compile(r"\(size_t\)|in_table\(")


def test_a_table_of_more_than_2_31_numbers(apply: Any) -> None:
    """60e6 cells with the 36 planes of Mie's moments; and rows up to 2^31 cells."""
    cells = np.array([60e6, 60e6, 2**30, 2**31 - 128], np.float32)
    lanes = np.array([0, 7, 5, 3], np.float32)
    planes = np.array([36, 36, 4, 36], np.float32)
    got = apply(
        "cell_packets.h",
        f"(real)(first_plane((int)a + (int)b, (int)c) % {PRIME}ul)",
        [cells, lanes, planes],
        defines="#define SIMD_WIDTH 1",
    )
    expected = [
        int(cell) // 8 * 8 * int(number) + int(lane)
        for cell, lane, number in zip(cells, lanes, planes, strict=True)
    ]
    assert max(expected) > 2**36
    np.testing.assert_array_equal(got, [index % PRIME for index in expected])
    got = apply(
        "real.h",
        f"(real)(in_table((int)c, (int)a, (int)b) % {PRIME}ul)",
        [cells, lanes, planes],
    )
    expected = [
        int(row) * int(length) + int(at)
        for length, at, row in zip(cells, lanes, planes, strict=True)
    ]
    np.testing.assert_array_equal(got, [index % PRIME for index in expected])


def _sources() -> list[str]:
    files = resources.files("cldit.kernels").iterdir()
    return sorted(one.name for one in files if one.name.endswith((".cl", ".h")))


@pytest.mark.parametrize("name", _sources())
def test_no_index_is_a_product_of_integers(name: str) -> None:
    """Rows of a table that is read or written are counted by size_t."""
    text = resources.files("cldit.kernels").joinpath(name).read_text(encoding="utf-8")
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    indices = re.findall(r"\w\[([^\[\]]*(?:\[[^\[\]]*\][^\[\]]*)*)\]", text)
    indices += re.findall(r"__global [^=;]*= ([^;]*);", text)
    assert not [one for one in indices if _PRODUCT.search(one) and not _LONG.search(one)]
