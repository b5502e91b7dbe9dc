"""What all pixels share before one background: black body, offset or gain of the camera.

Where references lie off their line, the pixels say why. An error z_k before background k moves
references and injections of a pixel by

    black body  g z, s z        offset  z, z        gain  I_ref z, I_inj z

What is left of both kinds about their lines is fitted by each of the three over all blocks, and
that which leaves the least is the cause. Where the spray tells nothing of it, it is the offset, of
which Delta I knows nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.dit.solve import Cause, Drift
from cldit.dit.witness.backgrounds import slopes
from cldit.dit.witness.evidence import KINDS, Evidence
from cldit.dit.witness.finding import sure
from cldit.dit.witness.lines import OffLine

Floats = NDArray[np.float64]

_BETTER = 1.1  # ratio of what is left, from which a cause is believed rather than the offset
_LONE = 0.1  # share of what is explained, that one background alone may leave


@dataclass(frozen=True, kw_only=True)
class Found:
    """drift: for the fit. cause: in words; empty where nothing stands out."""

    drift: Drift
    cause: str


def find(evidence: Evidence, off: OffLine | None) -> Found:
    """The common error of an acquisition.

    Args:
        evidence: of K backgrounds.
        off: of the references; None with two backgrounds.
    """
    none = np.zeros(len(evidence.setpoints))
    if off is None or not off.beyond(sure(evidence.degrees("reference"))):
        cause: Cause = "offset"
        variance, text = none, ""
    else:
        cause, variance = _cause(evidence)
        text = _SAYS[cause]
    each, jitter = _wander(evidence, cause)
    return Found(drift=Drift(cause=cause, variance=variance, each=each, jitter=jitter), cause=text)


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
        "gain": {kind: evidence.mean(kind) for kind in KINDS},
    }


def _cause(evidence: Evidence) -> tuple[Cause, Floats]:
    """The cause, and its variance (K,): radiance^2, of the gain relative."""
    left: dict[Cause, float] = {}
    found: dict[Cause, Floats] = {}
    unit = float(np.max(evidence.source["reference"]))
    for cause, factors in _factors(evidence).items():
        normal, right, total = 0.0, 0.0, 0.0
        size = max(float(np.max(np.abs(one))) for one in factors.values())
        for kind in KINDS:
            signal = evidence.mean(kind) / unit
            weight = _about_lines(evidence.source[kind] / unit, evidence.scatter(kind) / unit**2)
            factor = factors[kind] / size
            off = np.einsum("bkl,lb->bk", weight, signal)
            total += float(np.einsum("kb,bk->", signal, off))
            right = right + np.einsum("kb,bk->k", factor, off)
            normal = normal + np.einsum("kb,bkl,lb->kl", factor, weight, factor)
        # The least z that explains it: lines absorb two of its directions.
        z = np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right
        left[cause] = max(total - float(right @ z), 1e-300)
        alone = right**2 / np.diag(normal)
        first = int(np.argmax(alone))
        gained = float(right @ z)
        scale = unit / size
        if len(z) >= 4 and gained - alone[first] < _LONE * gained:
            amplitude = np.zeros(len(z))
            amplitude[first] = right[first] / normal[first, first] * scale
            found[cause] = amplitude**2
        else:
            found[cause] = np.full(len(z), float(z @ z) / max(len(z) - 2, 1) * scale**2)
    best = min(left, key=lambda one: left[one])
    if left["offset"] < _BETTER * left[best]:
        best = "offset"
    variance = found[best]
    return best, variance * evidence.rise**2 if best == "black body" else variance


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
    each = np.array([np.var(one, ddof=1) if len(one) > 1 else 0.0 for one in series])
    near = np.array([np.mean(np.diff(one) ** 2) / 2.0 if len(one) > 1 else 0.0 for one in series])
    factor = np.array([np.mean(one) for one in series]) if cause == "gain" else 1.0
    return tuple(np.maximum(one - noise, 0.0) / factor**2 for one in (each, near))  # type: ignore[return-value]
