"""Position of each shot on the axis along which camera and black body drift.

The axis is time if every shot has one, in units of the median interval between shots, so that the
positions of evenly spaced shots are their numbers. Otherwise it is the number of the shot.

A break is a gap longer than a plan waits for a black body. Instruments may have been switched off,
so their drift restarts: a break takes one interval of the axis, and `lag` has the rest. The
references show whether the drift continues through it (`cldit.dit.witness.drift`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask

BREAK_s = 3600.0  # the default of a plan's stability.timeout_s: then it ends with an error


class Place(NamedTuple):
    """Position of one shot. at: on the axis, with breaks shortened. lag: length of earlier breaks
    beyond one interval each. part: number of earlier breaks. since: intervals since its background
    was stable, or since the first shot of it if that is unknown."""

    at: float
    lag: float
    part: int
    since: float


@dataclass(frozen=True)
class Places:
    """Positions of n shots of one background: (n,) each, as in `Place`."""

    at: Floats
    lag: Floats
    part: NDArray[np.int_]
    since: Floats

    @classmethod
    def of(cls, places: Sequence[Place]) -> "Places":
        """Positions of several shots."""
        at, lag, part, since = np.array(places, float).T
        return cls(at, lag, part.astype(int), since)

    def __getitem__(self, chosen: slice | Mask) -> "Places":
        return Places(self.at[chosen], self.lag[chosen], self.part[chosen], self.since[chosen])

    @property
    def parts(self) -> int:
        """Number of parts between breaks."""
        return len(np.unique(self.part))

    def through(self) -> "Places":
        """The positions with breaks in full length."""
        return Places(self.at + self.lag, np.zeros_like(self.lag), self.part, self.since)

    def about_part_means(self, values: Floats) -> Floats:
        """Values (n,) minus the mean of their part."""
        means = {part: values[self.part == part].mean() for part in np.unique(self.part)}
        return np.asarray(values - np.array([means[part] for part in self.part]))


@dataclass(frozen=True, kw_only=True)
class DriftAxis:
    """The axis: the place of every shot, the length of breaks, and a text for people."""

    places: tuple[Place, ...]
    breaks_s: tuple[float, ...]
    text: str

    def line(self, *, through: bool) -> str:
        """Line for the report; `through`: the references show that drift continues over breaks."""
        if not self.breaks_s:
            return self.text
        hours = ", ".join(f"{break_s / 3600.0:.3g} h" for break_s in self.breaks_s)
        course = "it continues, as the references show" if through else "it restarts"
        return f"{self.text}; after a break ({hours}) {course}"


def drift_axis(shots: Sequence[Any]) -> DriftAxis:
    """The axis of an acquisition of `shots` (`cldit.dit.shots.Shot`).

    A shot may have `time_s`, seconds of any clock, and `stable_s`, the time by that clock at which
    its background became stable.
    """
    times = [getattr(shot, "time_s", None) for shot in shots]
    times_s = [time_s for time_s in times if time_s is not None]
    lacking = len(times) - len(times_s)
    if lacking or len(set(times_s)) < len(times_s):
        cause = (
            f"{lacking} of {len(times)} shots have no time" if lacking else "some times are equal"
        )
        if lacking == len(times):
            cause = "no shot has a time"
        at = np.arange(1.0, len(shots) + 1.0)
        return DriftAxis(
            places=_placed(shots, at, at, np.zeros(len(shots), int), unit_s=None),
            breaks_s=(),
            text=f"drift fitted against the shot number: {cause}",
        )
    order = np.argsort(times_s)
    gaps = np.diff(np.array(times_s)[order])
    unit_s = float(np.median(gaps))
    broken = (gaps > BREAK_s) & (unit_s <= BREAK_s)  # a shot a day has no breaks
    at, through, part = np.empty(len(times_s)), np.empty(len(times_s)), np.empty(len(times_s), int)
    closed = np.where(broken, unit_s, gaps) / unit_s
    at[order] = 1.0 + np.concatenate([[0.0], np.cumsum(closed)])
    through[order] = 1.0 + np.concatenate([[0.0], np.cumsum(gaps / unit_s)])
    part[order] = np.concatenate([[0], np.cumsum(broken)])
    description = f"drift fitted against time; median shot interval {unit_s:.3g} s"
    if (longest_s := float(gaps[~broken].max())) > unit_s:
        description += f", longest {longest_s:.3g} s"
    return DriftAxis(
        places=_placed(shots, at, through, part, unit_s=unit_s),
        breaks_s=tuple(gaps[broken].tolist()),
        text=description,
    )


def _placed(
    shots: Sequence[Any],
    at: Floats,
    through: Floats,
    part: NDArray[np.int_],
    *,
    unit_s: float | None,
) -> tuple[Place, ...]:
    start: dict[tuple[float, int], float] = {}
    for shot, place, run in zip(shots, at, part, strict=True):
        key = (shot.background_setpoint_K, int(run))
        start[key] = min(start.get(key, np.inf), float(place))
    places = []
    for shot, place, full, run in zip(shots, at, through, part, strict=True):
        stable_s = getattr(shot, "stable_s", None)
        since = float(place) - start[shot.background_setpoint_K, int(run)]
        if unit_s is not None and stable_s is not None:
            since = (shot.time_s - stable_s) / unit_s
        places.append(Place(float(place), float(full - place), int(run), since))
    return tuple(places)
