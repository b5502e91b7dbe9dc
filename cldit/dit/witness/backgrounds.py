"""Backgrounds against each other: the signals of each against the line through the others.

References are linear in the radiance of the black body, whatever gain and offset a pixel has. A
deviation means another temperature than stated, or a change of the camera. The same applies to
injections in the pixels with the least spray.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from cldit.acquisition.witness_names import Acceptable
from cldit.arrays import Floats, Mask
from cldit.dit.chance import ALONE, sure
from cldit.dit.hypotheses import UNITS, Hypothesis, describe, fitted, line_chi2
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import LIMIT_K, WORTH_K, Witness, refusal

FLOOR_K = 0.005  # error of mean shares of windows
CHOSEN = 1.16**2  # squared mean of the highest 30 % of a normal distribution
CLEAREST = 0.3  # share of the blocks, those with the least spray
_COLD_K = 223.0  # colder than any part of a rig, but a common temperature in Celsius
THIN = 0.02  # emissivity of a spray that is hardly seen


@dataclass(frozen=True, kw_only=True)
class OffLine:
    """Deviations of K points from the line through the others.

    kelvin, noise_K: (K,). lone: the one without which the others are on a line; None if there is
    none, or with three points.
    """

    kelvin: Floats
    noise_K: Floats
    lone: int | None

    def beyond(self, deviations: float) -> bool:
        """True if a point deviates by more than so many standard deviations of its noise."""
        return bool(np.any(np.abs(self.kelvin) > deviations * self.noise_K))


def off_line(x: Floats, y: Floats, *, rise: Floats, variance: Floats) -> OffLine:
    """Deviation of each of K >= 3 points from the line through the others, with equal weights.

    Args:
        x: (K,) radiance of the background.
        y, variance: (K,) signal, and its variance.
        rise: (K,) of x per kelvin.
    """
    gain, _ = _line(x, y, rise)
    count = len(x)
    kelvin, noise = np.zeros(count), np.zeros(count)
    for k in range(count):
        rest = np.arange(count) != k
        design = np.stack([x[rest], np.ones(count - 1) * x.max()], axis=1) / rise[rest][:, None]
        # (K - 1,) coefficients of the others' signals in the prediction
        weight = np.array([x[k], x.max()]) @ np.linalg.pinv(design) / rise[rest]
        kelvin[k] = (y[k] - weight @ y[rest]) / (gain * rise[k])
        noise[k] = np.sqrt(variance[k] + weight**2 @ variance[rest]) / (abs(gain) * rise[k])
    total = squares(x, y, rise)
    without = [squares(np.delete(x, k), np.delete(y, k), np.delete(rise, k)) for k in range(count)]
    lone = int(np.argmin(without)) if count >= 4 and min(without) < ALONE * total else None
    return OffLine(kelvin=kelvin, noise_K=noise, lone=lone)


def squares(x: Floats, y: Floats, rise: Floats) -> float:
    """Sum of squares in kelvin of points about their line; `x`, `y`, `rise` as in `off_line`."""
    gain, off = _line(x, y, rise)
    return float(off @ off) / gain**2


def _line(x: Floats, y: Floats, rise: Floats) -> tuple[float, Floats]:
    """Slope of the points' line, infinite where it is 0, and residuals (K,) over `rise`."""
    design = np.stack([x, np.ones_like(x) * x.max()], axis=1) / rise[:, None]
    best, *_ = np.linalg.lstsq(design, y / rise, rcond=None)
    return float(best[0]) or np.inf, y / rise - design @ best


def references(evidence: Evidence, *, stated_K: Floats) -> tuple[Witness, OffLine | None]:
    """References against each other: the witness, and the deviations (None with two backgrounds).

    The user states the standard deviation `stated_K` (K,) of each background.
    """
    all_blocks = np.ones(evidence.blocks, bool)
    return _judge(evidence, "reference", all_blocks, stated_K=stated_K)


def injections(evidence: Evidence, *, stated_K: Floats) -> Witness:
    """Injections against each other in the blocks with the least spray; see `references`."""
    return _judge(evidence, "injection", clearest(evidence), stated_K=stated_K)[0]


def fitted_over(as_stated: Evidence, lined: Witness, *, stated_K: Floats) -> Witness:
    """Witness of references with a filter that was fitted to them.

    It is `lined`, that of the fitted filter, unless with the filter `as_stated` the deviation of
    one background is the only cause that fits: then it is severe.
    """
    stated_witness, off = references(as_stated, stated_K=stated_K)
    if off is None or off.lone is None or len(stated_witness.causes) != 1:
        return lined
    message = f"{stated_witness.says}; no other filter explains that: use --calibration planck"
    return replace(stated_witness, says=message, severe=True)


def clearest(evidence: Evidence, *, share: float = CLEAREST) -> Mask:
    """Blocks (B,) with the least spray, a share of all, by the slope of the injections."""
    slope = slopes(evidence)
    return np.asarray(slope >= np.quantile(slope, 1.0 - share))


