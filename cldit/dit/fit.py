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
from scipy.ndimage import uniform_filter

from cldit.arrays import Floats, Mask

_ALIKE = 1e-9  # share of the determinant
_LEAST_CAMERA = 0.5  # share of the camera's noise that scatter between shots may take away
_NEARBY = 3  # pixels: edge of the neighbourhood whose scatter between shots is pooled


@dataclass(frozen=True, kw_only=True)
class CommonError:
    """An error that references and injections of one background share.

    variance: (K,) or, of single pixels, (K, N). reference, injection: (N,) or (K, N), change of
    either mean by an error of 1.
    """

    variance: Floats
    reference: Floats
    injection: Floats


@dataclass(frozen=True, kw_only=True)
class SteadyError:
    """One error of variance 1 for all backgrounds.

    reference, injection: (K, N), change of either mean by an error of 1.
    """

    reference: Floats
    injection: Floats


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

    def variance(self, gradient: Floats) -> Floats:
        """(N,) variance of a quantity with this gradient (N, 4), to first order."""
        return np.asarray(np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient))


def fit_pair(
    source: tuple[Floats, Floats],
    mean: tuple[Floats, Floats],
    *,
    variance: tuple[Floats, Floats],
    usable: Mask,
    common: Sequence[CommonError] = (),
    steady: Sequence[SteadyError] = (),
    with_shared: bool = False,
) -> Pair:
    """Generalised least squares over the backgrounds; see the module.

    Args:
        source: (K,) radiance of the background with references and with injections.
        mean, variance: (K, N) of either kind; finite. Variances that are all 0 mean no noise: all
            backgrounds then have the same weight, and the covariance is 0.
        usable: (K, N) False excludes a background.
        common: errors that both kinds share, independent at each background.
        steady: errors that are one number for all backgrounds; ignored without noise.
        with_shared: compute `Pair.shared`, of common errors of all pixels and of steady ones.
    """
    unit = float(np.max(np.abs(source)))
    x_ref, x_inj = (one[:, None] / unit for one in source)
    noisy = any(bool(np.any(one)) for one in variance)
    a, b = (np.where(one > 0.0, one / unit**2, 1.0) for one in variance)
    present = [one for one in common if np.any(one.variance > 0.0)]
    together = bool(present)
    if together:
        # a b - c^2 in a form in which nothing cancels where a common error is far above the noise
        determinant, both = a * b, np.zeros_like(a)
        whole_a, whole_b = a.copy(), b.copy()
        scaled = [
            (one.variance.reshape(len(x_ref), -1) / unit**2, one.reference, one.injection)
            for one in present
        ]
        for number, (d, p, q) in enumerate(scaled):
            determinant = determinant + d * (a * q**2 + b * p**2)
            for e, r, t in scaled[:number]:
                determinant = determinant + d * e * (p * t - q * r) ** 2
            whole_a, whole_b, both = whole_a + d * p**2, whole_b + d * q**2, both + d * p * q
        p_ref, p_inj, p_both = (
            np.where(usable, part / determinant, 0.0) for part in (whole_b, whole_a, -both)
        )
    else:  # two fits that know nothing of each other
        p_ref, p_inj = (np.where(usable, 1.0 / one, 0.0) for one in (a, b))
    y_ref, y_inj = (one / unit for one in mean)
    known = np.ones(p_ref.shape[1], bool)
    for line in (x_ref, x_inj):
        spread = np.where(usable, line, -np.inf).max(axis=0) - np.where(usable, line, np.inf).min(
            axis=0
        )
        known &= spread > 1e-12
    before, after = _moments(p_ref, x_ref, x_ref), _moments(p_inj, x_inj, x_inj)
    if together:
        across = _moments(p_both, x_ref, x_inj)
        right_ref, right_inj = p_ref * y_ref + p_both * y_inj, p_inj * y_inj + p_both * y_ref
    else:
        across = np.zeros((2, 2, 1))
        right_ref, right_inj = p_ref * y_ref, p_inj * y_inj
    right = np.stack(
        [x_ref.T[0] @ right_ref, right_ref.sum(0), x_inj.T[0] @ right_inj, right_inj.sum(0)]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = _inverse(before, across, after)
    covariance[:, :, ~known] = np.nan
    values = np.einsum("ijn,jn->in", covariance, right)
    off_ref = y_ref - values[0] * x_ref - values[1]
    off_inj = y_inj - values[2] * x_inj - values[3]
    squares = p_ref * off_ref**2 + p_inj * off_inj**2
    if together:
        squares += 2.0 * p_both * off_ref * off_inj
    chi2 = squares.sum(axis=0)

    def weighed(ref: Floats, inj: Floats) -> tuple[Floats, Floats]:
        if together:
            return p_ref * ref + p_both * inj, p_inj * inj + p_both * ref
        return p_ref * ref, p_inj * inj

    columns = [
        (np.where(usable, one.reference, 0.0) / unit, np.where(usable, one.injection, 0.0) / unit)
        for one in (steady if noisy else ())
    ]
    weighed_columns = [weighed(*one) for one in columns]
    lines = (x_ref, x_inj)
    alone, shared = covariance, []
    known_by = _Steady.of(columns, weighed_columns, lines=lines, covariance=alone)
    values, less = known_by.values(values, (off_ref, off_inj))
    covariance, chi2 = alone + known_by.covariance, np.maximum(chi2 - less, 0.0)
    for ref, inj in (*_deviations(common, unit), *columns) if with_shared and noisy else ():
        change = np.einsum("ijn,jn->in", alone, _in_design(lines, weighed(ref, inj)))
        off = ref - change[0] * x_ref - change[1], inj - change[2] * x_inj - change[3]
        shared.append(known_by.values(change, off)[0])
    units = np.array([1.0, unit, 1.0, unit])[:, None]
    if not noisy:
        covariance = np.where(known, np.zeros((4, 4, 1)), np.nan)
        chi2 = np.full_like(chi2, np.nan)
    return Pair(
        values=(values * units).T,
        covariance=(covariance * units[:, None] * units).transpose(2, 0, 1),
        chi2=np.where(known, chi2, np.nan),
        shared=np.stack([(one * units).T for one in shared]) if shared else None,
    )


def _deviations(common: Sequence[CommonError], unit: float) -> Iterator[tuple[Floats, Floats]]:
    """One standard deviation (K, N) in both kinds of each error that is common to all pixels."""
    for one in common:
        for k in np.flatnonzero(one.variance) if one.variance.ndim == 1 else ():
            at = (np.arange(len(one.variance)) == k)[:, None] * np.sqrt(one.variance[k]) / unit
            yield at * one.reference, at * one.injection


def _in_design(lines: tuple[Floats, Floats], weighed: tuple[Floats, Floats]) -> Floats:
    """X' V^-1 y (4, N) of the weighted means V^-1 y (K, N) of both kinds."""
    ref, inj = weighed
    return np.stack([(lines[0] * ref).sum(0), ref.sum(0), (lines[1] * inj).sum(0), inj.sum(0)])


@dataclass(frozen=True)
class _Steady:
    """Change of an estimate by steady errors, see the module, one after the other: those that
    follow see what the earlier ones explain.

    weighed: V^-1 u of each, (K, N) of either kind. taken: (4, N) change of the lines by each.
    alone: (N,) its S. share: (M, N) of its q in those of all. covariance: (4, 4, N) added by all.
    """

    weighed: Sequence[tuple[Floats, Floats]]
    taken: list[Floats]
    alone: list[Floats]
    share: list[Floats]
    covariance: Floats | float

    @classmethod
    def of(
        cls,
        columns: Sequence[tuple[Floats, Floats]],
        weighed: Sequence[tuple[Floats, Floats]],
        *,
        lines: tuple[Floats, Floats],
        covariance: Floats,
    ) -> "_Steady":
        """Eliminates errors u (K, N) of either kind. lines: (K, 1) radiance of the background.
        covariance: of the estimate without them."""
        if not columns:
            return cls([], [], [], [], 0.0)
        in_design = [_in_design(lines, one) for one in weighed]
        taken = np.array([np.einsum("ijn,jn->in", covariance, one) for one in in_design])
        size = np.empty((len(columns), len(columns), taken.shape[2]))
        for row, (r, i) in enumerate(weighed):
            for column, (u_r, u_i) in enumerate(columns):
                whole = (r * u_r + i * u_i).sum(axis=0)
                size[row, column] = whole - np.sum(in_design[row] * taken[column], axis=0)
        added = np.zeros_like(covariance)
        steady = cls(weighed, [], [], [], added)
        for k in range(len(columns)):
            alone = 1.0 + np.maximum(size[k, k], 0.0)
            share = size[:, k] / alone
            steady.taken.append(taken[k])
            steady.alone.append(alone)
            steady.share.append(share)
            added += taken[k] * taken[k][:, None] / alone
            taken = taken - share[:, None] * taken[k]
            size = size - share[:, None] * size[k]
        return steady

    def values(self, values: Floats, off: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Values (4, N) and decrease of chi2 (N,) by the residuals `off` (K, N) of the estimate
        `values` without steady errors."""
        less = np.zeros(values.shape[1])
        q = [(r * off[0] + i * off[1]).sum(axis=0) for r, i in self.weighed]
        for k, (taken, alone, share) in enumerate(
            zip(self.taken, self.alone, self.share, strict=True)
        ):
            values = values - taken * (q[k] / alone)
            less += q[k] ** 2 / alone
            now = q[k]
            q = [each - part * now for each, part in zip(q, share, strict=True)]
        return values, less


def _moments(weight: Floats, one: Floats, other: Floats) -> Floats:
    """(2, 2, N) sums over the backgrounds of weight (K, N) times (one, 1) times (other, 1)."""
    first, second = one.T[0], other.T[0]
    return np.array(
        [
            [(first * second) @ weight, first @ weight],
            [second @ weight, weight.sum(axis=0)],
        ]
    )


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


def _product(left: Floats, right: Floats) -> Floats:
    return np.asarray(np.einsum("ikn,kjn->ijn", left, right))


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
        radiance, one = (c_inj - c_ref) / depth, np.ones_like(g)
        gradient = np.stack([-radiance, -one, radiance, one], axis=1) / depth[:, None]
        return np.asarray(gradient)


def shot_scatter(
    change: Floats,
    observed: Floats,
    *,
    camera: Floats,
    degrees: Floats,
    shape: tuple[int, ...],
) -> Floats:
    """Variance (K, ...) of one injection beyond the camera's noise, due to differences of shots.

    Shots differ in the amount of spray, which changes its signal least where it is opaque, and in
    its temperature, which adds the same signal at every background. The variance of one shot at
    background k is therefore

        camera_k + q change_k^2 + p

    and q, p are found from the variances observed among the shots of each background by iterated
    least squares (a sample variance has the variance 2 V^2 / degrees), over neighbours with the
    weight of their mean V: a pixel whose V is too small by chance would count most. Two numbers per
    pixel instead of one per background combine the degrees of freedom. Both are below 0 where
    the shots agree better than the camera's noise lets expect: without such pixels the mean
    variance would be too large. At least half of the camera's part is left.

    All arrays are (K, ...): change of the signal by a relative change of the amount, sample
    variance of one shot, the camera's part of it, and degrees of freedom of the sample variance; 0
    excludes a background.
    """

    def nearby(values: Floats) -> Floats:
        """Mean over the neighbourhood of each pixel."""
        return np.asarray(uniform_filter(values.reshape(shape), _NEARBY).reshape(values.shape))

    square = change**2
    scaled = square / max(float(square.max(initial=0.0)), np.finfo(float).tiny)
    extra = np.zeros_like(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(4):
            weight = degrees / np.array([nearby(one) for one in camera + extra]) ** 2
            weight = np.where(np.isfinite(weight), weight, 0.0)
            aa, ab, bb = (nearby(np.sum(weight * scaled**n, axis=0)) for n in (2, 1, 0))
            excess = weight * (observed - camera)
            ae, be = nearby(np.sum(excess * scaled, axis=0)), nearby(np.sum(excess, axis=0))
            both = aa * bb - ab**2
            q, p = (ae * bb - be * ab) / both, (be * aa - ae * ab) / both
            alone = ~(both > _ALIKE * aa * bb)  # changes of one size do not tell the two apart
            q, p = np.where(alone, 0.0, q), np.where(alone, be / bb, p)
            extra = np.nan_to_num(np.maximum(q * scaled + p, -_LEAST_CAMERA * camera))
    return extra
