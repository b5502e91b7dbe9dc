"""Outliers: shots unlike the others of their background, as misfires or wrong kinds.

They are found, named, and weighed less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.dit.shots import Sums
from cldit.errors import EvaluationError

Floats = NDArray[np.float64]

HUBER = 2.5  # deviations beyond which a shot counts less
OUTLIER_DEVIATIONS = 6.0  # ... and beyond which it is named, and does not count at all
_LEAST_SHOTS = 3  # before a background, to tell which of them is one
_MIRRORED = 0.1  # residual of the swapped over that of the given kinds
_FAINT = 0.3  # of the largest Delta I: below it the scatter does not shrink further


@dataclass(frozen=True)
class Outlier:
    """One shot, how many usual deviations it is off, and the weight that `robust` gives it."""

    id: str
    deviations: float
    weight: float

    @property
    def text(self) -> str:
        """One line for the reader."""
        return (
            f"shot {self.id} is an outlier: it is {self.deviations:.1f} times as far off as usual"
        )


def deviations(sums: Mapping[tuple[float, str], Sums]) -> dict[str, float]:
    """How far each shot is off the median of its background, over how far shots usually are.

    Distances are RMS over the blocks of the shots' thumbnails. Injections scatter in proportion to
    what the spray does to the picture, references by the camera's noise; one number for all
    backgrounds (1.4826 times the median distance) is then the usual distance. Shots of a
    background that has fewer than three are not judged.
    """
    found: dict[str, float] = {}
    medians = {key: np.median(group.thumbnails, axis=0) for key, group in sums.items()}
    deltas = {
        setpoint: _rms(medians[setpoint, "injection"] - medians[setpoint, "reference"])
        for setpoint, kind in sums
        if kind == "injection"
    }
    for kind in ("reference", "injection"):
        distance: dict[str, float] = {}
        for (setpoint, of), group in sums.items():
            if of != kind or len(group.ids) < _LEAST_SHOTS:
                continue
            size = np.sqrt(max(float(np.mean(medians[setpoint, kind])), 1.0))
            if kind == "injection":
                size = max(deltas[setpoint], _FAINT * max(deltas.values()), size)
            for name, small in zip(group.ids, group.thumbnails, strict=True):
                distance[name] = _rms(small - medians[setpoint, kind]) / size
        usual = 1.4826 * float(np.median(list(distance.values()))) if distance else 0.0
        if usual > 0.0:
            found |= {name: value / usual for name, value in distance.items()}
    return found


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, float) ** 2)))


def judge(
    sums: Mapping[tuple[float, str], Sums],
) -> tuple[tuple[Outlier, ...], dict[str, float]]:
    """Outliers, the farthest first, and the weight of each shot whose weight is below 1.

    Args:
        sums: by set point [K] and kind.

    Returns:
        The outliers, and the weights by the id of the shot.
    """
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


def check_not_mirrored(
    sums: Mapping[tuple[float, str], Sums], sources: Mapping[str, Floats]
) -> None:
    """Finds references and injections that are swapped before one of at least three backgrounds.

    The others' lines predict what the spray does before it; swapped, it does the opposite.

    Args:
        sums: by set point [K] and kind.
        sources: (K,) radiance of each background, rising set points, with either kind.

    Raises:
        EvaluationError: names the background.
    """
    setpoints = sorted({setpoint for setpoint, _ in sums})
    if len(setpoints) < 3:
        return
    kinds = ("reference", "injection")
    stacks = {
        kind: np.array([np.mean(sums[k, kind].thumbnails, axis=0) for k in setpoints], float)
        for kind in kinds
    }
    delta = (stacks["injection"] - stacks["reference"]).reshape(len(setpoints), -1)
    source = np.mean([sources[kind] for kind in kinds], axis=0)
    best, where = 1.0, 0
    for number in range(len(setpoints)):
        others = [k for k in range(len(setpoints)) if k != number]
        if np.ptp(source[others]) <= 0.0:
            continue
        slope, start = np.polyfit(source[others] / source.max(), delta[others], 1)
        expected = start + slope * source[number] / source.max()
        given, swapped = _rms(delta[number] - expected), _rms(delta[number] + expected)
        noise = np.sqrt(np.mean(stacks["reference"][number]))  # far above that of blocks
        if _rms(expected) > noise and swapped < best * given:
            best, where = swapped / given, number
    if best < _MIRRORED:
        raise EvaluationError(
            f"background {setpoints[where]:g} K: the spray does the opposite of what it does "
            "before the others; are its references and injections swapped?"
        )
