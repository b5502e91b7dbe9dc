"""Smooth curves of temperature on an even grid: cubic splines, several properties at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curves:
    """Properties between `low_K` and `high_K`; held at the ends beyond them.

    coefficients: of each property, (4, intervals), the cubic's first.
    """

    low_K: float
    high_K: float
    coefficients: Mapping[str, Floats]

    def at(self, temperature_K: ArrayLike, *names: str) -> tuple[Floats, ...]:
        """The named properties, each shaped as `temperature_K`."""
        t = np.asarray(temperature_K, dtype=float)
        count = next(iter(self.coefficients.values())).shape[1]
        step = (self.high_K - self.low_K) / count
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
        return self.at(temperature_K, name)[0]


def curves(temperature_K: Floats, values: Mapping[str, Floats]) -> Curves:
    """Splines through `values`, each (M,), at even temperatures (M,)."""
    return Curves(
        low_K=float(temperature_K[0]),
        high_K=float(temperature_K[-1]),
        coefficients={
            name: np.ascontiguousarray(CubicSpline(temperature_K, column).c)
            for name, column in values.items()
        },
    )


def integral(temperature_K: Floats, column: Floats) -> Floats:
    """Of a column over temperature, from the first entry on; (M,)."""
    return np.asarray(CubicSpline(temperature_K, column).antiderivative()(temperature_K))
