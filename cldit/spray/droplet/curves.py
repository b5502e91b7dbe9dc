"""Cubic splines of several properties over temperature, on a uniform grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from cldit.arrays import Floats


@dataclass(frozen=True)
class Curves:
    """Splines between `low_K` and `high_K`, constant beyond.

    coefficients: of each property, (4, intervals), the highest power first.
    """

    low_K: float
    high_K: float
    coefficients: Mapping[str, Floats]

    @cached_property
    def step_K(self) -> float:
        """Length of an interval."""
        return (self.high_K - self.low_K) / int(next(iter(self.coefficients.values())).shape[1])

    def at(self, temperature_K: ArrayLike, *names: str) -> tuple[Floats, ...]:
        """Values of the properties `names`, each of the shape of `temperature_K`."""
        t = np.asarray(temperature_K, dtype=float)
        count = next(iter(self.coefficients.values())).shape[1]
        step = self.step_K
        rise = np.minimum(np.maximum(t, self.low_K), self.high_K) - self.low_K
        cell = np.minimum((rise * (1 / step)).astype(np.intp), count - 1)
        part = rise - cell * step
        results = []
        for name in names:
            cubic, square, slope, value = self.coefficients[name]
            results.append(((cubic[cell] * part + square[cell]) * part + slope[cell]) * part)
            results[-1] += value[cell]
        return tuple(results)

    def value(self, name: str, temperature_K: ArrayLike) -> Floats:
        """Value of the property `name`, of the shape of `temperature_K`."""
        return self.at(temperature_K, name)[0]


def curves(temperature_K: Floats, values: Mapping[str, Floats]) -> Curves:
    """Splines through `values`, each (M,), at equidistant temperatures (M,)."""
    return Curves(
        low_K=float(temperature_K[0]),
        high_K=float(temperature_K[-1]),
        coefficients={
            name: np.ascontiguousarray(CubicSpline(temperature_K, column).c)
            for name, column in values.items()
        },
    )


def integral(temperature_K: Floats, column: Floats) -> Floats:
    """Integral (M,) of `column` (M,) over temperature (M,), from the first entry on."""
    return np.asarray(CubicSpline(temperature_K, column).antiderivative()(temperature_K))
