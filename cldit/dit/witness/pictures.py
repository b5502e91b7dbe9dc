"""Pictures as pictures: repeats, a level at which they end, frames taken for columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cldit.dit.shots import Sums
from cldit.dit.witness.finding import Witness

Floats = NDArray[np.float64]
AllSums = Mapping[tuple[float, str], Sums]

_PLATEAU = 10  # pixels that show the same largest count in every exposure
_NAMED = 3  # repeats that a message lists
_STEADIER = 4.0  # variance from one picture to the next over that along an axis: frames lie there


def repeats(sums: AllSums) -> Witness | None:
    """Pictures that are equal to the last bit, which noise forbids; flat ones are left out."""
    first: dict[bytes, str] = {}
    same: list[str] = []
    count = 0
    for (setpoint, kind), group in sorted(sums.items()):
        flat = not np.any(np.ptp(np.array(group.thumbnails), axis=(1, 2)) > 0.0)
        for name, digest in zip(group.ids, group.digests, strict=True):
            count += 1
            if digest in first and not flat:
                same.append(f"{name} ({kind} before {setpoint:g} K) = {first[digest]}")
            first.setdefault(digest, name)
    if not same:
        return None
    listed = ", ".join(same[:_NAMED]) + (", .." if len(same) > _NAMED else "")
    return Witness(
        name="repeats",
        says=f"{len(same)} of {count} pictures repeat another one, pixel by pixel ({listed}): "
        "a frozen camera, or files that were copied",
        stands_out=True,
        severe=True,
    )


def plateau(sums: AllSums, saturation_counts: float) -> tuple[Witness | None, float]:
    """A level at which pictures end, below the stated saturation.

    Args:
        sums: by set point and kind.
        saturation_counts: as stated.

    Returns:
        The witness, and the level from which a pixel says nothing.
    """
    top = max(float(group.largest.max()) for group in sums.values())
    if top >= saturation_counts or not any(
        np.count_nonzero(group.variance(slice(None)) > 0.0) >= _PLATEAU for group in sums.values()
    ):  # nothing ends early, or nothing has noise that could tell
        return None, saturation_counts
    ending: list[str] = []
    share = 0.0
    for (setpoint, kind), group in sorted(sums.items()):
        steady = group.mean(slice(None)) == top
        if len(group.ids) > 1 and np.count_nonzero(steady) >= _PLATEAU:
            ending.append(f"{kind}s before {setpoint:g} K")
            share = max(share, float(np.mean(group.largest == top)))
    if not ending:
        return None, saturation_counts
    return Witness(
        name="saturation",
        says=f"{', '.join(ending)} end at {top:g} counts, where up to {100 * share:.0f} % of the "
        f"pixels stand still; taken as saturated from there on, not from {saturation_counts:g}",
        stands_out=True,
    ), top


def axes(sums: AllSums, setpoints: Sequence[float]) -> Witness | None:
    """Finds stacks whose frames were taken for rows or columns.

    References differ from one to the next by noise, and from pixel to pixel by more. Where it is
    the other way round along one axis, the frames lie along it.

    Args:
        sums: by set point and kind.
        setpoints: all of them.

    Returns:
        The witness; None where all is well.
    """
    wrong: set[str] = set()
    for setpoint in setpoints:
        group = sums[setpoint, "reference"]
        count = len(group.ids)
        if count < 2 or min(group.total.shape) < 2:
            continue
        means = np.array([np.mean(small) for small in group.thumbnails], float)
        between = float(np.mean(group.variance(slice(None)))) - float(np.var(means, ddof=1))
        mean = group.mean(slice(None))
        for axis, name in ((0, "rows"), (1, "columns")):
            along = float(np.mean(np.diff(mean, axis=axis) ** 2)) / 2.0 * count
            if between > 1.0 and between > _STEADIER * along:
                wrong.add(name)
    if not wrong:
        return None
    return Witness(
        name="orientation",
        says="references differ more from picture to picture than along their "
        f"{' and '.join(sorted(wrong))}: are frames stored along that axis? "
        "measured.yaml names another order as `axes: [rows, columns, frames]`",
        stands_out=True,
        severe=True,
    )
