"""Tables on disk: made once, and again where the file is damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.io.tables import Arrays, cached


@pytest.mark.parametrize("place", [0, 10, -9, -8, -1], ids=str)
def test_a_flipped_bit_is_noticed(place: int, tmp_path: Path) -> None:
    """In the head, and in the lowest bits of a value, which leave it finite."""
    made: list[Arrays] = []

    def make() -> Arrays:
        made.append({"a": np.linspace(0.0, 1.0, 5), "b": np.full((2, 2), 7.0)})
        return made[-1]

    for _ in range(2):
        found = cached(tmp_path, kind="k", description="t", make=make)
        np.testing.assert_array_equal(found["b"], np.full((2, 2), 7.0))
    assert len(made) == 1
    (path,) = tmp_path.iterdir()
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    found = cached(tmp_path, kind="k", description="t", make=make)
    assert len(made) == 2
    np.testing.assert_array_equal(found["a"], made[0]["a"])
    cached(tmp_path, kind="k", description="t", make=make)
    assert len(made) == 2