def slopes(evidence: Evidence) -> Floats:
    """Slope (B,) of the injections' line over that of the references."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = evidence.gains("injection") / evidence.gains("reference")
    return np.asarray(np.nan_to_num(ratio, nan=1.0, posinf=1.0, neginf=0.0))


def _judge(
    evidence: Evidence, kind: str, chosen: Mask, *, stated_K: Floats
) -> tuple[Witness, OffLine | None]:
    comparison = f"{kind}s against each other"
    name: Acceptable = "backgrounds" if kind == "reference" else "injections"
    if len(evidence.setpoints) < 3:
        return Witness(
            name=name,
            compared=comparison,
            says="two backgrounds always lie on a line; this check needs a third",
        ), None
    x, y = evidence.source[kind], evidence.mean(kind)[:, chosen].mean(axis=1)
    variance = evidence.variance(kind, chosen)
    if kind == "injection":  # the noise of the blocks that were chosen for how they look
        camera_variance = evidence.camera[kind][:, chosen].mean(axis=1) / evidence.number(kind)
        variance = variance + CHOSEN * camera_variance
    variance = variance + (np.hypot(FLOOR_K, stated_K) * evidence.rise) ** 2
    off = off_line(x, y, rise=evidence.rise, variance=variance)
    beyond = off.beyond(sure(evidence.degrees(kind)))
    worst_K = float(np.max(np.abs(off.kelvin)))
    stands_out = beyond and worst_K > WORTH_K
    none = line_chi2(x, y, variance)
    tried = _hypotheses(evidence, kind, off, y, variance) if stands_out else []
    causes = fitted(tried, none=none, degrees=len(x) - 2)
    witness = Witness(
        name=name,
        compared=comparison,
        says=describe(causes, none=none, tried=len(tried)) if stands_out else "",
        causes=tuple(cause.text for cause in causes),
        remedy=_remedy(evidence, off),
        setpoints=evidence.setpoints,
        kelvin=tuple(off.kelvin.tolist()),
        noise_K=tuple(off.noise_K.tolist()),
        stands_out=stands_out,
        severe=beyond and (_size(off) > LIMIT_K or any(cause.severe for cause in causes[:1])),
    )
    return witness, off


def _remedy(evidence: Evidence, off: OffLine) -> str:
    if off.lone is None:
        return "correct the temperatures, or the order of the images"
    name = f"{evidence.setpoints[off.lone]:g} K"
    return f"correct the temperature of background {name}, or remove its images"


def _size(off: OffLine) -> float:
    """Deviation of the lone background, or the median of all."""
    if off.lone is not None:
        return float(abs(off.kelvin[off.lone]))
    return float(np.median(np.abs(off.kelvin)))


def _hypotheses(
    evidence: Evidence, kind: str, off: OffLine, y: Floats, variance: Floats
) -> list[Hypothesis]:
    """Causes of points `y` (K,) that are not on a line, each fitted to them."""
    at, x = evidence.temperatures_K[kind], evidence.source[kind]
    names = [f"{setpoint:g} K" for setpoint in evidence.setpoints]
    count = len(names)
    tried: list[Hypothesis] = []
    for unit, to_kelvin in UNITS.items():
        real_K = to_kelvin(at)
        if real_K.min() > _COLD_K:
            chi2 = line_chi2(evidence.own_radiance(real_K), y, variance)
            tried.append(Hypothesis(f"the temperatures look like {unit}", chi2, 0, severe=True))
    cause = "counts are linear in temperature: are the images temperatures?"
    tried.append(Hypothesis(cause, line_chi2(at, y, variance), 0, severe=True))
    for i, j in combinations(range(count), 2):
        order = np.arange(count)
        order[[i, j]] = j, i
        cause = (
            f"the {kind}s (or temperatures) of backgrounds {names[i]} and {names[j]} look swapped"
        )
        tried.append(Hypothesis(cause, line_chi2(x, y[order], variance[order]), 0, severe=True))
    if count == 3:
        cause = "one of the three deviates, or filter or camera differ from those stated"
        return [*tried, Hypothesis(cause, 0.0, 1)]
    for k, name in enumerate(names):
        lone_chi2 = line_chi2(x, y, variance, np.eye(count)[k])
        tried.append(
            Hypothesis(f"background {name} deviates by {off.kelvin[k]:+.2f} K", lone_chi2, 1)
        )
    bent = line_chi2(x, y, variance, (x / x.max()) ** 2)
    cause = "the filter, or the camera's curve, differs from that stated"
    tried.append(Hypothesis(cause, bent, 1))
    for k in range(2, count - 1):
        change = np.where(np.arange(count) >= k, y, 0.0)
        cause = f"the camera's gain (exposure, range) changed from {names[k]} on"
        tried.append(Hypothesis(cause, line_chi2(x, y, variance, change), 1))
    return tried


def celsius(named_K: dict[str, float]) -> Witness | None:
    """Witness of temperatures, by their names, that are impossible unless in degrees Celsius."""
    cold = {name: kelvin for name, kelvin in named_K.items() if kelvin < _COLD_K}
    if not cold:
        return None
    listed = ", ".join(f"{name} {kelvin:g} K" for name, kelvin in cold.items())
    message = f"temperatures that look like degrees Celsius: {listed}"
    return refusal("celsius", message, "add 273.15")
