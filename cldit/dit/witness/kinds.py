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
from cldit.dit.chance import sure
from cldit.dit.hypotheses import Hypothesis, describe, fitted
from cldit.dit.solve import KINDS, Systematic
from cldit.dit.witness.backgrounds import CHOSEN, CLEAREST, FLOOR_K, THIN, clearest, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import LIMIT_K, WORTH_K, Witness
from cldit.optics.visible import VISIBLE_EMISSIVITY

_THIN = 0.3  # largest emissivity of the pixels with the least spray, as a cause
_FREE = 0.005  # emissivity of the clearest pixels, up to which they are free of spray


def kinds(evidence: Evidence) -> tuple[Witness, Systematic]:
    """Compares injections with references in the blocks with the least spray.

    Returns the witness, and its contribution to the errors.
    """
    chosen = clearest(evidence)
    gain, seen, noise = _difference(evidence, chosen)
    x = evidence.source["reference"]
    unexplained = _beyond_spray(seen, x=x, noise=noise, warmest=evidence.warmest)
    degrees = evidence.degrees("reference") + evidence.degrees("injection")
    beyond = bool(np.any(np.abs(unexplained) > sure(degrees) * noise))
    signal = evidence.mean("reference")[:, chosen].mean(axis=1) / gain
    causes = _causes(seen, x, evidence, noise, signal)
    widening = [cause for cause in causes if cause.column in ("offset", "black body")]
    best = min(widening, key=lambda cause: cause.fit.score)
    shown_K = (best.beside if beyond else unexplained) / evidence.rise
    stands_out = beyond and float(np.max(np.abs(shown_K))) > WORTH_K
    message, likely = "", tuple[str, ...]()
    slope = slopes(evidence)
    if (thin := 1.0 - float(np.mean(slope[chosen]))) > _FREE:
        unseen = "so a fouled window, or a lower gain, is not seen"
        message = f"no pixel is free of spray (emissivity {thin:.3f}), {unseen}"
    if stands_out:
        none = nnls(((_own(evidence, x) - x) / noise)[:, None], seen / noise)[1] ** 2
        good = fitted([cause.fit for cause in causes], none=none, degrees=len(x))
        likely = tuple(cause.text for cause in good)
        message = (
            f"{describe(good, none=none, tried=len(causes))}, or there is spray in the whole image"
        )
        if np.count_nonzero(slope > 1.0 + VISIBLE_EMISSIVITY) > np.count_nonzero(
            slope < 1.0 - VISIBLE_EMISSIVITY
        ):
            message += "; injections show more of the background: are the two kinds swapped?"
    witness = Witness(
        name="kinds",
        compared="injections against references in the pixels with the least spray",
        says=message,
        causes=likely,
        setpoints=evidence.setpoints,
        kelvin=tuple(shown_K.tolist()),
        noise_K=tuple((noise / evidence.rise).tolist()),
        stands_out=stands_out,
        severe=beyond and float(np.median(np.abs(shown_K))) > LIMIT_K,
    )
    return witness, _systematic(evidence, best, gain=gain) if beyond else Systematic()


def _difference(evidence: Evidence, chosen: Mask) -> tuple[float, Floats, Floats]:
    """Gain of the `chosen` blocks (B,), and difference (K,) of injections from references in them
    in radiance of the background, with its standard error."""
    gain = float(np.mean(evidence.gains("reference")[chosen]))
    gain = gain if gain > 0.0 else 1.0
    # Blocks are chosen by one half of the shots and compared in the other: otherwise those that are
    # brighter by noise would be chosen.
    halves = evidence.halves()
    camera = evidence.camera["reference"] + evidence.camera["injection"]
    blocks = 0.0 if halves else CHOSEN * camera[:, chosen].mean(axis=1)
    pairs = (halves, halves[::-1]) if halves else ((evidence, evidence),)
    difference = np.mean([half.change[:, clearest(by)].mean(axis=1) for by, half in pairs], axis=0)
    # Different readings of the background with either kind are part of the difference.
    read_difference = evidence.source["injection"] - evidence.source["reference"]
    seen = difference / gain - read_difference
    variance = sum(evidence.variance(kind, chosen) for kind in KINDS) + blocks
    return gain, seen, np.sqrt(variance / gain**2 + (FLOOR_K * evidence.rise) ** 2)


