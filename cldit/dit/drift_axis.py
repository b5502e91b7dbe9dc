"""Where each shot lies on the axis along which camera and black body drift.

The axis is time where every shot has one, in units of the median interval between two shots, so
that evenly spaced shots lie where their numbers do. Otherwise it is the number of the shot.

A break is a gap longer than a plan waits for a black body. What was switched off and on again
starts anew: a break takes one interval of the axis, and `lag` has the rest. The references say
whether one line goes through it all the same (`cldit.dit.witness.drift`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BREAK_s = 3600.0  # the default of a plan's stability.timeout_s: then it ends with an error


class Place(NamedTuple):
    """Of one shot. at: on the axis, breaks closed. lag: intervals that breaks before it took beyond
    the one. part: how many breaks were before it. since: intervals since its background was
    stable, or since the first shot before it where nobody noted that."""

    at: float
    lag: float
    part: int
    since: float


@dataclass(frozen=True)
class Places:
    """Of n shots before one background: (n,) each, as in `Place`."""

    at: Floats
    lag: Floats
    part: NDArray[np.int_]
    since: Floats

    @classmethod
    def of(cls, places: Sequence[Place]) -> Places:
        """Of single `places`."""
        at, lag, part, since = np.array(places, float).T
        return cls(at, lag, part.astype(int), since)

    def __getitem__(self, which: slice | NDArray[np.bool_]) -> Places:
        return Places(self.at[which], self.lag[which], self.part[which], self.since[which])

    @property
    def parts(self) -> int:
        """How many there are of them, with breaks in between."""
        return len(np.unique(self.part))

    def through(self) -> Places:
        """The same with breaks in full length."""
        return Places(self.at + self.lag, np.zeros_like(self.lag), self.part, self.since)

    def away(self, values: Floats) -> Floats:
        """(n,) `values` (n,), each less the mean of its part."""
        means = {one: values[self.part == one].mean() for one in np.unique(self.part)}
        return np.asarray(values - np.array([means[one] for one in self.part]))


@dataclass(frozen=True, kw_only=True)
class DriftAxis:
    """places: of every shot, in the order of the shots. breaks_s: how long each is. text: what the
    axis is, for people."""

    places: tuple[Place, ...]
    breaks_s: tuple[float, ...]
    text: str

    def said(self, *, through: bool) -> str:
        """A line for the reader.

        Args:
            through: whether the references show that a drift goes on through the breaks.

        Returns:
            What the axis is, and what was made of breaks.
        """
        if not self.breaks_s:
            return self.text
        hours = ", ".join(f"{one / 3600.0:.3g} h" for one in self.breaks_s)
        made = "the references show that it goes on" if through else "it starts anew"
        return f"{self.text}; after a break ({hours}) {made}"


def drift_axis(shots: Sequence[Any]) -> DriftAxis:
    """The axis of an acquisition.

    Args:
        shots: `cldit.dit.shots.Shot`; `time_s`, seconds of any clock, and `stable_s`, when its
            background became stable by the same clock, may be there or None.
    """
    times = [getattr(shot, "time_s", None) for shot in shots]
    known = [one for one in times if one is not None]
    lacking = len(times) - len(known)
    if lacking or len(set(known)) < len(known):
        why = f"{lacking} of {len(times)} have no time" if lacking else "some have the same time"
        if lacking == len(times):
            why = "no shot has a time"
        at = np.arange(1.0, len(shots) + 1.0)
        return DriftAxis(
            places=_placed(shots, at, at, np.zeros(len(shots), int), unit_s=None),
            breaks_s=(),
            text=f"drift is told over the number of the shot: {why}",
        )
    order = np.argsort(known)
    gaps = np.diff(np.array(known)[order])
    unit_s = float(np.median(gaps))
    broken = (gaps > BREAK_s) & (unit_s <= BREAK_s)  # a shot a day has no breaks
    at, whole, part = np.empty(len(known)), np.empty(len(known)), np.empty(len(known), int)
    closed = np.where(broken, unit_s, gaps) / unit_s
    at[order] = 1.0 + np.concatenate([[0.0], np.cumsum(closed)])
    whole[order] = 1.0 + np.concatenate([[0.0], np.cumsum(gaps / unit_s)])
    part[order] = np.concatenate([[0], np.cumsum(broken)])
    text = f"drift is told over time: {unit_s:.3g} s between shots (median)"
    if (longest_s := float(gaps[~broken].max())) > unit_s:
        text += f", {longest_s:.3g} s at most"
    return DriftAxis(
        places=_placed(shots, at, whole, part, unit_s=unit_s),
        breaks_s=tuple(gaps[broken].tolist()),
        text=text,
    )


def _placed(
    shots: Sequence[Any],
    at: NDArray[np.float64],
    whole: NDArray[np.float64],
    part: NDArray[np.int_],
    *,
    unit_s: float | None,
) -> tuple[Place, ...]:
    first: dict[tuple[float, int], float] = {}
    for shot, place, run in zip(shots, at, part, strict=True):
        key = (shot.background_setpoint_K, int(run))
        first[key] = min(first.get(key, np.inf), float(place))
    found = []
    for shot, place, all_in, run in zip(shots, at, whole, part, strict=True):
        stable_s = getattr(shot, "stable_s", None)
        since = float(place) - first[shot.background_setpoint_K, int(run)]
        if unit_s is not None and stable_s is not None:
            since = (shot.time_s - stable_s) / unit_s
        found.append(Place(float(place), float(all_in - place), int(run), since))
    return tuple(found)
