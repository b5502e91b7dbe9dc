"""Outliers: shots that differ from the others of their background, such as misfires."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from cldit.arrays import Floats
from cldit.dit.chance import DEVIATIONS, REMAINING, usual
from cldit.dit.shots import AllSums, Sums, thumbnail_edges
from cldit.dit.solve import KINDS
from cldit.errors import EvaluationError

LEAST_SHOTS = 3  # per background: of two that differ, neither is the outlier
_FAINT = 0.3  # of the largest Delta I: below it the scatter does not shrink further
_PART = 3.0  # usual largest deviations of a block, for an outlier in part of the image
_LEAST_PART = 8.0  # standard deviations of a block, likewise; chance reaches 5 in 10^6 blocks


@dataclass(frozen=True)
class Outlier:
    """A shot with its deviation, in units of the usual one, and the part of the image that
    deviates; empty: all of it.
    """

    id: str
    deviations: float
    where: str = ""

    @property
    def text(self) -> str:
        """Line for the report."""
        return (
            f"shot {self.id} is an outlier: {self.deviations:.1f} times the usual deviation"
            f"{self.where}"
        )


def outliers(sums: AllSums) -> tuple[Outlier, ...]:
    """Shots that differ from the median of their background, the farthest first.

    Distances are RMS over the blocks of the thumbnails, or the largest of one block. Injections
    scatter in proportion to the signal of the spray, references by the camera's noise; relative to
    these, the usual distance is that of the median over all backgrounds. A background with
    fewer than three shots, or with equal ones (saturated), is ignored.
    """
    detected: list[Outlier] = []
    thumbnails = {key: np.array(group.thumbnails, float) for key, group in sums.items()}
    medians = {key: np.median(small, axis=0) for key, small in thumbnails.items()}
    deltas = {
        setpoint: _rms(medians[setpoint, "injection"] - medians[setpoint, "reference"])
        for setpoint, kind in sums
        if kind == "injection"
    }
    for kind in KINDS:
        distance: dict[str, float] = {}
        parts: dict[str, tuple[float, str]] = {}
        for (setpoint, group_kind), group in sums.items():
            repeated = group.exposures < len(group.ids)
            if group_kind != kind or len(group.ids) < LEAST_SHOTS or repeated:
                continue
            noise = _noise(sums[setpoint, "reference"])
            size = noise
            if kind == "injection":
                size = max(deltas[setpoint], _FAINT * max(deltas.values()), size)
            pattern = medians[setpoint, kind]
            if kind == "injection":
                pattern = pattern - medians[setpoint, "reference"]
            deviations = thumbnails[setpoint, kind] - medians[setpoint, kind]
            for name, off in zip(group.ids, deviations, strict=True):
                distance[name] = _rms(off) / size
            block = noise / np.sqrt(group.total.size / pattern.size)
            worst = _worst(deviations, pattern, noise=block, shape=group.total.shape)
            parts |= dict(zip(group.ids, worst, strict=True))
        scale = usual(np.array(list(distance.values()))) if distance else 0.0
        usual_part = max(
            _LEAST_PART / _PART, float(np.median([peak for peak, _ in parts.values()] or [0.0]))
        )
        for name, off in distance.items():
            ratio = off / scale if scale > 0.0 else 0.0
            part, where = parts[name]
            if ratio > DEVIATIONS:
                detected.append(Outlier(name, ratio))
            elif part > _PART * usual_part:
                detected.append(Outlier(name, part / usual_part, where))
    return tuple(sorted(detected, key=lambda shot: -shot.deviations))


def _worst(
    deviations: Floats, pattern: Floats, *, noise: float, shape: tuple[int, ...]
) -> list[tuple[float, str]]:
    """Largest deviation of a block of each image, in standard deviations, and where it is.

    away: (n, ..) differences from the median. pattern: (..) of the signal. The change that all
    blocks share, in proportion to the pattern, is no part. noise: of a block.
    """
    strong = np.abs(pattern) >= _FAINT * np.max(np.abs(pattern))
    share = np.median(deviations[:, strong] / pattern[strong], axis=1) if pattern.any() else 0.0
    rest = np.abs(deviations - np.multiply.outer(share, pattern))
    nearby = maximum_filter(np.abs(pattern), 3)
    spread = usual(rest[:, strong] / nearby[strong]) if pattern.any() else 0.0
    relative = rest / np.hypot(noise, spread * nearby)
    rows, columns = (np.append(thumbnail_edges(n), n) for n in shape)
    worst: list[tuple[float, str]] = []
    for image in relative:
        peak = float(image.max())
        y, x = np.nonzero(image >= 0.5 * peak)
        where = (
            f" in rows {rows[y.min()]} to {rows[y.max() + 1] - 1}, columns {columns[x.min()]} to "
            f"{columns[x.max() + 1] - 1}"
        )
        worst.append((peak, where))
    return worst


def _noise(references: Sums) -> float:
    """Noise of a pixel: by the variance of references, which one outlier may spoil, or the median
    deviation of their blocks; else that of counts."""
    small = np.array(references.thumbnails, float)
    of_blocks = usual(small - np.median(small, axis=0)) * np.sqrt(
        references.total.size / small[0].size
    )
    seen = np.sqrt(float(np.median(references.variance())))
    level = np.sqrt(max(float(np.mean(np.abs(references.mean()))), 1e-30))
    return float(min((estimate for estimate in (seen, of_blocks) if estimate > 0.0), default=level))


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, float) ** 2)))


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
        remaining = [k for k in range(len(setpoints)) if k != number]
        if np.ptp(source[remaining]) <= 0.0:
            continue
        slope, start = np.polyfit(source[remaining] / source.max(), delta[remaining], 1)
        expected = start + slope * source[number] / source.max()
        recorded, swapped = _rms(delta[number] - expected), _rms(delta[number] + expected)
        noise = _noise(sums[setpoints[number], "reference"])  # far above that of blocks
        if _rms(expected) > noise and swapped < best * recorded:
            best, where = swapped / recorded, number
    if best < REMAINING:
        raise EvaluationError(
            f"background {setpoints[where]:g} K: the spray's signal is opposite to that at the "
            "others; are its references and injections swapped?"
        )