def _systematic(evidence: Evidence, cause: "_Cause", *, gain: float) -> Systematic:
    """The error of an offset of the camera, or of the black body, of this size."""
    if cause.column == "offset":
        return Systematic(offset=cause.size * gain)
    x = evidence.source["reference"]
    steep, start = np.polyfit(x / x.max(), evidence.rise, 1)
    return Systematic(kelvin=cause.size, slope=float(steep / x.max()), start=float(start))


def _beyond_spray(seen: Floats, *, x: Floats, noise: Floats, warmest: float) -> Floats:
    """Part (K,) of `seen` that no mixture of sprays explains, at backgrounds of radiance `x`."""
    coldest = np.zeros_like(x)
    design = np.stack([coldest - x, max(warmest, float(x.max())) - x], axis=1)
    share, _ = nnls(design / noise[:, None], seen / noise)
    return np.asarray(seen - design @ share)


_SAYS = {
    "offset": "the camera's offset changed",
    "black body": "the black body differed by {:+.2f} K",
    "gain": "the camera's gain (exposure, range) changed by {:+.2g} %",
    "curve": "the camera's curve (gamma) changed",
}


@dataclass(frozen=True)
class _Cause:
    """A fitted cause. size: radiance, K, or percent. beside: (K,) difference without spray."""

    column: str
    size: float
    beside: Floats
    fit: Hypothesis


def _causes(
    seen: Floats, x: Floats, evidence: Evidence, noise: Floats, signal: Floats
) -> list[_Cause]:
    """Causes that are fitted to `seen`, each alone and with a spray as warm as the dense one;
    signal: (K,) of the references."""
    bend = signal * np.log(np.maximum(signal / signal.max(), 1e-9))  # of a power of the signal
    spray = _own(evidence, x) - x
    causes: dict[str, _Cause] = {}
    for name, columns in (
        ("offset", [np.ones_like(x)]),
        ("black body", [evidence.rise]),
        ("gain", [signal]),
        ("gain", [x]),
        ("gain", [x, np.ones_like(x)]),  # of an unknown dark level
        ("curve", [bend, signal]),
    ):
        for extra in ([], [spray]):
            design = (
                np.array([*columns, *(-column for column in columns), *extra]).T / noise[:, None]
            )
            scale = np.max(np.abs(design), axis=0)
            share, remainder = nnls(design / scale, seen / noise)
            share = share / scale
            if extra and share[-1] > _THIN:
                continue
            size = float(share[0] - share[len(columns)]) * (100.0 if name == "gain" else 1.0)
            description = f"as if {_SAYS[name].format(size)} between the kinds"
            fit = Hypothesis(description, float(remainder**2), len(columns) + len(extra))
            beside = np.asarray(seen - (share[-1] * spray if extra else 0.0))
            if name not in causes or fit.score < causes[name].fit.score:
                causes[name] = _Cause(name, size, beside, fit)
    return list(causes.values())


def _own(evidence: Evidence, x: Floats) -> float:
    """Radiance of the spray where it is densest, between 0 and the warmest."""
    slope = slopes(evidence)
    dense = (slope <= np.quantile(slope, CLEAREST)) & (1.0 - slope > THIN)
    if not dense.any():
        return 0.5 * evidence.warmest
    fall, start = np.polyfit(x / x.max(), evidence.change[:, dense].mean(axis=1) / x.max(), 1)
    return float(np.clip(-start / fall * x.max(), 0.0, evidence.warmest)) if fall < 0.0 else 0.0
