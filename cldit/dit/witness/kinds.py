"""Injections against references in the blocks with the least spray.

There they differ only by e (b - x), for a thin spray of emissivity e and own radiance b and a
background of radiance x. The own radiance is between 0 and that of the warmest part of the
surroundings. A difference that no mixture of such sprays explains is due to the camera's offset, or
to a black body that drifted between the two kinds.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from cldit.arrays import Floats, Mask
from cldit.dit.solve import KINDS, Systematic
from cldit.dit.witness.backgrounds import CHOSEN, FLOOR_K, clearest, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import LIMIT_K, WORTH_K, Witness, sure

_DENSE = 0.3  # share of the blocks, those with the most spray, that give its temperature
_EXPLAINED = 0.1  # largest remaining share of the squares for a cause that explains them
_MORE = 0.05  # of the background's contrast
_LEAST = 0.02  # least emissivity of a block that gives the temperature of its spray


def kinds(evidence: Evidence) -> tuple[Witness, Systematic]:
    """Compares injections with references in the blocks with the least spray.

    Returns the witness, and its contribution to the errors.
    """
    chosen = clearest(evidence)
    gain = float(np.mean(evidence.gains("reference")[chosen]))
    gain = gain if gain > 0.0 else 1.0
    # Blocks are chosen by one half of the shots and compared in the other: otherwise those that are
    # brighter by noise would be chosen.
    halves = evidence.halves()
    camera = evidence.camera["reference"] + evidence.camera["injection"]
    blocks = 0.0 if halves else CHOSEN * camera[:, chosen].mean(axis=1)
    pairs = (halves, halves[::-1]) if halves else ((evidence, evidence),)
    difference = np.mean([_difference(seen, clearest(by)) for by, seen in pairs], axis=0)
    # Different readings of the background with either kind are part of the difference.
    apart = evidence.source["injection"] - evidence.source["reference"]
    seen = difference / gain - apart
    variance = sum(evidence.variance(kind, chosen) for kind in KINDS) + blocks
    noise = np.sqrt(variance / gain**2 + (FLOOR_K * evidence.rise) ** 2)
    x = evidence.source["reference"]
    unexplained = _beyond_spray(seen, x=x, noise=noise, warmest=evidence.warmest)
    degrees = evidence.degrees("reference") + evidence.degrees("injection")
    beyond = bool(np.any(np.abs(unexplained) > sure(degrees) * noise))
    causes = _causes(seen, x, evidence, noise)
    best = min(causes, key=lambda one: one.left)
    shown_K = (best.beside if beyond else unexplained) / evidence.rise
    noise_K = noise / evidence.rise
    worst_K = float(np.max(np.abs(shown_K)))
    stands_out = beyond and worst_K > WORTH_K
    says = ""
    if stands_out:
        if best.left > _EXPLAINED * float(np.sum((best.beside / noise) ** 2)):
            says = "explained neither by the camera's offset nor by the black body alone"
        elif best.column == "offset":
            says = "as if the camera's offset changed between the kinds"
        else:
            says = f"as if the black body differed by {best.size:+.2f} K between the kinds"
        says += ", or there is spray in the whole image"
        slope = slopes(evidence)
        if np.count_nonzero(slope > 1.0 + _MORE) > np.count_nonzero(slope < 1.0 - _MORE):
            says += "; injections show more of the background: are the two kinds swapped?"
    systematic = Systematic()
    if beyond:
        slope, start = np.polyfit(x / x.max(), evidence.rise, 1)
        by_offset = best.column == "offset"
        systematic = Systematic(
            offset=best.size * gain if by_offset else 0.0,
            kelvin=0.0 if by_offset else best.size,
            slope=float(slope / x.max()),
            start=float(start),
        )
    witness = Witness(
        name="kinds",
        compared="injections against references in the pixels with the least spray",
        says=says,
        setpoints=evidence.setpoints,
        kelvin=tuple(shown_K.tolist()),
        noise_K=tuple(noise_K.tolist()),
        stands_out=stands_out,
        severe=beyond and float(np.median(np.abs(shown_K))) > LIMIT_K,
    )
    return witness, systematic


def _difference(evidence: Evidence, chosen: Mask) -> Floats:
    """Injections minus references (K,) in the `chosen` blocks (B,)."""
    found = evidence.mean("injection") - evidence.mean("reference")
    return np.asarray(found[:, chosen].mean(axis=1))


def _beyond_spray(seen: Floats, *, x: Floats, noise: Floats, warmest: float) -> Floats:
    """Part (K,) of `seen` that no mixture of sprays explains, at backgrounds of radiance `x`."""
    coldest = np.zeros_like(x)
    design = np.stack([coldest - x, max(warmest, float(x.max())) - x], axis=1)
    share, _ = nnls(design / noise[:, None], seen / noise)
    return np.asarray(seen - design @ share)


@dataclass(frozen=True)
class _Cause:
    """A possible cause. size: radiance of an offset, or kelvin. beside: (K,) difference without
    the spray. left: unexplained squares, in units of the noise."""

    column: str
    size: float
    beside: Floats
    left: float


def _causes(seen: Floats, x: Floats, evidence: Evidence, noise: Floats) -> list[_Cause]:
    """Offset or kelvin that explain `seen`, together with a spray as warm as the dense one."""
    spray = _own(evidence, x) - x
    found: list[_Cause] = []
    for name, column in (("offset", np.ones_like(x)), ("black body", evidence.rise)):
        for sign in (1.0, -1.0):
            design = np.stack([sign * column, spray], axis=1) / noise[:, None]
            size = np.max(np.abs(design), axis=0)
            share, left = nnls(design / size, seen / noise)
            share = share / size
            found.append(
                _Cause(name, sign * float(share[0]), seen - spray * share[1], float(left**2))
            )
    return found


def _own(evidence: Evidence, x: Floats) -> float:
    """Radiance of the spray where it is densest, between 0 and the warmest."""
    slope = slopes(evidence)
    dense = (slope <= np.quantile(slope, _DENSE)) & (1.0 - slope > _LEAST)
    if not dense.any():
        return 0.5 * evidence.warmest
    difference = evidence.mean("injection")[:, dense] - evidence.mean("reference")[:, dense]
    fall, start = np.polyfit(x / x.max(), difference.mean(axis=1) / x.max(), 1)
    return float(np.clip(-start / fall * x.max(), 0.0, evidence.warmest)) if fall < 0.0 else 0.0
