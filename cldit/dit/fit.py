"""Two straight lines a pixel, fitted together, and what they say about a spray.

With x the radiance that leaves the background disc, a pixel that sees it shows

    without spray   I_ref = g x + c_ref     (g = 1 for an unobstructed disc without windows)
    with spray      I_inj = s x + c_inj

so that Delta I = I_inj - I_ref has the slope s - g = -epsilon g and the intercept
c_inj - c_ref = epsilon g I(T_app): Eq. (2) of the paper, divided by what the pixel sees of the
disc. Gain and offset of the pixel, and what a front window takes and adds, are in g and c_ref and
drop out: the references are a two-point correction of every pixel on its own.

Errors: every mean has its own (camera, scatter between shots). An error of the background's
temperature is common to references and injections before it, and moves them by g and s times as
much. So before each background the two means have the covariance

    ( a + g^2 d    g s d   )      a, b: variances of the two means
    ( g s d        b + s^2 d )    d: variance of x

and (g, c_ref, s, c_inj) is the generalised least squares estimate over all backgrounds (Aitken
1935), whose covariance is the inverse of the normal matrix. Where the spray is transparent (s = g)
a common error drops out; where it is opaque it is the error of x itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """Both lines of every pixel (N,); NaN where there are not two different backgrounds.

    values: (N, 4) g, c_ref, s, c_inj. covariance: (N, 4, 4). chi2: (N,) of the 2 K means about
    the lines, with 2 K - 4 degrees of freedom.
    """

    values: Floats
    covariance: Floats
    chi2: Floats

    def at(self, source: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """(K, N) of either line."""
        g, c_ref, s, c_inj = self.values.T
        return g * source[0][:, None] + c_ref, s * source[1][:, None] + c_inj

    def variance(self, gradient: Floats) -> Floats:
        """(N,) variance of a quantity with this gradient (N, 4), to first order."""
        return np.asarray(np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient))


def fit_pair(
    source: tuple[Floats, Floats],
    mean: tuple[Floats, Floats],
    *,
    variance: tuple[Floats, Floats],
    usable: NDArray[np.bool_],
    shared: Floats,
    slopes: tuple[Floats, Floats],
) -> Pair:
    """Generalised least squares over the backgrounds; see the module.

    Args:
        source: (K,) radiance of the background with references and with injections.
        mean, variance: (K, N) of either kind; finite. Variances that are all 0 stand for no noise:
            every background then counts alike, and the covariance is 0.
        usable: (K, N) False leaves a background out.
        shared: (K,) variance of the radiance of the background common to both kinds.
        slopes: (N,) g and s, as far as known, by which the shared error reaches the means.
    """
    unit = float(np.max(np.abs(source)))
    x_ref, x_inj = (one[:, None] / unit for one in source)
    noisy = any(bool(np.any(one)) for one in variance)
    a, b = (np.where(one > 0.0, one / unit**2, 1.0) for one in variance)
    d = shared[:, None] / unit**2
    g, s = slopes
    determinant = a * b + d * (a * s**2 + b * g**2)
    p_ref, p_inj, p_both = (
        np.where(usable, part / determinant, 0.0)
        for part in (b + d * s**2, a + d * g**2, -d * g * s)
    )
    y_ref, y_inj = (one / unit for one in mean)
    one = np.ones_like(x_ref)
    columns = ((x_ref, 0), (one, 0), (x_inj, 1), (one, 1))
    weight = ((p_ref, p_both), (p_both, p_inj))
    normal = np.empty((p_ref.shape[1], 4, 4))
    right = np.empty((p_ref.shape[1], 4))
    for i, (left, kind) in enumerate(columns):
        right[:, i] = np.sum(left * (weight[kind][0] * y_ref + weight[kind][1] * y_inj), axis=0)
        for j, (other, of) in enumerate(columns):
            normal[:, i, j] = np.sum(left * other * weight[kind][of], axis=0)
    known = np.ones(len(normal), bool)
    for line in (x_ref, x_inj):
        spread = np.where(usable, line, -np.inf).max(axis=0) - np.where(usable, line, np.inf).min(
            axis=0
        )
        known &= spread > 1e-12
    normal[~known] = np.eye(4)
    # Weights span many decades from pixel to pixel; scaled to a unit diagonal, the inverse is safe.
    scale = 1.0 / np.sqrt(np.einsum("nii->ni", normal))
    covariance = np.linalg.inv(normal * scale[:, :, None] * scale[:, None, :])
    covariance *= scale[:, :, None] * scale[:, None, :]
    values = np.einsum("nij,nj->ni", covariance, right)
    values[~known] = covariance[~known] = np.nan
    off_ref = y_ref - values[:, 0] * x_ref - values[:, 1]
    off_inj = y_inj - values[:, 2] * x_inj - values[:, 3]
    chi2 = np.sum(p_ref * off_ref**2 + p_inj * off_inj**2 + 2.0 * p_both * off_ref * off_inj, 0)
    units = np.array([1.0, unit, 1.0, unit])
    if not noisy:
        covariance = np.where(known[:, None, None], 0.0, np.nan)
        chi2 = np.full_like(chi2, np.nan)
    return Pair(
        values=values * units,
        covariance=covariance * units[:, None] * units,
        chi2=np.where(known, chi2, np.nan),
    )


def emissivity(lines: Pair) -> tuple[Floats, Floats]:
    """(N,) epsilon = 1 - s / g, and its variance."""
    g, _, s, _ = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        zero = np.zeros_like(g)
        gradient = np.stack([s / g**2, zero, -1.0 / g, zero], axis=1)
        return 1.0 - s / g, lines.variance(gradient)


def apparent_radiance(lines: Pair) -> tuple[Floats, Floats]:
    """(N,) I(T_app) = (c_inj - c_ref) / (g - s), and its variance."""
    g, c_ref, s, c_inj = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = g - s
        radiance = (c_inj - c_ref) / depth
        one = np.ones_like(g)
        gradient = np.stack([-radiance, -one, radiance, one], axis=1) / depth[:, None]
        return radiance, lines.variance(gradient)


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
