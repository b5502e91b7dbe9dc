"""Fingerprint of an image: what the check of a film (`cldit.dit.film`) compares."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

EIGHTH = 8  # part of rows and columns that is a margin at each edge
_VALUES = 32  # distinct counts: all of them even by chance in 1 of 2^32 images


@dataclass(frozen=True)
class Fingerprint:
    """Fingerprint of one image (h, w).

    rows: (h,) digests of the rows without their margins. free: (h,) number of their pixels between
    the least and the largest count of the image. runs: (h,) number of pixels of the longest part of
    a row with one value, below the largest of the image. flat: one value in all pixels.
    bits: of its integers; 0 for others. step: power of two that divides all counts; 0 if unknown.
    """

    rows: NDArray[np.uint64]
    free: NDArray[np.uint16]
    runs: NDArray[np.uint16]
    flat: bool
    bits: int
    step: int

    @classmethod
    def of(cls, image: NDArray[Any]) -> "Fingerprint":
        """Fingerprint of an image (h, w) of numbers."""
        integer = image.dtype.kind in "iu"
        middle = inner(image)
        columns = image[:, _margins(image.shape[1])]
        words = columns.astype(np.uint64) if integer else columns.astype(float).view(np.uint64)
        step = 0
        if integer and np.unique(middle.ravel()[:: max(1, middle.size // 4096)]).size >= _VALUES:
            bits_set = int(np.bitwise_or.reduce(middle, axis=None))
            step = bits_set & -bits_set
        return cls(
            rows=np.asarray(np.sum(words * _factors(words.shape[1]), axis=1, dtype=np.uint64)),
            free=np.sum(
                (columns > columns.min()) & (columns < columns.max()), axis=1, dtype=np.uint16
            ),
            runs=_runs(columns),
            flat=bool(np.ptp(middle) == 0),
            bits=8 * image.dtype.itemsize if integer else 0,
            step=step,
        )

    @property
    def digest(self) -> bytes:
        """Digest of the image without its margins."""
        return self.rows[_margins(self.rows.size)].tobytes()


def inner(image: NDArray[Any]) -> NDArray[Any]:
    """The image without an eighth of its rows and columns at each edge.

    Cameras write counters and times into the first or last of them.
    """
    return image[_margins(image.shape[0]), _margins(image.shape[1])]


def _margins(pixels: int) -> slice:
    return slice(pixels // EIGHTH, pixels - pixels // EIGHTH)


@cache
def _factors(columns: int) -> NDArray[np.uint64]:
    """Random odd factors of a digest: two rows that differ have equal sums by chance alone."""
    rng = np.random.default_rng(columns)
    return rng.integers(0, 2**64, columns, np.uint64, endpoint=False) | np.uint64(1)


def _runs(image: NDArray[Any]) -> NDArray[np.uint16]:
    """Pixels (h,) of the longest part of each row with one value, below the image's largest."""
    same = np.zeros(image.shape, bool)
    same[:, 1:] = (image[:, 1:] == image[:, :-1]) & (image[:, 1:] < image.max())
    breaks = np.flatnonzero(~same)  # the first pixel of each row is one
    lengths = np.diff(breaks, append=same.size)
    starts = np.searchsorted(breaks, np.arange(image.shape[0]) * image.shape[1])
    return np.maximum.reduceat(lengths, starts).astype(np.uint16)
