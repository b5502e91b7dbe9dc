"""Files with flipped bits, as by a bad disk, which have their bytes again afterwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np


@contextmanager
def flipped_bits(files: Sequence[Path], rng: np.random.Generator) -> Iterator[list[Path]]:
    """Flips up to five bits of one or two of the files; yields these files."""
    chosen = [files[n] for n in rng.integers(len(files), size=rng.integers(1, 3))]
    kept = {file: file.read_bytes() for file in chosen}
    for file, data in kept.items():
        changed = bytearray(data)
        for at in rng.integers(len(changed), size=rng.integers(1, 6)) if changed else ():
            changed[at] ^= 1 << rng.integers(8)
        file.write_bytes(changed)
    try:
        yield chosen
    finally:
        for file, data in kept.items():
            file.write_bytes(data)
