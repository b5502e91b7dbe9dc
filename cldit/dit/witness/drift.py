"""What all pixels share before one background: black body, offset or gain of the camera.

Where references lie off their line, the pixels say why. An error z_k before background k moves
references and injections of a pixel by

    black body  g z, s z        offset  z, z        gain  I_ref z, I_inj z

What is left of both kinds about their lines is fitted by each of the three over all blocks, and
that which leaves the least is the cause. Where the spray tells nothing of it, it is the offset, of
which Delta I knows nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.dit.solve import Absorbed, Cause, Drift
from cldit.dit.witness.backgrounds import slopes
from cldit.dit.witness.evidence import KINDS, Evidence
from cldit.dit.witness.finding import sure
from cldit.dit.witness.lines import OffLine, squares

Floats = NDArray[np.float64]

_BETTER = 1.1  # ratio of what is left, from which a less likely cause is believed
_TOLD = 1e-4  # of the best determined direction: below it nothing is told
_LEFT = 0.5  # of what a gain does to the emissivity, where its variance is in the fit: measured
_SAME = 1e-12  # variance of parts of Delta I where all shots are alike
_LONE = 0.1  # share of what is explained, that one background alone may leave


@dataclass(frozen=True, kw_only=True)
class Found:
    """drifts: for the fit. absorbed: of a steady drift, what lines take for their own. cause: in
    words; empty where none stands out."""

    drifts: tuple[Drift, ...]
    absorbed: Absorbed
    cause: str


def find(evidence: Evidence, off: OffLine | None) -> Found:
    """The common errors of an acquisition.

    Args:
        evidence: of K backgrounds.
        off: of the references; None with two backgrounds.
    """
    steady = trend(evidence)
    beyond = off is not None and off.beyond(sure(evidence.degrees("reference")))
    none = np.zeros(len(evidence.setpoints))
    cause: Cause = "offset"
    variances: dict[Cause, Floats] = {"offset": none}
    if beyond:
        cause, variance = _cause(evidence, steady)
        variances = {cause: variance}
    way = steady.places - steady.places.mean()
    x = evidence.source["reference"]
    absorbed = Absorbed()
    if steady.offset:
        absorbed = Absorbed(offset=_line(x, steady.offset * way))
    if steady.gain and (len(x) == 2 or (beyond and _continues(evidence, steady, way))):
        # It is one vector over the backgrounds, not one number each: its whole square is the
        # variance that covers it whichever way the fit looks.
        whole = float(np.sum((steady.gain * way) ** 2))
        variances["gain"] = np.maximum(variances.get("gain", none), whole)
        absorbed = replace(absorbed, gain=_LEFT * _line(x, steady.gain * way)[0])
    each, jitter = _wander(evidence, cause)
    drifts = [
        Drift(
            cause=of,
            variance=variance,
            each=each if of == cause else none,
            jitter=jitter if of == cause else none,
        )
        for of, variance in variances.items()
    ]
    return Found(drifts=tuple(drifts), absorbed=absorbed, cause=_SAYS[cause] if beyond else "")


def _continues(evidence: Evidence, steady: Trend, way: Floats) -> bool:
    """Whether a gain that drifts goes on from one background to the next.

    A black body drifts as a gain does, but starts anew before each background: then references are
    nearer to their line without what such a gain would make of them.
    """
    x, y = evidence.source["reference"], evidence.mean("reference").mean(axis=1)
    still = y - steady.offset * way
    without, within = (
        squares(x, one, evidence.rise) for one in (still, still / (1.0 + steady.gain * way))
    )
    return within < without


def _line(x: Floats, values: Floats) -> tuple[float, float]:
    """Slope and start of the line through `values` (K,) over `x` (K,)."""
    slope, start = np.polyfit(x / x.max(), values, 1)
    return float(slope / x.max()), float(start)


@dataclass(frozen=True, kw_only=True)
class Trend:
    """How references change from shot to shot, the same way before all backgrounds.

    offset: radiance a shot; gain: relative, a shot; 0 where it may be chance. places: (K,) where
    the middle of the references lies among all shots. mostly_offset: it explains more than a gain.
    """

    offset: float
    gain: float
    places: Floats
    mostly_offset: bool


def trend(evidence: Evidence) -> Trend:
    """The steady change of the references' mean over all blocks: rate = offset + gain signal."""
    every = np.ones(evidence.blocks, bool)
    series = evidence.picture("reference", every)
    variance = evidence.variance("reference", every) * evidence.number("reference")
    rate, weight = np.zeros(len(series)), np.zeros(len(series))
    for k, (places, one) in enumerate(zip(evidence.numbers["reference"], series, strict=True)):
        away = places - places.mean()
        if len(one) > 2:
            rate[k] = away @ one / (away @ away)
            weight[k] = (away @ away) / variance[k]
    middle = np.array([places.mean() for places in evidence.numbers["reference"]])
    signal = np.array([one.mean() for one in series])
    unit = float(np.max(np.abs(signal)))
    design = np.stack([np.ones_like(rate), signal / unit], axis=1)
    both = np.linalg.pinv((design.T * weight) @ design, hermitian=True)
    best = both @ ((design.T * weight) @ (rate / unit))
    noise = np.sqrt(np.diag(both)) / unit
    found = np.where(np.abs(best) > sure(evidence.degrees("reference")) * noise, best, 0.0)
    alone = [_left(rate / unit, column, weight) for column in design.T]
    return Trend(
        offset=float(found[0]) * unit,
        gain=float(found[1]),
        places=middle,
        mostly_offset=alone[0] <= alone[1],
    )


