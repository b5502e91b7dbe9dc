"""Errors of single pixels: a pattern of offsets or gains that changed, an image that moved.

A non-uniformity correction that is renewed gives every pixel another offset and gain. Images are
therefore compared without their smooth part (fourth differences):

- between backgrounds, by the residuals about the lines of each pixel. Their second moments, in
  blocks, are explained by variances of references, injections, common offsets and common gains at
  each background (non-negative least squares), which enter the covariance of the fit;
- between the kinds, where there is the least spray. No spray explains a difference that remains at
  every radiance between 0 and that of the warmest part of the surroundings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.optimize import nnls

from cldit.arrays import Floats, Mask
from cldit.dit import hypotheses
from cldit.dit.chance import DEVIATIONS, clipped
from cldit.dit.shots import THUMBNAIL
from cldit.dit.solve import KINDS
from cldit.dit.witness.finding import Witness
from cldit.dit.witness.patterns import Patterns

_EDGE = 6  # pixels along a block, at least: 36 give a variance to 24 %
_MORE = 0.1  # excess of the variance: errors are 5 % larger
_PART = 0.02  # share of the blocks that is worth a warning
_LONE = 0.5  # of the unexplained squares, for one background alone
_CLIP = 4.0  # standard deviations: one of 16,000 normal pixels is clipped
_WIDE = 2.5  # standard deviations from which errors are widened without a warning
_SPREAD = 0.3  # of the warmest radiance: spread of the temperatures of thin sprays
_RADIANCES = np.linspace(0.0, 1.0, 9)


@dataclass(frozen=True)
class _Blocks:
    """Blocks of an image. number: (h, w) of the block of each pixel; counts: (B,) pixels that
    see the background."""

    number: NDArray[np.intp]
    sees: Mask
    counts: Floats

    @classmethod
    def of(cls, sees: Mask) -> "_Blocks":
        parts = [max(1, min(THUMBNAIL, n // _EDGE)) for n in sees.shape]
        rows, columns = (
            np.arange(n) * part // n for n, part in zip(sees.shape, parts, strict=True)
        )
        number = rows[:, None] * parts[1] + columns
        count = np.bincount(number[sees], minlength=parts[0] * parts[1])
        return cls(number, sees, count.astype(float))

    def mean(self, image: Floats) -> Floats:
        """(B,) means of an image (h, w) over the pixels that see the background."""
        total = np.bincount(self.number[self.sees], image[self.sees], minlength=len(self.counts))
        return np.asarray(total / np.maximum(self.counts, 1.0))


def between_backgrounds(
    patterns: Patterns, *, stated: Floats, names: Sequence[str]
) -> tuple[Witness | None, dict[str, Floats]]:
    """Witness of pixels off their lines, and variances (K, h, w) in counts^2 that explain them:
    of each kind, of a common `offset` and (relative) of a common `gain`. The fit has the variances
    `stated` (K,) of a common error already."""
    count = len(patterns.source)
    spare = count - 2
    blocks = _Blocks.of(patterns.sees)
    filled = blocks.counts >= _EDGE
    if spare < 1 or not filled.any():
        return None, {}
    usual = np.sqrt(np.median(patterns.noise["reference"][:, patterns.sees], axis=1))
    if not np.all(usual > 0.0):  # a simulation without noise
        return None, {}
    # Residuals of whitened signals, in an orthonormal basis
    basis = np.linalg.svd(patterns.design / usual[:, None])[0][:, 2:].T / usual  # (spare, K)
    level = {kind: np.array([blocks.mean(v) for v in patterns.mean[kind]]) for kind in KINDS}
    contrast = {kind: (patterns.source - patterns.source.mean()) @ level[kind] for kind in KINDS}
    through = contrast["injection"] / np.where(filled, contrast["reference"], 1.0)
    added = {"reference": stated[:, None], "injection": stated[:, None] * through**2}
    moments, expected = _moments(patterns, blocks, basis, added)
    excess = sum(np.einsum("iib->b", moments[kind, kind]) for kind in KINDS)
    ratio = np.where(filled, excess / np.where(filled, expected, 1.0), 0.0)
    # The noise of a kind's moments, and that pixels share neighbours
    doubt = np.sqrt(3.0 / (spare * np.maximum(blocks.counts, 1.0)))
    overall = float(np.average(ratio, weights=blocks.counts))
    everywhere = overall > max(_MORE, DEVIATIONS * np.sqrt(3.0 / (spare * blocks.counts.sum())))
    wide = filled & ((ratio > 0.0) if everywhere else (ratio > DEVIATIONS * doubt))
    if not wide.any():
        return None, {}
    parts = _explained(
        basis,
        {pair: moment[:, :, wide] for pair, moment in moments.items()},
        {kind: level[kind][:, wide] for kind in KINDS},
    )
    variances = {name: np.zeros((count, len(blocks.counts))) for name in parts}
    for name, values in parts.items():
        variances[name][:, wide] = values
    share = float(blocks.counts[wide].sum() / blocks.counts.sum())
    witness = None
    if everywhere or share > _PART:
        factor = 1.0 + (overall if everywhere else float(np.median(ratio[wide])))
        deviating = patterns.sees & wide[blocks.number]
        causes = hypotheses.between_backgrounds(patterns, deviating, names)
        witness = Witness(
            name="pixels",
            says=f"in {100.0 * share:.0f} % of the image the pixels lie off their lines by "
            f"{np.sqrt(factor):.2g} times their noise: {causes}; errors are widened",
            stands_out=True,
        )
    return witness, {name: values[:, blocks.number] for name, values in variances.items()}


def _moments(
    patterns: Patterns, blocks: _Blocks, basis: Floats, added: Mapping[str, Floats]
) -> tuple[dict[tuple[str, str], Floats], Floats]:
    """Second moments (J, J, B) of the residuals by pairs of kinds, beyond the noise with variances
    `added` (K, B) to it, and the traces (B,) of the noise; `basis` (J, K) gives the residuals."""
    rest = {kind: np.einsum("jk,khw->jhw", basis, patterns.high[kind]) for kind in KINDS}
    noise = {
        kind: np.array([blocks.mean(v) for v in patterns.noise[kind]]) + added[kind]
        for kind in KINDS
    }
    moments: dict[tuple[str, str], Floats] = {}
    for kind_a, kind_b in ((KINDS[0], KINDS[0]), (KINDS[1], KINDS[1]), KINDS):
        moment = np.array([[blocks.mean(a * b) for b in rest[kind_b]] for a in rest[kind_a]])
        if kind_a == kind_b:
            moment -= np.einsum("ik,kb,jk->ijb", basis, noise[kind_a], basis)
        moments[kind_a, kind_b] = moment
    expected = [np.einsum("ik,kb,ik->b", basis, noise[kind], basis) for kind in KINDS]
    return moments, expected[0] + expected[1]


def _explained(
    basis: Floats, moments: Mapping[tuple[str, str], Floats], levels: Mapping[str, Floats]
) -> dict[str, Floats]:
    """Variances (K, B) of the kinds, of common offsets and common gains that explain the moments of
    the residuals of each block: the same at all backgrounds, unless one alone explains them better.
    """
    count = basis.shape[1]
    upper = np.triu_indices(len(basis))
    targets = np.concatenate(
        [
            moment.reshape(-1, moment.shape[2]) if kind_a != kind_b else moment[upper]
            for (kind_a, kind_b), moment in moments.items()
        ]
    ).T

    def solved(backgrounds: Sequence[int]) -> tuple[Floats, float]:
        part = basis[:, backgrounds]
        amount, total = np.zeros((4, len(targets))), 0.0
        for block, moment in enumerate(targets):
            r, i = (levels[kind][backgrounds, block] for kind in KINDS)
            ones, zero = np.ones_like(r), np.zeros_like(r)
            columns = []
            for a, b in ((ones, zero), (zero, ones), (ones, ones), (r, i)):
                rr, ii, ri = ((part * weight) @ part.T for weight in (a * a, b * b, a * b))
                columns.append(np.concatenate([rr[upper], ii[upper], ri.ravel()]))
            matrix = np.array(columns).T
            size = np.sqrt(np.sum(matrix**2, axis=0))
            solution, rest = nnls(matrix / size, moment)
            amount[:, block] = solution / size
            total += rest**2
        return amount, total

    pooled, pooled_rest = solved(range(count))
    variances = np.repeat(pooled[:, None], count, axis=1)
    singles = [solved([k]) for k in range(count)]
    best = int(np.argmin([rest for _, rest in singles]))
    if len(basis) == 1:  # three backgrounds do not show which of them it is
        variances = np.stack([solution for solution, _ in singles], axis=1)
    elif singles[best][1] < _LONE * pooled_rest:
        variances = np.zeros_like(variances)
        variances[:, best] = singles[best][0]
    return dict(zip((*KINDS, "offset", "gain"), variances, strict=True))


def between_kinds(
    patterns: Patterns,
    *,
    clear: Mask,
    half: Mask,
    wide: Mask,
    thin: float,
    warmest: float,
    rise_counts: Floats,
) -> tuple[Witness | None, float, float]:
    """Compares the patterns of injections and references in the pixels with the least spray.

    Returns the witness, and the standard deviations between the kinds: of the pixels' offsets
    [counts], and of their gains.

    Args:
        clear: (h, w) pixels with the least spray. thin: their mean emissivity. half: half of them,
            with less spray than the others. wide: clear pixels, and all with thin spray.
        warmest: radiance of the warmest part of the surroundings, over the largest source.
        rise_counts: (K,) counts per kelvin of the black body.
    """
    thin_around = patterns.sees & binary_erosion(wide, iterations=2, border_value=1)
    lines = [_Difference.of(patterns, thin_around & mask) for mask in (wide, clear, half)]
    if lines[0] is None or lines[1] is None or lines[2] is None:
        return None, 0.0, 0.0
    found_at = [(*lines[0].beyond(x, 1.0), x) for x in warmest * _RADIANCES]
    offset2, doubt, at = min(found_at)
    # Patterns of a camera are the same in all pixels; what is more in thin spray is of the spray.
    offset2 = min(offset2, *(sum(line.beyond(at, 1.0)) for line in lines[1:] if line))
    slopes2, slopes_doubt = min(line.beyond(1.0, 0.0) for line in lines[1:] if line)
    spray2 = max(slopes2 + 2.0 * slopes_doubt, 0.0)
    gain = lines[1].gain
    offset_counts, renewed_gain, messages, sure = 0.0, 0.0, [], 0.0
    if offset2 > _WIDE * doubt and offset2 > spray2 * (_SPREAD * warmest) ** 2:
        offset_counts = float(np.sqrt(offset2))
        kelvin = offset_counts / float(np.median(rise_counts))
        messages.append(f"offsets by {offset_counts:.2g} counts ({kelvin:.2g} K)")
        sure = offset2 / doubt
    if slopes2 > _WIDE * slopes_doubt and slopes2 > (2.0 * thin * gain) ** 2:
        renewed_gain = float(np.sqrt(slopes2)) / gain
        messages.append(f"gains by {100.0 * renewed_gain:.2g} %")
        sure = max(sure, slopes2 / slopes_doubt)
    if sure < DEVIATIONS:
        return None, offset_counts, renewed_gain
    causes = hypotheses.between_kinds(
        patterns, thin_around, offsets=offset_counts > 0.0, gains=renewed_gain > 0.0
    )
    witness = Witness(
        name="pixels",
        compared="pixels of injections against those of references, with the least spray",
        says=f"{' and '.join(messages)} from pixel to pixel: {causes}; errors are widened",
        stands_out=True,
    )
    return witness, offset_counts, renewed_gain


@dataclass(frozen=True)
class _Difference:
    """Line over the radiance of injections minus references of N pixels, without smooth parts.

    to_line: (2, K) slope and start from the signals. change: (K, N) signals. noise: (K,) variance.
    gain: slope of the references.
    """

    to_line: Floats
    change: Floats
    noise: Floats
    gain: float

    @classmethod
    def of(cls, patterns: Patterns, chosen: Mask) -> "_Difference | None":
        """The difference in `selected` pixels (h, w); None where they are few or without noise."""
        if np.count_nonzero(chosen) < 8 * _EDGE:
            return None
        change = patterns.high["injection"][:, chosen] - patterns.high["reference"][:, chosen]
        noise = patterns.noise["reference"][:, chosen] + patterns.noise["injection"][:, chosen]
        usual = np.sqrt(np.median(noise, axis=1))
        if not np.all(usual > 0.0):
            return None
        to_line = np.linalg.pinv(patterns.design / usual[:, None]) / usual
        gain = float(np.mean(to_line[0] @ patterns.mean["reference"][:, chosen]))
        return cls(to_line, change, noise.mean(axis=1), gain)

    def beyond(self, slope: float, start: float) -> tuple[float, float]:
        """Variance beyond the noise of so much of the slope and of the start, and its error."""
        weight = slope * self.to_line[0] + start * self.to_line[1]
        noise = float(weight**2 @ self.noise)
        doubt = 2.0 / np.sqrt(self.change.shape[1]) * noise
        return _variance(weight @ self.change) - noise, float(doubt)


def _variance(values: Floats) -> float:
    """Variance of values whose tails are clipped, since a few odd pixels shall not change it."""
    return float(np.mean(clipped(values - np.median(values), _CLIP) ** 2))
