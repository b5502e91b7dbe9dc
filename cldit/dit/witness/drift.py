"""Errors common to all pixels at one background: black body, offset or gain of the camera.

An error z_k at background k changes references and injections of a pixel by

    black body  g z, s z        offset  z, z        gain  I_ref z, I_inj z

A steady drift has a course over the backgrounds with a few unknowns (`cldit.dit.witness.trend`). If
references without that course deviate from their line, the residuals of both kinds about their
lines are fitted by each of these causes, and by a camera that is not linear (signal^2, one number
for all backgrounds), over all blocks. All with nearly the smallest remainder widen the errors.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from cldit.arrays import Floats
from cldit.dit.chance import ALONE, sure
from cldit.dit.solve import KINDS, Cause, Drift
from cldit.dit.witness.backgrounds import OffLine, references, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.trend import Trends, steady, unit, without

_DETERMINED = 1e-4  # of the best determined direction: less is undetermined
_SAME = 1e-12  # variance of parts of Delta I if all shots are equal
_ALIKE = 1.3  # ratio of remainders up to which causes are not distinguished
_BENT = 2.0  # the same for the curvature, since no camera bends by signal^2 exactly


def find(
    evidence: Evidence, off: OffLine | None, *, stated_K: Floats
) -> tuple[tuple[Drift, ...], str, bool]:
    """Common errors of an acquisition.

    off: deviations of the references; None with two backgrounds. stated_K: (K,) standard deviation
    of each background, stated by the user. Returns the drifts for the fit, their cause in words
    (empty if references are on their line), and True if a drift continues through breaks.
    """
    beyond = off is not None and _beyond(evidence, off)
    trends = steady(evidence, beyond=beyond)
    through = False
    if evidence.breaks:
        unbroken = evidence.through()
        going_on = steady(unbroken, beyond=beyond, steps=False)
        remaining = references(without(unbroken, going_on), stated_K=stated_K)[1]
        through = remaining is None or (bool(going_on) and not _beyond(unbroken, remaining))
        if through:
            evidence, trends = unbroken, going_on
    cause: Cause = _largest(evidence, trends)
    message = _said([cause]) if beyond else ""
    alike: dict[Cause, Floats] = {}
    if beyond:
        rest = without(evidence, trends, fitted=True)
        remaining = references(rest, stated_K=stated_K)[1]
        if remaining is not None and _beyond(rest, remaining):
            alike = _causes(rest)
            cause = next(iter(alike))
            message = _said(alike)
    scatter, jitter = _wander(evidence, cause, trends)
    drifts = {of: trends.get(of, Drift(cause=of)) for of in (cause, *trends, *alike)}
    drifts[cause] = replace(drifts[cause], scatter=scatter, jitter=jitter)
    count = max(len(drift.modes) for drift in drifts.values())
    for of, variance in alike.items():
        if of == "curvature":  # one number of its own for all backgrounds
            modes = np.zeros((count + 1, len(variance)))
            modes[count] = np.sqrt(variance)
            drifts[of] = replace(drifts[of], modes=modes)
        else:
            drifts[of] = replace(drifts[of], variance=variance)
    return tuple(drifts.values()), message, through


def _beyond(evidence: Evidence, off: OffLine) -> bool:
    return off.beyond(sure(evidence.degrees("reference")))


def _largest(evidence: Evidence, trends: Trends) -> Cause:
    """The cause of the largest course; the offset without any."""
    size = {
        cause: float(np.max(np.abs(trend.course * unit(evidence, cause))))
        for cause, trend in trends.items()
    }
    return max(size, key=lambda cause: size[cause], default="offset")


_SAYS: dict[Cause, str] = {
    "black body": "the black body were at another temperature",
    "offset": "the camera's offset changed, which cancels in injection minus reference",
    "gain": "the camera's gain changed",
    "curvature": "the camera were not linear",
}


def _said(causes: Iterable[Cause]) -> str:
    phrases = [_SAYS[cause] for cause in causes]
    return f"as if {' or '.join(phrases)}" + (": these fit alike" if len(phrases) > 1 else "")


def _factors(evidence: Evidence) -> dict[Cause, dict[str, Floats]]:
    """Factors (K, B) by cause and kind, in units of similar size at each background."""
    ones = np.ones((len(evidence.setpoints), evidence.blocks))
    rise = evidence.rise[:, None] * ones
    through = {"reference": ones, "injection": slopes(evidence) * ones}
    line = {kind: _on_line(evidence, kind) for kind in KINDS}
    return {
        "offset": {kind: ones for kind in KINDS},
        "black body": {kind: through[kind] * rise for kind in KINDS},
        "gain": line,
        "curvature": {kind: signal**2 for kind, signal in line.items()},
    }


def _on_line(evidence: Evidence, kind: str) -> Floats:
    """Signals (K, B) of a kind on each block's line."""
    x = evidence.source[kind]
    design = np.stack([x / x.max(), np.ones_like(x)], axis=1)
    return np.asarray(design @ np.linalg.pinv(design) @ evidence.mean(kind))


