"""Deviations of points from a straight line: of each from the others, and a lone one."""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats

_EXPLAINED = 0.1  # of the squares about the line of all: a third of the deviations remains


@dataclass(frozen=True, kw_only=True)
class OffLine:
    """Deviations of K points from the line through the others.

    kelvin, noise_K: (K,). lone: the one without which the others are on a line; None if there is
    none, or with three points.
    """

    kelvin: Floats
    noise_K: Floats
    lone: int | None

    def beyond(self, deviations: float) -> bool:
        """True if a point deviates by more than so many standard deviations of its noise."""
        return bool(np.any(np.abs(self.kelvin) > deviations * self.noise_K))


def off_line(x: Floats, y: Floats, *, rise: Floats, variance: Floats) -> OffLine:
    """Deviation of each of K >= 3 points from the line through the others, with equal weights.

    Args:
        x: (K,) radiance of the background.
        y, variance: (K,) signal, and its variance.
        rise: (K,) of x per kelvin.
    """
    gain, _ = _line(x, y, rise)
    count = len(x)
    kelvin, noise = np.zeros(count), np.zeros(count)
    for k in range(count):
        remaining = np.arange(count) != k
        design = (
            np.stack([x[remaining], np.ones(count - 1) * x.max()], axis=1)
            / rise[remaining][:, None]
        )
        # (K - 1,) coefficients of the others' signals in the prediction
        weight = np.array([x[k], x.max()]) @ np.linalg.pinv(design) / rise[remaining]
        kelvin[k] = (y[k] - weight @ y[remaining]) / (gain * rise[k])
        noise[k] = np.sqrt(variance[k] + weight**2 @ variance[remaining]) / (abs(gain) * rise[k])
    total = squares(x, y, rise)
    without_each = [
        squares(np.delete(x, k), np.delete(y, k), np.delete(rise, k)) for k in range(count)
    ]
    lone = (
        int(np.argmin(without_each))
        if count >= 4 and min(without_each) < _EXPLAINED * total
        else None
    )
    return OffLine(kelvin=kelvin, noise_K=noise, lone=lone)


def squares(x: Floats, y: Floats, rise: Floats) -> float:
    """Sum of squares in kelvin of points about their line; `x`, `y`, `rise` as in `off_line`."""
    gain, off = _line(x, y, rise)
    return float(off @ off) / gain**2


def _line(x: Floats, y: Floats, rise: Floats) -> tuple[float, Floats]:
    """Slope of the points' line, infinite where it is 0, and residuals (K,) over `rise`."""
    design = np.stack([x, np.ones_like(x) * x.max()], axis=1) / rise[:, None]
    best, *_ = np.linalg.lstsq(design, y / rise, rcond=None)
    return float(best[0]) or np.inf, y / rise - design @ best