def _left(values: Floats, column: Floats, weight: Floats) -> float:
    """Weighted squares of `values` (K,) that no multiple of `column` (K,) explains."""
    most = float(weight @ column**2)
    share = float(weight @ (values * column)) / most if most > 0.0 else 0.0
    return float(weight @ (values - share * column) ** 2)


_SAYS = {
    "black body": "as if the black body were at another temperature",
    "offset": "as if the camera's offset changed, which drops out of injection minus reference",
    "gain": "as if the camera's gain changed",
}


def _factors(evidence: Evidence) -> dict[Cause, dict[str, Floats]]:
    """(K, B) by cause and kind, in units that may well be as large before each background."""
    one = np.ones((len(evidence.setpoints), evidence.blocks))
    rise = evidence.rise[:, None] * one
    through = {"reference": one, "injection": slopes(evidence) * one}
    return {
        "offset": {kind: one for kind in KINDS},
        "black body": {kind: through[kind] * rise for kind in KINDS},
        "gain": {kind: _on_line(evidence, kind) for kind in KINDS},
    }


def _on_line(evidence: Evidence, kind: str) -> Floats:
    """(K, B) the signals of a kind on each block's line."""
    x = evidence.source[kind]
    design = np.stack([x / x.max(), np.ones_like(x)], axis=1)
    return np.asarray(design @ np.linalg.pinv(design) @ evidence.mean(kind))


def _cause(evidence: Evidence, steady: Trend) -> tuple[Cause, Floats]:
    """The cause, and its variance (K,): radiance^2, of the gain relative."""
    found = {cause: _fitted(evidence, factors) for cause, factors in _factors(evidence).items()}
    if steady.offset or steady.gain:  # says whether it is the offset, whatever the spray does
        blackbody = _BETTER * found["black body"][0] < found["gain"][0]
        best: Cause = "black body" if blackbody else "gain"
        best = "offset" if steady.mostly_offset else best
    else:
        # One background that is off has another temperature; all of them, another offset. How a
        # spray scatters is much alike in blocks that are near, so a little is no proof.
        lone = np.count_nonzero(found["black body"][1]) == 1
        likely: Cause = "black body" if lone else "offset"
        best = min(found, key=lambda cause: found[cause][0])
        best = likely if found[likely][0] < _BETTER * found[best][0] else best
    variance = found[best][1]
    return best, variance * evidence.rise**2 if best == "black body" else variance


def _fitted(evidence: Evidence, factors: dict[str, Floats]) -> tuple[float, Floats]:
    """What common errors of these `factors`, (K, B) by kind, leave of chi2; their variance (K,).

    Beside them, each background may have had more spray than another by as much as shots differ:
    an unknown part of Delta I, with the variance of such parts as its prior.
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
        for i, one in enumerate(columns):
            right[i * count : (i + 1) * count] += np.einsum("kb,bk->k", one, off)
            for j, other in enumerate(columns):
                normal[i * count : (i + 1) * count, j * count : (j + 1) * count] += np.einsum(
                    "kb,bkl,lb->kl", one, weight, other
                )
    prior = evidence.number("injection") / max(together, _SAME)
    normal[count:, count:] += np.diag(prior)
    # The amounts of spray are solved for and leave the common errors.
    z, y = slice(count), slice(count, None)
    back = np.linalg.solve(normal[y, y], np.column_stack([normal[y, z], right[y]]))
    kept = normal[z, z] - normal[z, y] @ back[:, :count]
    side = right[z] - normal[z, y] @ back[:, count]
    # Lines absorb some directions of the errors: the least ones that explain it are found.
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
    """(B, K, K) inverse covariance of what is left about each block's own line.

    Args:
        x: (K,).
        variance: (K, B) of the block's means.
    """
    weight = 1.0 / variance.T
    design = np.stack([x, np.ones_like(x)], axis=1)
    half = weight[:, :, None] * design
    inner = np.linalg.pinv(np.einsum("bki,kj->bij", half, design), hermitian=True)
    whole = np.eye(len(x)) * weight[:, :, None]
    return np.asarray(whole - np.einsum("bki,bij,blj->bkl", half, inner, half))


def _wander(evidence: Evidence, cause: Cause) -> tuple[Floats, Floats]:
    """(K,) variances of one exposure, in the units of the cause: in all, and from one to the next.

    Both beyond the camera's noise, from the references' mean over all blocks. A slow drift is in
    the first and not in the second (von Neumann's mean square of successive differences).
    """
    every = np.ones(evidence.blocks, bool)
    noise = evidence.camera["reference"].mean(axis=1) / evidence.blocks
    series = evidence.picture("reference", every)
    whole = np.array([np.var(one, ddof=1) if len(one) > 1 else 0.0 for one in series])
    factor = np.array([np.mean(one) for one in series]) if cause == "gain" else np.ones(len(series))
    each, jitter = (
        np.maximum(one - noise, 0.0) / factor**2
        for one in (whole, evidence.jitter("reference", every))
    )
    return each, np.minimum(jitter, each)
