"""Limits that all checks share: what chance does, and the share of pixels that matters."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from cldit.arrays import Floats

DEVIATIONS = 6.0  # standard deviations that are no chance: once in 5e8 pixels, rows or blocks
IMPROBABLE = 1e-3  # probability by chance, from which a pixel is counted and a group is named
FEW = 0.01  # share of the pixels, ten times `IMPROBABLE`; sensors have as many defective ones
NEARLY_ALL = 0.9  # share of images with a row that is the camera's, or of saturated pixels
ALONE = 0.1  # of the squares about a line, that remain without its lone outlier
REMAINING = 0.1  # of the deviations, that remain with a cause that explains them
_CHANCE = 3e-7  # one side of five standard deviations: each of ten checks has some ten values


def sure(degrees: int) -> float:
    """Number of standard errors that excludes chance, for these degrees of freedom."""
    return -float(stdtrit(degrees, _CHANCE) if degrees > 0 else ndtri(_CHANCE))


def usual(deviations: NDArray[np.floating]) -> float:
    """Standard deviation of normal values by the median of their magnitudes (1.4826 times it), to
    which a few odd ones contribute nothing."""
    return 1.4826 * float(np.median(np.abs(deviations)))


def clipped(values: Floats, deviations: float) -> Floats:
    """Values about 0 without tails beyond so many standard deviations: a few odd pixels, or edges,
    shall not change a sum of squares."""
    limit = deviations * usual(values)
    return np.clip(values, -limit, limit)
