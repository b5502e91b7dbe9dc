"""Two straight lines per pixel, fitted together: emissivity and apparent radiance of a spray.

With x the radiance that leaves the background disc, a pixel that sees it has the signals

    without spray   I_ref = g x + c_ref     (g = 1 for an unobstructed disc without windows)
    with spray      I_inj = s x + c_inj

so that Delta I = I_inj - I_ref has the slope s - g = -epsilon g and the intercept
c_inj - c_ref = epsilon g I(T_app): Eq. (2) of the paper, divided by the share of the disc in the
pixel. Gain and offset of the pixel and the effects of a front window are in g and c_ref and cancel:
the references are a two-point correction of every pixel.

Errors: every mean has its own (camera, scatter between shots). Others are common to references and
injections of one background: the black body's temperature changes them by g and s, the camera's
offset by 1 and 1, its gain by the two signals. The means at each background thus have the
covariance

    ( a + sum p^2 d    sum p q d   )      a, b: variances of the two means
    ( sum p q d        b + sum q^2 d )    d: variance of a common error, p and q its two factors

and (g, c_ref, s, c_inj) is the generalised least squares estimate over all backgrounds (Aitken
1935), whose covariance is the inverse of the normal matrix. Where the spray is transparent (s = g)
a common error cancels. An offset always cancels: if its variance is large compared with the noise,
only I_inj - I_ref counts, as in the paper.

A steady error is one number a for all backgrounds: it adds a u to the 2 K means, u known, a of
variance 1. With V the covariance above, X the design, b0 and C0 the estimate without it,

    P = C0 X' V^-1 u            its change of the lines
    S = 1 + u' (V^-1 - V^-1 X C0 X' V^-1) u      q = u' V^-1 (y - X b0)
    b = b0 - P q / S            C = C0 + P P' / S            chi2 = chi2_0 - q^2 / S

which is the same estimate with V + u u' (Woodbury), for several a in turn. If u is the true error,
a = 1, then the mean squared error of b is C: with the precision r = S - 1 of a by the data, the
prior's part (1 / S)^2 and the noise's part r / S^2 add up to 1 / S.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from cldit.arrays import Floats, Mask

_ALIKE = 1e-9  # share of the determinant
_LEAST_CAMERA = 0.5  # share of the camera's noise that scatter between shots may take away
_NEARBY = 3  # pixels: edge of the neighbourhood, nine times the degrees of freedom of a pixel


@dataclass(frozen=True, kw_only=True)
class SharedError:
    """An error that references and injections share.

    reference, injection: (N,) or (K, N), change of either mean by an error of 1. variance: (K,) or,
    of single pixels, (K, N), if it is independent at each background; None: one number of variance
    1 for all backgrounds (steady, (K, N)).
    """

    reference: Floats
    injection: Floats
    variance: Floats | None = None


@dataclass(frozen=True)
class Pair:
    """Both lines of every pixel (N,); NaN where there are not two different backgrounds.

    values: (N, 4) g, c_ref, s, c_inj. covariance: (N, 4, 4). chi2: (N,) of the 2 K means about
    the lines, with 2 K - 4 degrees of freedom. shared: (M, N, 4) changes of the values by one
    standard deviation of each of M independent errors that all pixels have in common; their
    squares are part of the covariance.
    """

    values: Floats
    covariance: Floats
    chi2: Floats
    shared: Floats | None = None

    def at(self, source: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """(K, N) signals of either line at the radiances `source`, (K,) each."""
        g, c_ref, s, c_inj = self.values.T
        return g * source[0][:, None] + c_ref, s * source[1][:, None] + c_inj

    def between(self, gradient: Floats, partner: Floats) -> Floats:
        """(N,) covariance of two quantities with these gradients (N, 4), to first order."""
        with np.errstate(invalid="ignore", over="ignore"):  # gradients of unseen spray are infinite
            change = _times(self.covariance.transpose(1, 2, 0), partner.T)
            return np.asarray((gradient.T * change).sum(axis=0))

    def variance(self, gradient: Floats) -> Floats:
        """(N,) variance of a quantity with this gradient (N, 4), to first order."""
        return self.between(gradient, gradient)


def fit_pair(
    source: tuple[Floats, Floats],
    mean: tuple[Floats, Floats],
    *,
    variance: tuple[Floats, Floats],
    usable: Mask,
    errors: Sequence[SharedError] = (),
    with_shared: bool = False,
) -> Pair:
    """Generalised least squares over the backgrounds; see the module.

    Args:
        source: (K,) radiance of the background with references and with injections.
        mean, variance: (K, N) of either kind; finite. Variances that are all 0 mean no noise: all
            backgrounds then have the same weight, and the covariance is 0.
        usable: (K, N) False excludes a background.
        errors: those that both kinds share; steady ones are ignored without noise.
        with_shared: compute `Pair.shared`, of errors that all pixels have in common.
    """
    unit = float(np.max(np.abs(source)))
    lines = source[0][:, None] / unit, source[1][:, None] / unit
    signals = mean[0] / unit, mean[1] / unit
    noisy = any(bool(np.any(values)) for values in variance)
    common = [(e.variance, e.reference, e.injection) for e in errors if e.variance is not None]
    weight = _Weight.of(variance, common, usable, unit=unit)
    determined = _determined(lines, usable)
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = _inverse(*weight.normal(lines))
    covariance[:, :, ~determined] = np.nan
    right = _in_design(lines, weight.times(signals))
    values = _times(covariance, right)
    residuals = _residuals(signals, lines, values)
    chi2 = weight.chi2(residuals)
    columns = [
        tuple(np.where(usable, part, 0.0) / unit for part in (error.reference, error.injection))
        for error in errors
        if noisy and error.variance is None
    ]
    eliminated = _Steady.of(columns, weight, lines=lines, covariance=covariance)
    values, decrease = eliminated.values(
        values, [_sum(column, residuals) for column in eliminated.weighted]
    )
    shared = []
    for row, deviation in _deviations(common, unit) if with_shared and noisy else ():
        design = _in_design(_at(lines, row), weight.at(row).times(deviation))
        shown = [_sum(_at(column, row), deviation) for column in eliminated.weighted]
        shared.append(eliminated.of_error(_times(covariance, design), shown))
    if with_shared:
        shared += [eliminated.of_error(by, list(shown)) for by, shown in eliminated.isolated]
    covariance, chi2 = covariance + eliminated.covariance, np.maximum(chi2 - decrease, 0.0)
    if not noisy:
        covariance = np.where(determined, np.zeros((4, 4, 1)), np.nan)
        chi2 = np.full_like(chi2, np.nan)
    units = np.array([1.0, unit, 1.0, unit])[:, None]
    return Pair(
        values=(values * units).T,
        covariance=(covariance * units[:, None] * units).transpose(2, 0, 1),
        chi2=np.where(determined, chi2, np.nan),
        shared=np.stack([(change * units).T for change in shared]) if shared else None,
    )


_ByKind = tuple[Floats, ...]
"""Arrays (K, N) or (K, 1) of references and of injections."""
_Common = tuple[Floats, Floats, Floats]
"""Variance and factors p and q of a common error."""


@dataclass(frozen=True)
class _Weight:
    """Inverse V^-1 of the covariance of the means: (K, N) of references, of injections, and between
    them; None if they are independent."""

    reference: Floats
    injection: Floats
    between: Floats | None = None

    @classmethod
    def of(
        cls, variance: _ByKind, common: Sequence[_Common], usable: Mask, *, unit: float
    ) -> "_Weight":
        """The weight in units of `unit`^-2; 0 where a mean is not `usable` (K, N)."""
        a, b = (np.where(values > 0.0, values / unit**2, 1.0) for values in variance)
        scaled = [
            (size.reshape(len(usable), -1) / unit**2, p, q)
            for size, p, q in common
            if np.any(size > 0.0)
        ]
        if not scaled:
            return cls(*(np.where(usable, 1.0 / values, 0.0) for values in (a, b)))
        # a b - c^2 in a form in which nothing cancels where a common error is far above the noise
        determinant, c, total_a, total_b = a * b, np.zeros_like(a), a, b
        for number, (d, p, q) in enumerate(scaled):
            determinant = determinant + d * (a * q**2 + b * p**2)
            for e, r, t in scaled[:number]:
                determinant = determinant + d * e * (p * t - q * r) ** 2
            total_a, total_b, c = total_a + d * p**2, total_b + d * q**2, c + d * p * q
        return cls(*(np.where(usable, part / determinant, 0.0) for part in (total_b, total_a, -c)))

    def at(self, row: slice) -> "_Weight":
        """The weight (1, N) at one background."""
        between = None if self.between is None else self.between[row]
        return _Weight(self.reference[row], self.injection[row], between)

    def times(self, values: _ByKind) -> _ByKind:
        """V^-1 y (K, N) by kind, of the `values` y."""
        ref, inj = values
        if self.between is None:
            return self.reference * ref, self.injection * inj
        return (
            self.reference * ref + self.between * inj,
            self.injection * inj + self.between * ref,
        )

    def normal(self, lines: _ByKind) -> tuple[Floats, Floats, Floats]:
        """Blocks (2, 2, N) of the normal matrix of both lines: upper, corner and lower."""
        ref, inj = lines
        corner = np.zeros((2, 2, 1))
        if self.between is not None:
            corner = _moments(self.between, ref, inj)
        return _moments(self.reference, ref, ref), corner, _moments(self.injection, inj, inj)

    def chi2(self, residuals: _ByKind) -> Floats:
        """(N,) weighted sum of squares of the `residuals`."""
        ref, inj = residuals
        squares = self.reference * ref**2 + self.injection * inj**2
        if self.between is not None:
            squares += 2.0 * self.between * ref * inj
        return np.asarray(squares.sum(axis=0))


def _determined(lines: _ByKind, usable: Mask) -> Mask:
    """(N,) True where both lines have two usable backgrounds of different radiance."""
    determined = np.ones(usable.shape[1], bool)
    for line in lines:
        highest = np.where(usable, line, -np.inf).max(axis=0)
        determined &= highest - np.where(usable, line, np.inf).min(axis=0) > 1e-12
    return determined


def _residuals(signals: _ByKind, lines: _ByKind, values: Floats) -> _ByKind:
    """(K, N) by kind, of the `signals` about lines with these `values` (4, N)."""
    return (
        signals[0] - values[0] * lines[0] - values[1],
        signals[1] - values[2] * lines[1] - values[3],
    )


def _deviations(common: Sequence[_Common], unit: float) -> Iterator[tuple[slice, _ByKind]]:
    """Background of each error that all pixels have in common, and one standard deviation (1, N)
    of it in both kinds there."""
    for variance, *factors in common:
        for k in np.flatnonzero(variance) if variance.ndim == 1 else ():
            row, size = slice(k, k + 1), np.sqrt(variance[k]) / unit
            yield row, tuple(size * (part[row] if part.ndim == 2 else part[None])
                             for part in factors)  # fmt: skip


def _at(arrays: _ByKind, row: slice) -> _ByKind:
    return tuple(array[row] for array in arrays)


def _sum(weighted: _ByKind, values: _ByKind) -> Floats:
    """Products (N,) of `weighted` means and the `values` of both kinds."""
    return np.asarray((weighted[0] * values[0] + weighted[1] * values[1]).sum(axis=0))


def _in_design(lines: _ByKind, weighted: _ByKind) -> Floats:
    """X' V^-1 y (4, N) of the `weighted` means V^-1 y."""
    ref, inj = weighted
    return np.stack([lines[0].T[0] @ ref, ref.sum(0), lines[1].T[0] @ inj, inj.sum(0)])


