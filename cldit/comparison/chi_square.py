"""Chi-square of a difference with independent errors of the pixels and errors that they share.

The difference r of N pixels has the covariance D + U U', where D is diagonal (variances of errors
that differ from pixel to pixel) and each column of U is the change of r by one standard deviation
of an error that all pixels share, a mode. With z = D^-1/2 r and B = D^-1/2 U (Woodbury)

    chi2 = z'z - g' (1 + G)^-1 g        g = B'z, G = B'B
    a = (1 + G)^-1 g                    the modes that fit best, in their standard deviations

which is the generalised least squares sum, with the modes as nuisance parameters of variance 1.
Where neighbours are correlated, a has the sum of their correlations in place of 1.
Two statistics are independent of each other. Along the span of B and of a shift of all pixels, z
has the covariance of the modes and of the noise: it is large if the modes would have to be larger
than stated, or if all of a region is warmer. A shift that lies mostly in the span of the modes is
left to them: the rest of it is the noise of their patterns, which follows that of z; directions
along which the modes are smaller than the noise are left to the noise. Beside this span z is noise
alone, with N - t degrees of freedom, where t is the variance of the noise along the span: 1 for
each direction, or the sum of the correlations of neighbours. If the pixels are divided into parts,
each has a shift and a sum of squares of its own. All these statistics are independent of each
other, so that the least of their probabilities, for so many tests (Sidak 1967), is uniform.

A shift of all pixels by s has the noncentrality s^2 c' (1 + G)^-1 c, with c = span 1/error. The
smallest one that the test finds in a given share of all cases follows from noncentral F.

Variances that are estimated from few shots are themselves random. If one estimate with nu degrees
of freedom scales the covariance of m statistics, their sum of squares over m has Fisher's F
distribution with m and nu degrees. Where it makes only a share f of the variance, it counts with
nu / f^2 (Satterthwaite 1946). The mean over N pixels of estimated variances has the nu of a pixel
times the effective number of pixels, as they have the squared correlation of the errors.

Errors of neighbours are correlated (`cldit.camera.correlation`), which leaves the mean of chi2
unchanged and increases its variance to 2 sum rho_ij^2. The effective number of pixels is therefore
N^2 / sum rho_ij^2 (Satterthwaite 1946). The mean correlation of all pixels is too small for this
where some are more correlated than others: strata, in which the correlation is alike, have sums of
their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, fdtri, ncfdtrinc

from cldit.arrays import Floats, Mask
from cldit.camera.correlation import correlation

LEVEL, POWER = 0.01, 0.95  # of the test
_APART = 0.5  # least share of a shift's square beside the modes
_MANY = 1e7  # degrees of freedom of what is as good as known


@dataclass(frozen=True, kw_only=True)
class ChiSquare:
    """Result of the test over some pixels.

    pixels: their number; effective: that of independent pixels with the same scatter of chi2;
    correlated: factor of the variance of a mean by the correlation of neighbours.
    reduced: chi2 per pixel. p_value: probability of a larger difference by the errors alone.
    seen: shift of all pixels that is found at `LEVEL` with the probability `POWER`; infinite if the
    modes hide any. sizes: (M,) of the modes that fit best, in standard deviations. residuals: (H,
    W) standardised, less these modes; NaN elsewhere.
    """

    pixels: int
    effective: float
    correlated: float
    reduced: float
    p_value: float
    seen: float
    sizes: Floats
    residuals: Floats


def chi_square(
    change: Floats,
    error: Floats,
    modes: Floats,
    where: Mask,
    *,
    degrees: tuple[float, float] = (np.inf, np.inf),
    parts: Sequence[Mask] = (),
    strata: Sequence[Mask] = (),
    level: float = LEVEL,
) -> ChiSquare | None:
    """Chi-square of a `change` (H, W) in the pixels `where`; None without any.

    error: (H, W) independent standard errors above 0. modes: (M, H, W). Pixels in which any of
    these is not finite are omitted. degrees: of freedom of the estimates of both, above 0. parts,
    strata: into which `where` is divided, by place and by correlation; none: it is one. level: of
    the test, for the shift that is seen.
    """
    where = where & np.isfinite(change) & np.isfinite(error) & np.isfinite(modes).all(axis=0)
    count = int(np.count_nonzero(where))
    if count == 0:
        return None
    z = change[where] / error[where]
    b, even = modes[:, where] / error[where], 1.0 / error[where]
    parts, strata = (
        [mask[where] for mask in masks if mask[where].any()] or [np.ones(count, bool)]
        for masks in (parts, strata)
    )
    span = _span(b, [np.where(part, even, 0.0) for part in parts])
    noise = z - (span @ z) @ span
    residuals = np.full(change.shape, np.nan)
    alike = list[tuple[float, float]]()
    for stratum in strata:
        residuals[where] = np.where(stratum, noise, np.nan)
        alike.append(correlation(residuals))
    chances = _beside(noise, span, parts, list(zip(strata, alike, strict=True)), degrees[0])
    scatter, sum_squares, sum_products = np.zeros((len(span), len(span))), 0.0, 0.0
    for stratum, (squares, products) in zip(strata, alike, strict=True):
        scatter += products * span[:, stratum] @ span[:, stratum].T
        sum_squares += squares * np.sum(stratum)
        sum_products += products * np.sum(stratum)
    even_products = sum_products / count
    sizes = np.asarray(np.linalg.solve(even_products * np.eye(len(b)) + b @ b.T, b @ z), float)
    residuals[where] = z - sizes @ b
    seen = np.inf
    if len(span):
        level = sidak_level(level, len(chances) + 1)
        chance, seen = _along(span, z, b, even, scatter, degrees=degrees[1], level=level)
        chances.append(chance)
    return ChiSquare(
        pixels=count,
        effective=count**2 / sum_squares,
        correlated=even_products,
        reduced=float(np.sum(residuals[where] ** 2) + sizes @ sizes) / count,
        p_value=sidak(chances),
        seen=seen,
        sizes=sizes,
        residuals=residuals,
    )


def _beside(
    noise: Floats,
    span: Floats,
    parts: Sequence[Mask],
    strata: Sequence[tuple[Mask, tuple[float, float]]],
    degrees: float,
) -> list[float]:
    """Probabilities of larger noise beside the span, in each part of each stratum.

    strata: with the sums of their squared correlations and of their correlations. degrees: of
    freedom of the variance of a pixel.
    """
    chances = []
    for stratum, (squares, products) in strata:
        for inside in (part & stratum for part in parts):
            freedom = float(np.sum(inside) - products * np.sum(span[:, inside] ** 2))
            if freedom >= 1.0:
                beside, independent = np.sum(noise[inside] ** 2) / freedom, freedom / squares
                chances.append(_chance(beside, independent, degrees * independent))
    return chances


def _along(
    span: Floats,
    z: Floats,
    b: Floats,
    even: Floats,
    scatter: Floats,
    *,
    degrees: float,
    level: float,
) -> tuple[float, float]:
    """Probability of a larger z along the span, and the least shift seen at the `level`.

    scatter: covariance of the noise along the span; degrees: of freedom of the modes' sizes.
    """
    count, along = len(span), span @ b.T
    inverse = np.linalg.inv(scatter + along @ along.T)
    share = float(np.trace(inverse @ along @ along.T)) / count
    degrees = min(degrees / max(share, 1e-6) ** 2, _MANY)
    statistic, square = (float(span @ image @ inverse @ (span @ image)) for image in (z, even))
    critical = float(fdtri(count, degrees, 1.0 - level))
    seen = float(np.sqrt(ncfdtrinc(count, degrees, 1.0 - POWER, critical) / square))
    return _chance(statistic / count, count, degrees), seen


def _span(modes: Floats, shifts: Sequence[Floats]) -> Floats:
    """Orthonormal rows (m, N) along the modes, and along shifts of parts, which have no error."""
    span = _orthonormal(modes)
    for shift in shifts:
        rest = shift - span.T @ (span @ shift)
        if rest @ rest > _APART * (shift @ shift):
            span = np.concatenate([span, rest[None] / np.linalg.norm(rest)])
    return span


def probability(value: float) -> str:
    """`p = 0.03`; never 1, for which the errors are too large."""
    if value > 1.0 - LEVEL:
        return f"p > {1.0 - LEVEL:g}"
    return f"p = {value:.2g}" if value > 1e-9 else "p < 1e-9"


def sidak(chances: Sequence[float]) -> float:
    """Probability of the least of several independent probabilities (Sidak 1967)."""
    return float(-np.expm1(len(chances) * np.log1p(-min(*chances, 1.0 - 1e-16))))


def sidak_level(level: float, tests: int) -> float:
    """Level of each of several independent tests of which the least probability counts."""
    return float(-np.expm1(np.log1p(-level) / tests))


def combined_degrees(
    variances: Sequence[float], degrees: Sequence[float], *, total_variance: float | None = None
) -> float:
    """Degrees of freedom of a sum of variances, each with its own (Satterthwaite 1946).

    whole: the sum, of which these may be a part; None: there are no others.
    """
    total = sum(variances) if total_variance is None else total_variance
    square = sum(variance**2 / of for variance, of in zip(variances, degrees, strict=True))
    return float(total**2 / square) if square > 0.0 else np.inf


def _orthonormal(rows: Floats) -> Floats:
    """Orthonormal rows of the same span, without directions shorter than 1, that of the noise."""
    values, vectors = np.linalg.eigh(rows @ rows.T)
    seen = values > max(1.0, 1e-9 * values.max(initial=0.0))
    return np.asarray((vectors[:, seen] / np.sqrt(values[seen])).T @ rows)


def _chance(value: float, degrees: float, of_variance: float) -> float:
    """Probability of a larger ratio of variances, F."""
    return float(fdtrc(degrees, min(of_variance, _MANY), value))
