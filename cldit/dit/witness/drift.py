"""Errors common to all pixels at one background: black body, offset or gain of the camera.

An error z_k at background k changes references and injections of a pixel by

    black body  g z, s z        offset  z, z        gain  I_ref z, I_inj z

A steady drift has a course over the backgrounds with a few unknowns (`cldit.dit.witness.trend`). If
references without that course deviate from their line, the residuals of both kinds about their
lines are fitted by each of these causes, and by a camera that is not linear (signal^2, one number
for all backgrounds), over all blocks. All with nearly the smallest remainder widen the errors.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats
from cldit.dit.solve import KINDS, Cause, Drift
from cldit.dit.witness.backgrounds import references, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import sure
from cldit.dit.witness.lines import OffLine
from cldit.dit.witness.trend import Trends, steady, unit, without

_BETTER = 1.1  # ratio of remainders from which a less likely cause is accepted
_TOLD = 1e-4  # of the best determined direction: less is undetermined
_SAME = 1e-12  # variance of parts of Delta I if all shots are equal
_ALIKE = 1.3  # ratio of remainders up to which causes are not distinguished
_BENT = 2.0  # the same for the curvature, since no camera bends by signal^2 exactly
_LONE = 0.1  # share of the explained squares that one background alone may leave


@dataclass(frozen=True, kw_only=True)
class Found:
    """Drifts for the fit. cause: in words; empty if references are on their line. through: True if
    a drift continues through breaks."""

    drifts: tuple[Drift, ...]
    cause: str
    through: bool = False


def find(evidence: Evidence, off: OffLine | None, *, stated_K: Floats) -> Found:
    """Common errors of an acquisition.

    off: deviations of the references; None with two backgrounds. stated_K: (K,) standard deviation
    of each background, stated by the user.
    """
    none = np.zeros(len(evidence.setpoints))
    beyond = off is not None and _beyond(evidence, off)
    trends = steady(evidence, beyond=beyond)
    through = False
    if evidence.breaks:
        whole = evidence.through()
        going_on = steady(whole, beyond=beyond, steps=False)
        left = references(without(whole, going_on), stated_K=stated_K)[1]
        through = left is None or (bool(going_on) and not _beyond(whole, left))
        if through:
            evidence, trends = whole, going_on
    cause: Cause = _largest(evidence, trends)
    says = _said([cause]) if beyond else ""
    alike: dict[Cause, Floats] = {}
    variance = none
    if beyond:
        rest = without(evidence, trends, fitted=True)
        left = references(rest, stated_K=stated_K)[1]
        if left is not None and _beyond(rest, left):
            alike = _causes(rest)
            cause = next(iter(alike))
            variance = alike[cause]
            says = _said(alike)
    each, jitter = _wander(evidence, cause, trends)
    drifts = {cause: replace(still(cause, len(none)), variance=variance, each=each, jitter=jitter)}
    for of, one in trends.items():
        known = drifts.get(of, still(of, len(none)))
        drifts[of] = replace(known, modes=one.modes, course=one.course, apart=one.apart)
    most = max(len(one.modes) for one in drifts.values())
    for of, variance in list(alike.items())[1:]:
        drifts[of] = replace(drifts.get(of, still(of, len(none))), variance=variance)
    if "curvature" in alike:  # one number of its own for all backgrounds
        own = np.zeros((most + 1, len(none)))
        own[most] = np.sqrt(alike["curvature"])
        drifts["curvature"] = replace(drifts["curvature"], variance=none, modes=own)
    return Found(drifts=tuple(drifts.values()), cause=says, through=through)


def still(cause: Cause, backgrounds: int) -> Drift:
    """Drift of this cause without any change, at so many backgrounds."""
    none = np.zeros(backgrounds)
    return Drift(
        cause=cause, variance=none, modes=none[None, :], course=none, each=none, jitter=none
    )


def _beyond(evidence: Evidence, off: OffLine) -> bool:
    return off.beyond(sure(evidence.degrees("reference")))


def _largest(evidence: Evidence, trends: Trends) -> Cause:
    """The cause of the largest course; the offset without any."""
    size = {
        cause: float(np.max(np.abs(one.course * unit(evidence, cause))))
        for cause, one in trends.items()
    }
    return max(size, key=lambda cause: size[cause], default="offset")


_SAYS: dict[Cause, str] = {
    "black body": "the black body were at another temperature",
    "offset": "the camera's offset changed, which cancels in injection minus reference",
    "gain": "the camera's gain changed",
    "curvature": "the camera were not linear",
}


def _said(causes: Iterable[Cause]) -> str:
    """Causes that fit alike, in words."""
    each = [_SAYS[cause] for cause in causes]
    return f"as if {' or '.join(each)}" + (": these fit alike" if len(each) > 1 else "")


def _factors(evidence: Evidence) -> dict[Cause, dict[str, Floats]]:
    """Factors (K, B) by cause and kind, in units of similar size at each background."""
    one = np.ones((len(evidence.setpoints), evidence.blocks))
    rise = evidence.rise[:, None] * one
    through = {"reference": one, "injection": slopes(evidence) * one}
    line = {kind: _on_line(evidence, kind) for kind in KINDS}
    return {
        "offset": {kind: one for kind in KINDS},
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
    found = {
        cause: _fitted(evidence, factors, one=cause == "curvature")
        for cause, factors in _factors(evidence).items()
    }
    # A lone deviation suggests another temperature, several another offset. Scatter of the spray is
    # correlated between blocks, so a small difference is no proof.
    lone = np.count_nonzero(found["black body"][1]) == 1
    likely: Cause = "black body" if lone else "offset"
    best = min(found, key=lambda cause: found[cause][0])
    best = likely if found[likely][0] < _BETTER * found[best][0] else best
    alike = [best] + [cause for cause in found if cause != best]
    least = min(left for left, _ in found.values())
    return {
        cause: found[cause][1] * (evidence.rise**2 if cause == "black body" else 1.0)
        for cause in alike
        if cause == best or found[cause][0] < (_BENT if cause == "curvature" else _ALIKE) * least
    }


def _fitted(evidence: Evidence, factors: dict[str, Floats], *, one: bool) -> tuple[float, Floats]:
    """Remaining chi2 with common errors of these `factors` (K, B) by kind, and variance (K,).
    With `one` the error is one number for all backgrounds.

    In addition each background may have another amount of spray: an unknown part of Delta I, with
    the variance between shots as its prior.
    """
    unit = float(np.max(evidence.source["reference"]))
    count = len(evidence.setpoints)
    alone, together = evidence.scatter()
    variance = {
        "reference": evidence.camera["reference"] / evidence.number("reference")[:, None],
        "injection": alone,
    }
    size = max(float(np.max(np.abs(one))) for one in factors.values())
    normal, right, total = np.zeros((2 * count, 2 * count)), np.zeros(2 * count), 0.0
    more = (_on_line(evidence, "injection") - _on_line(evidence, "reference")) / unit
    for kind in KINDS:
        signal = evidence.mean(kind) / unit
        weight = _about_lines(evidence.source[kind] / unit, variance[kind] / unit**2)
        off = np.einsum("bkl,lb->bk", weight, signal)
        total += float(np.einsum("kb,bk->", signal, off))
        columns = [factors[kind] / size, more if kind == "injection" else np.zeros_like(more)]
        for i, column in enumerate(columns):
            right[i * count : (i + 1) * count] += np.einsum("kb,bk->k", column, off)
            for j, other in enumerate(columns):
                normal[i * count : (i + 1) * count, j * count : (j + 1) * count] += np.einsum(
                    "kb,bkl,lb->kl", column, weight, other
                )
    prior = evidence.number("injection") / max(together, _SAME)
    normal[count:, count:] += np.diag(prior)
    # The amounts of spray are eliminated.
    z, y = slice(count), slice(count, None)
    back = np.linalg.solve(normal[y, y], np.column_stack([normal[y, z], right[y]]))
    kept = normal[z, z] - normal[z, y] @ back[:, :count]
    side = right[z] - normal[z, y] @ back[:, count]
    if one:
        single_z = float(side.sum() / kept.sum())
        left = total - float(right[y] @ back[:, count]) - single_z * float(side.sum())
        return left, np.full(count, (single_z * unit / size) ** 2)
    # Lines absorb some directions of the errors: the smallest solution is taken.
    amount = np.linalg.pinv(kept, rcond=_TOLD, hermitian=True) @ side
    told = int(np.linalg.matrix_rank(kept, tol=_TOLD * np.max(np.diag(kept)), hermitian=True))
    gained = float(side @ amount)
    scale = unit / size
    single = side**2 / np.diag(kept)
    first = int(np.argmax(single))
    if count >= 4 and gained - single[first] < _LONE * gained:
        alone_z = np.zeros(count)
        alone_z[first] = side[first] / kept[first, first] * scale
        size2 = alone_z**2
    else:
        size2 = np.full(count, float(amount @ amount) / max(told, 1) * scale**2)
    return total - float(right[y] @ back[:, count]) - gained, size2


def _about_lines(x: Floats, variance: Floats) -> Floats:
    """Inverse covariance (B, K, K) of residuals about each block's line over `x` (K,)."""
    weight = 1.0 / variance.T
    design = np.stack([x, np.ones_like(x)], axis=1)
    half = weight[:, :, None] * design
    inner = np.linalg.pinv(np.einsum("bki,kj->bij", half, design), hermitian=True)
    whole = np.eye(len(x)) * weight[:, :, None]
    return np.asarray(whole - np.einsum("bki,bij,blj->bkl", half, inner, half))


def _wander(evidence: Evidence, cause: Cause, trends: Trends) -> tuple[Floats, Floats]:
    """Variances (K,) of one exposure in units of the cause: total, and between successive ones.

    Both are beyond camera noise and steady drift, from the references' mean over all blocks; slow
    changes are part of the first only.
    """
    every = np.ones(evidence.blocks, bool)
    noise = evidence.camera["reference"].mean(axis=1) / evidence.blocks
    rate = sum(
        (one.rate * unit(evidence, of) for of, one in trends.items()),
        np.zeros(len(evidence.setpoints)),
    )
    series = [
        one - slope * (places.at - places.at.mean())
        for one, slope, places in zip(
            evidence.series("reference", every),
            rate,
            evidence.places["reference"],
            strict=True,
        )
    ]
    whole = np.array([np.var(one, ddof=1) if len(one) > 1 else 0.0 for one in series])
    moved = unit(evidence, cause)
    each, jitter = (
        np.maximum(one - noise, 0.0) / moved**2
        for one in (whole, evidence.jitter("reference", every))
    )
    return each, np.minimum(jitter, each)
