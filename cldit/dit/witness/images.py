"""Checks of images: a level of saturation, frames read as rows or columns."""

from collections.abc import Sequence

import numpy as np

from cldit.arrays import Mask
from cldit.dit.chance import FEW, IMPROBABLE
from cldit.dit.shots import AllSums
from cldit.dit.witness.finding import Witness, refusal

_PLATEAU = 10  # least number of pixels with the same largest count in every exposure
_STEADIER = 4.0  # variance between images over that along an axis that holds frames: twice its sd


def plateau(sums: AllSums, saturation_counts: float) -> tuple[Witness | None, float]:
    """Witness of a level of saturation below the stated one, and the level to use."""
    top = max(float(group.largest.max()) for group in sums.values())
    if top >= saturation_counts:
        return _stuck(sums), saturation_counts
    if not any(
        np.count_nonzero(group.variance() > 0.0) >= _PLATEAU for group in sums.values()
    ):  # no lower level, or no noise to detect it by
        return None, saturation_counts
    ending: list[str] = []
    share = 0.0
    for (setpoint, kind), group in sorted(sums.items()):
        steady = group.mean() == top
        if len(group.ids) > 1 and np.count_nonzero(steady) >= _PLATEAU:
            ending.append(f"{kind}s at {setpoint:g} K")
            share = max(share, float(np.mean(group.largest == top)))
    if not ending:
        return _stuck(sums), saturation_counts
    return Witness(
        name="saturation",
        says=f"{', '.join(ending)} end at {top:g} counts, with up to {100 * share:.0f} % of the "
        f"pixels constant there; this counts as saturation, not {saturation_counts:g}",
        stands_out=True,
    ), top


def _stuck(sums: AllSums) -> Witness | None:
    """Witness of pixels that are constant at some backgrounds; they count as saturated there.

    A camera that corrects its images saturates at another count in each pixel.
    """
    still: dict[tuple[float, str], Mask] = {}
    usual: list[float] = []
    for key, group in sums.items():
        if group.spare() > 0.0:
            variance = group.variance()
            still[key] = variance == 0.0
            usual += [float(np.median(variance))] if still[key].mean() < 0.5 else []
    dead = np.all(list(still.values()), axis=0) if still else np.False_
    noise = np.sqrt(min(usual, default=0.0))
    ending: list[str] = []
    for (setpoint, kind), constant in sorted(still.items()):
        group = sums[setpoint, kind]
        stuck = constant & ~dead & (group.largest < group.saturation_counts)
        chance = (0.4 / max(noise, 0.4)) ** group.spare()  # density of a normal distribution
        if stuck.mean() > max(FEW, 10.0 * chance) and chance < IMPROBABLE:
            group.largest[stuck] = np.inf
            ending.append(f"{100 * stuck.mean():.0f} % of the {kind}s at {setpoint:g} K")
    if not ending:
        return None
    return Witness(
        name="saturation",
        says=f"pixels have the same count in every image: {', '.join(ending)}; they count as "
        "saturated",
        stands_out=True,
    )


def axes(sums: AllSums, setpoints: Sequence[float]) -> Witness | None:
    """Witness of stacks whose frames were read as rows or columns.

    References differ from each other by noise, and from pixel to pixel by more. If it is reversed
    along one axis, that axis holds the frames.
    """
    wrong: set[str] = set()
    for setpoint in setpoints:
        group = sums[setpoint, "reference"]
        count = len(group.ids)
        if count < 2 or min(group.total.shape) < 2:
            continue
        means = np.array([np.mean(small) for small in group.thumbnails], float)
        between = float(np.mean(group.variance())) - float(np.var(means, ddof=1))
        mean = group.mean()
        for axis, name in ((0, "rows"), (1, "columns")):
            along = float(np.mean(np.diff(mean, axis=axis) ** 2)) / 2.0 * count
            if between > 1.0 and between > _STEADIER * along:
                wrong.add(name)
    if not wrong:
        return None
    return refusal(
        "orientation",
        "references differ more from image to image than along their "
        f"{' and '.join(sorted(wrong))}: are frames stored along that axis?",
        "name their order in measured.yaml, as `axes: [rows, columns, frames]`",
    )