def _causes(evidence: Evidence) -> dict[Cause, Floats]:
    """The causes that fit alike, the likeliest first, and their variances (K,): radiance^2, of
    gain and curvature relative."""
    fits = {
        cause: _fitted(evidence, factors, fixed=cause == "curvature")
        for cause, factors in _factors(evidence).items()
    }
    # A lone deviation suggests another temperature, several another offset. Scatter of the spray is
    # correlated between blocks, so a small difference is no proof.
    lone = np.count_nonzero(fits["black body"][1]) == 1
    likely: Cause = "black body" if lone else "offset"
    best = min(fits, key=lambda cause: fits[cause][0])
    best = likely if fits[likely][0] < _ALIKE * fits[best][0] else best
    alike = [best] + [cause for cause in fits if cause != best]
    smallest = min(remainder for remainder, _ in fits.values())
    return {
        cause: fits[cause][1] * (evidence.rise**2 if cause == "black body" else 1.0)
        for cause in alike
        if cause == best or fits[cause][0] < (_BENT if cause == "curvature" else _ALIKE) * smallest
    }


def _fitted(evidence: Evidence, factors: dict[str, Floats], *, fixed: bool) -> tuple[float, Floats]:
    """Remaining chi2 with common errors of these `factors` (K, B) by kind, and variance (K,).
    With `single` the error is one number for all backgrounds.

    In addition each background may have another amount of spray: an unknown part of Delta I, with
    the variance between shots as its prior.
    """
    unit = float(np.max(evidence.source["reference"]))
    count = len(evidence.setpoints)
    block_variance, amount_variance = evidence.scatter()
    variance = {
        "reference": evidence.camera["reference"] / evidence.number("reference")[:, None],
        "injection": block_variance,
    }
    size = max(float(np.max(np.abs(factor))) for factor in factors.values())
    normal, right, total = np.zeros((2 * count, 2 * count)), np.zeros(2 * count), 0.0
    delta = (_on_line(evidence, "injection") - _on_line(evidence, "reference")) / unit
    for kind in KINDS:
        signal = evidence.mean(kind) / unit
        weight = _about_lines(evidence.source[kind] / unit, variance[kind] / unit**2)
        off = np.einsum("bkl,lb->bk", weight, signal)
        total += float(np.einsum("kb,bk->", signal, off))
        columns = [factors[kind] / size, delta if kind == "injection" else np.zeros_like(delta)]
        for i, column in enumerate(columns):
            right[i * count : (i + 1) * count] += np.einsum("kb,bk->k", column, off)
            for j, partner in enumerate(columns):
                normal[i * count : (i + 1) * count, j * count : (j + 1) * count] += np.einsum(
                    "kb,bkl,lb->kl", column, weight, partner
                )
    prior = evidence.number("injection") / max(amount_variance, _SAME)
    normal[count:, count:] += np.diag(prior)
    # The amounts of spray are eliminated.
    z, y = slice(count), slice(count, None)
    back = np.linalg.solve(normal[y, y], np.column_stack([normal[y, z], right[y]]))
    kept = normal[z, z] - normal[z, y] @ back[:, :count]
    side = right[z] - normal[z, y] @ back[:, count]
    if fixed:
        single_z = float(side.sum() / kept.sum())
        remainder = total - float(right[y] @ back[:, count]) - single_z * float(side.sum())
        return remainder, np.full(count, (single_z * unit / size) ** 2)
    # Lines absorb some directions of the errors: the smallest solution is taken.
    amount = np.linalg.pinv(kept, rcond=_DETERMINED, hermitian=True) @ side
    rank = int(np.linalg.matrix_rank(kept, tol=_DETERMINED * np.max(np.diag(kept)), hermitian=True))
    gained = float(side @ amount)
    scale = unit / size
    separate_gains = side**2 / np.diag(kept)
    strongest = int(np.argmax(separate_gains))
    if count >= 4 and gained - separate_gains[strongest] < ALONE * gained:
        alone_z = np.zeros(count)
        alone_z[strongest] = side[strongest] / kept[strongest, strongest] * scale
        size2 = alone_z**2
    else:
        size2 = np.full(count, float(amount @ amount) / max(rank, 1) * scale**2)
    return total - float(right[y] @ back[:, count]) - gained, size2


def _about_lines(x: Floats, variance: Floats) -> Floats:
    """Inverse covariance (B, K, K) of residuals about each block's line over `x` (K,)."""
    weight = 1.0 / variance.T
    design = np.stack([x, np.ones_like(x)], axis=1)
    half = weight[:, :, None] * design
    inner = np.linalg.pinv(np.einsum("bki,kj->bij", half, design), hermitian=True)
    diagonal = np.eye(len(x)) * weight[:, :, None]
    return np.asarray(diagonal - np.einsum("bki,bij,blj->bkl", half, inner, half))


def _wander(evidence: Evidence, cause: Cause, trends: Trends) -> tuple[Floats, Floats]:
    """Variances (K,) of one exposure in units of the cause: total, and between successive ones.

    Both are beyond camera noise and steady drift, from the references' mean over all blocks; slow
    changes are part of the first only.
    """
    all_blocks = np.ones(evidence.blocks, bool)
    noise = evidence.camera["reference"].mean(axis=1) / evidence.blocks
    rate = sum(
        (trend.rate * unit(evidence, of) for of, trend in trends.items()),
        np.zeros(len(evidence.setpoints)),
    )
    series = [
        values - slope * (places.at - places.at.mean())
        for values, slope, places in zip(
            evidence.series("reference", all_blocks),
            rate,
            evidence.places["reference"],
            strict=True,
        )
    ]
    total = np.array([np.var(values, ddof=1) if len(values) > 1 else 0.0 for values in series])
    moved = unit(evidence, cause)
    scatter, jitter = (
        np.maximum(variance - noise, 0.0) / moved**2
        for variance in (total, evidence.jitter("reference", all_blocks))
    )
    return scatter, np.minimum(jitter, scatter)
