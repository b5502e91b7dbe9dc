"""Outliers: shots that differ from the others of their background, such as misfires."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.dit.shots import AllSums, Sums
from cldit.dit.solve import KINDS
from cldit.errors import EvaluationError

HUBER = 2.5  # deviations beyond which a shot counts less
OUTLIER_DEVIATIONS = 6.0  # ... and beyond which it is reported and does not count
_LEAST_SHOTS = 3  # per background, needed to identify an outlier
_MIRRORED = 0.1  # residual of the swapped over that of the given kinds
_FAINT = 0.3  # of the largest Delta I: below it the scatter does not shrink further


@dataclass(frozen=True)
class Outlier:
    """A shot with its deviation, in units of the usual one, and its weight with `robust`."""

    id: str
    deviations: float
    weight: float

    @property
    def text(self) -> str:
        """Line for the report."""
        return f"shot {self.id} is an outlier: {self.deviations:.1f} times the usual deviation"


def deviations(sums: AllSums) -> dict[str, float]:
    """Distance of each shot from the median of its background, over the usual distance.

    Distances are RMS over the blocks of the thumbnails. Injections scatter in proportion to the
    signal of the spray, references by the camera's noise; relative to these, 1.4826 times the
    median over all backgrounds is the usual distance. A background with fewer than three shots is
    ignored.
    """
    found: dict[str, float] = {}
    medians = {key: np.median(group.thumbnails, axis=0) for key, group in sums.items()}
    deltas = {
        setpoint: _rms(medians[setpoint, "injection"] - medians[setpoint, "reference"])
        for setpoint, kind in sums
        if kind == "injection"
    }
    for kind in KINDS:
        distance: dict[str, float] = {}
        for (setpoint, of), group in sums.items():
            if of != kind or len(group.ids) < _LEAST_SHOTS:
                continue
            size = _noise(sums[setpoint, "reference"])
            if kind == "injection":
                size = max(deltas[setpoint], _FAINT * max(deltas.values()), size)
            for name, small in zip(group.ids, group.thumbnails, strict=True):
                distance[name] = _rms(small - medians[setpoint, kind]) / size
        usual = 1.4826 * float(np.median(list(distance.values()))) if distance else 0.0
        if usual > 0.0:
            found |= {name: value / usual for name, value in distance.items()}
    return found


def _noise(references: Sums) -> float:
    """Noise of a pixel: by the variance of references, else that of counts."""
    seen = float(np.median(references.variance()))
    level = float(np.mean(np.abs(references.mean())))
    return float(np.sqrt(seen if seen > 0.0 else max(level, 1e-30)))


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, float) ** 2)))


def judge(
    sums: AllSums,
) -> tuple[tuple[Outlier, ...], dict[str, float]]:
    """Outliers, the farthest first, and the weights below 1 by the id of the shot."""
    judged = deviations(sums)
    weights = {name: huber(off) for name, off in judged.items() if huber(off) < 1.0}
    outliers = [
        Outlier(name, judged[name], weight) for name, weight in weights.items() if weight == 0.0
    ]
    return tuple(sorted(outliers, key=lambda shot: -shot.deviations)), weights


def huber(off: float) -> float:
    """Weight (Huber 1964) of a shot `off` deviations away: 1, then HUBER / off, then 0."""
    if off > OUTLIER_DEVIATIONS:
        return 0.0
    return 1.0 if off <= HUBER else HUBER / off


def check_not_mirrored(sums: AllSums, sources: Mapping[str, Floats]) -> None:
    """Checks that references and injections are not swapped at one of three or more backgrounds.

    The lines of the other backgrounds predict the signal of the spray; if swapped, it is opposite.
    The radiances `sources` (K,) of each kind belong to rising set points.
    """
    setpoints = sorted({setpoint for setpoint, _ in sums})
    if len(setpoints) < 3:
        return
    stacks = {
        kind: np.array([np.mean(sums[k, kind].thumbnails, axis=0) for k in setpoints], float)
        for kind in KINDS
    }
    delta = (stacks["injection"] - stacks["reference"]).reshape(len(setpoints), -1)
    source = np.mean([sources[kind] for kind in KINDS], axis=0)
    best, where = 1.0, 0
    for number in range(len(setpoints)):
        others = [k for k in range(len(setpoints)) if k != number]
        if np.ptp(source[others]) <= 0.0:
            continue
        slope, start = np.polyfit(source[others] / source.max(), delta[others], 1)
        expected = start + slope * source[number] / source.max()
        given, swapped = _rms(delta[number] - expected), _rms(delta[number] + expected)
        noise = _noise(sums[setpoints[number], "reference"])  # far above that of blocks
        if _rms(expected) > noise and swapped < best * given:
            best, where = swapped / given, number
    if best < _MIRRORED:
        raise EvaluationError(
            f"background {setpoints[where]:g} K: the spray's signal is opposite to that at the "
            "others; are its references and injections swapped?"
        )