@dataclass(frozen=True)
class _Steady:
    """Change of an estimate by steady errors, see the module, one after the other: those that
    follow see what the earlier ones explain.

    weighted: V^-1 u of each; in_design: X' V^-1 u (4, N). isolated: change of the lines by the
    error without others, and its products u' V^-1 u' with all. change: (4, N) of the lines by each,
    without the earlier ones. scale: (N,) its S. share: (M, N) of its q in those of all. covariance:
    (4, 4, N) added by all.
    """

    weighted: Sequence[_ByKind]
    in_design: Sequence[Floats]
    isolated: list[tuple[Floats, Floats]]
    change: list[Floats]
    scale: list[Floats]
    share: list[Floats]
    covariance: Floats | float

    @classmethod
    def of(
        cls, columns: Sequence[_ByKind], weight: _Weight, *, lines: _ByKind, covariance: Floats
    ) -> "_Steady":
        """Eliminates errors u, the `columns`. lines: (K, 1) radiance of the background.
        covariance: of the estimate without them."""
        if not columns:
            return cls([], [], [], [], [], [], 0.0)
        weighted = [weight.times(column) for column in columns]
        in_design = [_in_design(lines, column) for column in weighted]
        change = np.array([_times(covariance, column) for column in in_design])
        products = np.empty((len(columns), len(columns), change.shape[2]))
        for row, of_row in enumerate(weighted):
            for column, error in enumerate(columns[: row + 1]):
                products[row, column] = products[column, row] = _sum(of_row, error)
        size = products - np.array([(design * change).sum(axis=1) for design in in_design])
        added = np.zeros_like(covariance)
        isolated = list(zip(change, products, strict=True))
        steady = cls(weighted, in_design, isolated, [], [], [], added)
        for k in range(len(columns)):
            scale = 1.0 + np.maximum(size[k, k], 0.0)
            share = size[:, k] / scale
            steady.change.append(change[k])
            steady.scale.append(scale)
            steady.share.append(share)
            added += change[k] * change[k][:, None] / scale
            change = change - share[:, None] * change[k]
            size = size - share[:, None] * size[k]
        return steady

    def of_error(self, change: Floats, products: Sequence[Floats]) -> Floats:
        """Change (4, N) of the lines by an error, from that without steady errors, and from the
        `products` u' V^-1 y (N,) of each with it."""
        pairs = zip(products, self.in_design, strict=True)
        return self.values(change, [p - (design * change).sum(axis=0) for p, design in pairs])[0]

    def values(self, values: Floats, q: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Values (4, N) and decrease of chi2 (N,), from the estimate `values` without steady
        errors, and from the q of each by its residuals."""
        decrease = np.zeros(values.shape[1])
        for k, (change, scale, share) in enumerate(
            zip(self.change, self.scale, self.share, strict=True)
        ):
            values = values - change * (q[k] / scale)
            decrease += q[k] ** 2 / scale
            q = [later - part * q[k] for later, part in zip(q, share, strict=True)]
        return values, decrease


def _moments(weight: Floats, line: Floats, partner: Floats) -> Floats:
    """(2, 2, N) sums over the backgrounds of `weight` (K, N) times (line, 1) times (partner, 1)."""
    x, y = line.T[0], partner.T[0]
    return np.array([[(x * y) @ weight, x @ weight], [y @ weight, weight.sum(axis=0)]])


def _inverse(a: Floats, b: Floats, d: Floats) -> Floats:
    """(4, 4, N) inverse of the symmetric matrices ((a, b), (b', d)) of (2, 2, N) blocks.

    By blocks and in closed form (Schur complement), for a general inverse of a million small
    matrices takes longer than all the rest of an evaluation.
    """
    of_a = _inverse_2(a)
    if not b.any():
        of_d = _inverse_2(d)
        nothing = np.zeros_like(of_a)
        return _blocks(of_a, nothing, of_d)
    back = _product(of_a, b)
    of_d = _inverse_2(d - _product(b.transpose(1, 0, 2), back))
    corner = -_product(back, of_d)
    return _blocks(of_a - _product(corner, back.transpose(1, 0, 2)), corner, of_d)


def _inverse_2(m: Floats) -> Floats:
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return np.asarray(np.array([[m[1, 1], -m[0, 1]], [-m[1, 0], m[0, 0]]]) / determinant)


def _product(matrix: Floats, factor: Floats) -> Floats:
    """Products (I, J, N) of matrices (I, K, N) and (K, J, N): einsum takes ten times as long."""
    columns = matrix.swapaxes(0, 1)[:, :, None]
    return np.asarray(sum(column * row for column, row in zip(columns, factor, strict=True)))


def _times(matrix: Floats, vector: Floats) -> Floats:
    """Products (I, N) of matrices (I, K, N) and vectors (K, N)."""
    return _product(matrix, vector[:, None])[:, 0]


def _blocks(upper: Floats, corner: Floats, lower: Floats) -> Floats:
    top = np.concatenate([upper, corner], axis=1)
    bottom = np.concatenate([corner.transpose(1, 0, 2), lower], axis=1)
    return np.concatenate([top, bottom])


def emissivity(lines: Pair) -> tuple[Floats, Floats]:
    """(N,) epsilon = 1 - s / g, and its variance."""
    g, _, s, _ = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return 1.0 - s / g, lines.variance(emissivity_gradient(lines))


def emissivity_gradient(lines: Pair) -> Floats:
    """(N, 4) derivatives of the emissivity by the values of the lines."""
    g, _, s, _ = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        zero = np.zeros_like(g)
        return np.stack([s / g**2, zero, -1.0 / g, zero], axis=1)


def apparent_radiance(lines: Pair) -> tuple[Floats, Floats]:
    """(N,) I(T_app) = (c_inj - c_ref) / (g - s), and its variance."""
    g, c_ref, s, c_inj = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return (c_inj - c_ref) / (g - s), lines.variance(radiance_gradient(lines))


def radiance_gradient(lines: Pair) -> Floats:
    """(N, 4) derivatives of the apparent radiance by the values of the lines."""
    g, c_ref, s, c_inj = lines.values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = g - s
        radiance, ones = (c_inj - c_ref) / depth, np.ones_like(g)
        gradient = np.stack([-radiance, -ones, radiance, ones], axis=1)
        return np.asarray(gradient / depth[:, None])


def shot_scatter(
    change: Floats, observed: Floats, *, camera: Floats, degrees: Floats, shape: tuple[int, ...]
) -> Floats:
    """Variance (K, ...) of one injection beyond the camera's noise, due to differences of shots.

    Shots differ in the amount of spray, which changes its signal least where it is opaque, and in
    its temperature, which adds the same signal at every background. The variance of one shot at
    background k is therefore

        camera_k + q change_k^2 + p

    and q, p are found from the variances observed among the shots of each background by iterated
    least squares over neighbours (a sample variance has the variance 2 V^2 / degrees). Neighbours
    have one weight per background, that of their fitted V: with weights of their own, those whose
    observed variance is small by chance would count most, and V would be 2 % too small with five
    shots. Two numbers per pixel instead of one per background combine the degrees of freedom. Both
    are below 0 where the shots agree better than the camera's noise lets expect: without such
    pixels the mean variance would be too large. At least half of the camera's part is left.

    A value with an estimated variance of nu degrees of freedom has Student's distribution, whose
    variance is larger by 1 + 2 / nu (JCGM 101:2008, 6.4.9.4, to first order). The result contains
    this; neighbours count as independent.

    All arrays are (K, ...): change of the signal by a relative change of the amount, sample
    variance of one shot, the camera's part of it, and degrees of freedom of the sample variance; 0
    excludes a background.
    """

    def nearby(values: Floats) -> Floats:
        """Means (K, ...) over the neighbourhood of each pixel."""
        images = np.broadcast_to(values, camera.shape).reshape(-1, *shape)
        means = scipy.ndimage.uniform_filter(images, (1, _NEARBY, _NEARBY))
        return np.asarray(means.reshape(camera.shape))

    square = change**2
    scaled = square / max(float(square.max(initial=0.0)), np.finfo(float).tiny)
    mean_camera, mean_scaled = nearby(camera), nearby(scaled)
    moments = [nearby(degrees * scaled**n) for n in range(3)]
    beyond = degrees * (observed - camera)
    excess = [nearby(beyond * scaled**n) for n in range(2)]
    variance = mean_camera
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(4):
            weight = 1.0 / variance**2
            weight = np.where(np.isfinite(weight), weight, 0.0)
            bb, ab, aa = (np.sum(weight * moment, axis=0) for moment in moments)
            be, ae = (np.sum(weight * moment, axis=0) for moment in excess)
            determinant = aa * bb - ab**2
            q, p = (ae * bb - be * ab) / determinant, (be * aa - ae * ab) / determinant
            # changes of one size do not tell the two apart
            constant = ~(determinant > _ALIKE * aa * bb)
            q, p = np.where(constant, 0.0, q), np.where(constant, be / bb, p)
            variance = mean_camera + np.maximum(q * mean_scaled + p, -_LEAST_CAMERA * mean_camera)
        extra = np.nan_to_num(np.maximum(q * scaled + p, -_LEAST_CAMERA * camera))
        of_fit = (scaled**2 * bb - 2.0 * scaled * ab + aa) / determinant
        relative = np.where(constant, 1.0 / bb, of_fit) / (_NEARBY * variance) ** 2
    return np.asarray(extra + 2.0 * np.nan_to_num(relative) * (camera + extra))
