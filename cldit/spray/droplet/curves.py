"""Smooth curves of temperature on an even grid: cubic splines, several properties at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from cldit.spray.numba_typing import compiled

Floats = NDArray[np.float64]


@compiled
def place(at: float, low: float, step: float, count: int) -> tuple[int, float]:
    """Interval of a value on an even grid, held at its ends, and how far into it; NaN stays NaN.

    Args:
        at: the value.
        low, step: start of the grid, and length of an interval.
        count: number of intervals.

    Returns:
        Index of the interval, and distance into it.
    """
    rise = min(at - low, count * step)
    if not rise > 0:
        return 0, (0.0 if at <= low else np.nan)
    cell = min(int(rise * (1 / step)), count - 1)
    return cell, rise - cell * step


@compiled
def cubic(table: Floats, cell: int, column: int, part: float) -> float:
    """One property by its cubics.

    Args:
        table: (intervals, properties, 4).
        cell: interval, and `part` how far into it.
        column: number of the property.
        part: from `place`.
    """
    c = table[cell, column]
    return float(((c[0] * part + c[1]) * part + c[2]) * part + c[3])


@dataclass(frozen=True)
class Curves:
    """Properties between `low_K` and `high_K`; held at the ends beyond them.

    coefficients: of each property, (4, intervals), the cubic's first.
    """

    low_K: float
    high_K: float
    coefficients: Mapping[str, Floats]

    @cached_property
    def step_K(self) -> float:
        """Length of an interval."""
        return (self.high_K - self.low_K) / int(next(iter(self.coefficients.values())).shape[1])

    def packed(self, *names: str) -> Floats:
        """The named cubics as compiled code reads them, (intervals, properties, 4)."""
        return np.ascontiguousarray(np.stack([self.coefficients[name].T for name in names], axis=1))

    def at(self, temperature_K: ArrayLike, *names: str) -> tuple[Floats, ...]:
        """The properties `names`, each shaped as `temperature_K`."""
        t = np.asarray(temperature_K, dtype=float)
        count = next(iter(self.coefficients.values())).shape[1]
        step = self.step_K
        rise = np.minimum(np.maximum(t, self.low_K), self.high_K) - self.low_K
        cell = np.minimum((rise * (1 / step)).astype(np.intp), count - 1)
        part = rise - cell * step
        found = []
        for name in names:
            cubic, square, slope, value = self.coefficients[name]
            found.append(((cubic[cell] * part + square[cell]) * part + slope[cell]) * part)
            found[-1] += value[cell]
        return tuple(found)

    def one(self, name: str, temperature_K: ArrayLike) -> Floats:
        """The property `name`, shaped as `temperature_K`."""
        return self.at(temperature_K, name)[0]


def curves(temperature_K: Floats, values: Mapping[str, Floats]) -> Curves:
    """Splines through `values`, each (M,), at even temperatures `temperature_K` (M,)."""
    return Curves(
        low_K=float(temperature_K[0]),
        high_K=float(temperature_K[-1]),
        coefficients={
            name: np.ascontiguousarray(CubicSpline(temperature_K, column).c)
            for name, column in values.items()
        },
    )


def integral(temperature_K: Floats, column: Floats) -> Floats:
    """Integral of `column` (M,) over `temperature_K` (M,), from the first entry on; (M,)."""
    return np.asarray(CubicSpline(temperature_K, column).antiderivative()(temperature_K))
