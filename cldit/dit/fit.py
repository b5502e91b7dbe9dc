"""Weighted straight lines, one a pixel, and what two of them say about a spray.

With x the radiance that leaves the background disc, a pixel that sees it shows

    without spray   I_ref = g x + c_ref     (g = 1 for an unobstructed disc without windows)
    with spray      I_inj = s x + c_inj

so that Delta I = I_inj - I_ref has the slope s - g = -epsilon g and the intercept
c_inj - c_ref = epsilon g I(T_app): Eq. (2) of the paper, divided by what the pixel sees of the
disc. Both lines use the weights of Delta I, so that for equal x they are exactly the fit of Delta I
and an error of x common to both drops out where the spray is transparent; unequal x (the black
body still moving between references and injections) is allowed for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """y = slope x + intercept with the parameters' covariance; all of one pixel shape (...)."""

    slope: Floats
    intercept: Floats
    slope_variance: Floats
    intercept_variance: Floats
    covariance: Floats

    def at(self, x: Floats) -> Floats:
        """(K, ...) values at x (K, ...)."""
        return self.slope * x + self.intercept


def fit_line(x: Floats, y: Floats, *, weight: Floats, variance: Floats) -> Line:
    """Weighted linear fit over the first axis.

    The weights need not be 1 / variance: the parameters' covariance is propagated from `variance`
    through the weights that were used. NaN where fewer than two points have weight.

    Args:
        x, y, weight, variance: (K, ...), broadcast against each other; `variance` is that of y. A
            point of weight 0 is left out, but must be finite.
    """
    total = np.sum(weight, axis=0)
    points = np.count_nonzero(np.broadcast_to(weight, y.shape) > 0, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = weight / total
        centred = x - np.sum(share * x, axis=0)
        spread = np.sum(share * centred**2, axis=0)
        spread = np.where((points >= 2) & (spread > 0), spread, np.nan)
        rise = share * centred / spread  # d slope / d y_k
        slope = np.sum(rise * y, axis=0)
        middle = share - rise * np.sum(share * x, axis=0)  # d intercept / d y_k
        intercept = np.sum(middle * y, axis=0)
    return Line(
        slope=slope,
        intercept=intercept,
        slope_variance=np.sum(rise**2 * variance, axis=0),
        intercept_variance=np.sum(middle**2 * variance, axis=0),
        covariance=np.sum(rise * middle * variance, axis=0),
    )


def emissivity(reference: Line, injection: Line) -> tuple[Floats, Floats]:
    """epsilon = 1 - s / g, and its variance. The two lines' errors are independent."""
    with np.errstate(divide="ignore", invalid="ignore"):
        through = injection.slope / reference.slope
        variance = injection.slope_variance + through**2 * reference.slope_variance
        return 1.0 - through, variance / reference.slope**2


def apparent_radiance(reference: Line, injection: Line) -> tuple[Floats, Floats]:
    """I(T_app) = (c_inj - c_ref) / (g - s), and its variance.

    dI = (dc_inj + I ds - dc_ref - I dg) / (g - s), with the covariance of each slope and intercept.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = reference.slope - injection.slope
        radiance = (injection.intercept - reference.intercept) / depth
        variance = sum(
            line.intercept_variance
            + radiance**2 * line.slope_variance
            + 2.0 * radiance * line.covariance
            for line in (reference, injection)
        )
        return radiance, np.asarray(variance / depth**2)


def shot_scatter(
    difference: Floats, observed: Floats, *, camera: Floats, degrees: Floats
) -> Floats:
    """Variance (K, ...) of one injection beyond the camera's noise: shots differ from one another.

    They differ by how much spray there is, which scales what the spray does to the picture, and by
    how warm it is, which adds the same before every background. So the variance of one shot before
    background k is taken to be

        camera_k + q difference_k^2 + p,    q, p >= 0,

    and q, p are found from the variances observed among the shots of each background by iterated
    least squares (a sample variance has the variance 2 V^2 / degrees). Two numbers a pixel instead
    of one a background keep the degrees of freedom together: five shots before five backgrounds
    give 20, where a single background has 4. Without scatter q and p still come out above 0 in
    half of the pixels; standard errors are then some 5 % too large on average.

    Args:
        difference: (K, ...) fitted Delta I.
        observed: (K, ...) sample variance of one shot.
        camera: (K, ...) variance of one shot by the camera's calibration.
        degrees: (K, ...) degrees of freedom of `observed`; 0 leaves the background out.
    """
    square = difference**2
    largest = np.max(square, axis=0)
    scaled = square / np.where(largest > 0, largest, 1.0)
    extra = np.zeros_like(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(4):
            weight = degrees / (camera + extra) ** 2
            weight = np.where(np.isfinite(weight), weight, 0.0)
            aa, ab, bb = (np.sum(weight * scaled**n, axis=0) for n in (2, 1, 0))
            excess = weight * (observed - camera)
            ae, be = np.sum(excess * scaled, axis=0), np.sum(excess, axis=0)
            both = aa * bb - ab**2
            q, p = (ae * bb - be * ab) / both, (be * aa - ae * ab) / both
            # Where one of the two would be negative, the other is fitted alone.
            alone_q, alone_p = ~(p > 0), ~(q > 0) & (p > 0)
            q = np.where(alone_q, ae / aa, np.where(alone_p, 0.0, q))
            p = np.where(alone_p, be / bb, np.where(alone_q, 0.0, p))
            q, p = (np.where(value > 0, value, 0.0) for value in (q, p))
            extra = q * scaled + p
    return extra
