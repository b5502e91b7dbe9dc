"""Causes of a finding as hypotheses: each is fitted, and the best is named if it fits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from cldit.arrays import Floats
from cldit.scene.values import ZERO_CELSIUS_K

_CHANCE = 1e-4  # probability of a larger chi-square, up to which a cause fits
_REMAINING = 0.01  # of chi-square without a cause: a tenth of the deviations remains
_WITHIN = 0.0027  # probability of a difference of chi-square by chance: three standard deviations

UNITS: dict[str, Callable[[Floats], Floats]] = {
    "degrees Celsius: they fit with 273.15 added": lambda at: at + ZERO_CELSIUS_K,
    "degrees F that were taken for K": lambda at: (at - 32.0) / 1.8 + ZERO_CELSIUS_K,
    "degrees F that were taken for degrees Celsius": lambda at: (
        (at - ZERO_CELSIUS_K - 32.0) / 1.8 + ZERO_CELSIUS_K
    ),
    "degrees Celsius that were taken for degrees F": lambda at: (
        (at - ZERO_CELSIUS_K) * 1.8 + 32.0 + ZERO_CELSIUS_K
    ),
    "K that were taken for degrees Celsius": lambda at: at - ZERO_CELSIUS_K,
}


@dataclass(frozen=True)
class Hypothesis:
    """A cause in words, the chi-square that remains, and the number of unknowns. severe: T_app
    would be wrong by more than any stated error."""

    text: str
    chi2: float
    unknowns: int
    severe: bool = False

    @property
    def score(self) -> float:
        """Chi-square, and what the unknowns gain by chance."""
        return self.chi2 + _by_chance(self.unknowns)


def _by_chance(unknowns: int) -> float:
    return float(chdtri(unknowns, _WITHIN)) if unknowns else 0.0


def fitted(candidates: Sequence[Hypothesis], *, none: float, degrees: int) -> list[Hypothesis]:
    """Causes that fit, the best first, then those within chance of it.

    none: chi-square without a cause, of so many `degrees` of freedom.
    """

    def fits(cause: Hypothesis) -> bool:
        remaining = degrees - cause.unknowns
        return cause.chi2 <= max(
            _REMAINING * none, float(chdtri(remaining, _CHANCE)) if remaining > 0 else 0.0
        )

    good = sorted((cause for cause in candidates if fits(cause)), key=lambda cause: cause.score)
    if not good:
        return []
    # Errors of the model count as chance, too.
    scale = max(1.0, good[0].chi2 / max(degrees - good[0].unknowns, 1))
    return [cause for cause in good if cause.score < good[0].score + _by_chance(1) * scale]


def describe(causes: Sequence[Hypothesis], *, none: float, tried: int) -> str:
    """Text of the causes that fit: by how much the best is better, and those within chance."""
    if not causes:
        return f"none of {tried} causes fits"
    better = none / max(causes[0].chi2, 1.0)
    message = f"{causes[0].text} (chi-square {better:.2g} times smaller than without)"
    alternatives = list(dict.fromkeys(cause.text for cause in causes[1:]))
    return f"{message}; within chance: {', or '.join(alternatives)}" if alternatives else message


def line_chi2(x: Floats, y: Floats, variance: Floats, *extra: Floats) -> float:
    """Chi-square of points (K,) about their line over `x`, with further columns (K,)."""
    columns = np.array([x, np.ones_like(x), *extra]).T / np.sqrt(variance)[:, None]
    size = np.sqrt(np.sum(columns**2, axis=0))
    values = y / np.sqrt(variance)
    rest = values - columns / size @ np.linalg.lstsq(columns / size, values, rcond=None)[0]
    return float(rest @ rest)
