"""Steady drift: how references change from shot to shot, and what that makes of their means.

The rates before K backgrounds, r_k = offset + gain S_k with the signal S_k, are fitted by weighted
least squares. The fit gives the two rates m and their covariance C. An error of the means follows
the same course, so its second moment about zero is m m' + C, and that goes into the covariance of
the lines' fit (`cldit.dit.fit`, steady errors): with m alone, one number of variance 1 for offset
and gain together; with C, what the rates leave open.

A black body that drifts looks much like a gain that does. Its rate, in proportion to the radiance
per kelvin, is fitted beside the others, and so what it leaves open of them is in C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.dit.solve import Cause
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import sure
from cldit.dit.witness.lines import squares

Floats = NDArray[np.float64]

_AGAIN = 3  # each brings a factor of the drift itself: a tenth at most
_NEAR = 0.5  # by how much a course may differ from what the rates foretell, relative


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A steady drift, radiance or (gain) relative.

    rate: (K,) an interval of the axis before each background. course: (K,) of the references'
    means. modes: (M, K) parts of the course, each of variance 1; the modes of all trends of an
    acquisition belong together. apart: (M, K) how much more of each the injections' means have.
    """

    rate: Floats
    course: Floats
    modes: Floats
    apart: Floats | None = None


Trends = Mapping[Cause, Trend]


def steady(evidence: Evidence, *, beyond: bool, steps: bool = True) -> Trends:
    """What changes from shot to shot, the same way before all backgrounds.

    A black body starts anew before each background: where it drifts, references are nearer to their
    line without what a gain would make of them.

    Args:
        evidence: of K backgrounds.
        beyond: whether references lie off their line.
        steps: the camera's offset is another number after each break.
    """
    camera = _of_camera(evidence)
    if len(evidence.setpoints) == 2:  # there is no line that would tell
        return camera
    blackbody = _of_blackbody(evidence)
    if steps:
        camera, blackbody = (_with_steps(evidence, one) for one in (camera, blackbody))
    if not beyond:
        return blackbody
    x, rise = evidence.source["reference"], evidence.rise
    left = [squares(x, signal(without(evidence, one)), rise) for one in (camera, blackbody)]
    return camera if left[0] < left[1] else blackbody


def _with_steps(evidence: Evidence, trends: Trends) -> Trends:
    """The offset's course with what each break did to it, from the references' line.

    The line is one over all parts: those of a background with a break within show it by themselves.
    """
    if not evidence.breaks:
        return trends
    first = min(int(places.part.min()) for places in evidence.places["reference"])
    breaks = first + np.arange(evidence.breaks)
    share = {  # (breaks, K) of a kind's shots that are after each
        kind: np.stack([(one.part[:, None] > breaks).mean(axis=0) for one in places], axis=1)
        for kind, places in evidence.places.items()
    }
    still = without(evidence, trends)
    x, every = evidence.source["reference"], np.ones(evidence.blocks, bool)
    rows, values, weight = [], [], []
    for k, (places, one) in enumerate(
        zip(evidence.places["reference"], still.picture("reference", every), strict=True)
    ):
        rate = sum((trend.rate[k] * unit(still, of)[k] for of, trend in trends.items()), 0.0)
        one = one - rate * (places.at - places.at.mean())
        for part in np.unique(places.part):
            here = places.part == part
            rows.append([x[k] / x.max(), 1.0, *(part > breaks)])
            values.append(one[here].mean())
            weight.append(np.sqrt(np.count_nonzero(here)) / evidence.rise[k])
    weights = np.array(weight)
    design = np.array(rows, float) * weights[:, None]
    step = np.linalg.lstsq(design, np.array(values) * weights)[0][2:]
    none = np.zeros(len(x))
    modes = max((len(one.modes) for one in trends.values()), default=0)
    old = trends.get("offset", Trend(rate=none, course=none, modes=np.zeros((modes, len(x)))))
    course = step @ share["reference"]
    new = step[:, None] * share["reference"]
    more = step[:, None] * (share["injection"] - share["reference"])
    return {
        **trends,
        "offset": Trend(
            rate=old.rate,
            course=old.course + course - course.mean(),
            modes=np.concatenate([old.modes, new]),
            apart=np.concatenate([np.zeros_like(old.modes), more]),
        ),
    }


def _of_camera(evidence: Evidence) -> Trends:
    """Offset and gain, as if both went on from one background to the next."""
    way = _way(evidence)
    seen = signal(evidence)
    rates = _rates(evidence, {"offset": np.ones_like(way), "gain": seen}, beside=evidence.rise)
    for _ in range(_AGAIN):  # at the signals as they would be with the gain of the middle
        offset, gain = (rates.of(cause) for cause in ("offset", "gain"))
        still = (seen - offset * way) / (1.0 + gain * way)
        rates = _rates(evidence, {"offset": np.ones_like(way), "gain": still}, beside=evidence.rise)
    one = np.ones_like(way)
    return {
        cause: Trend(
            rate=rates.of(cause) * one,
            course=rates.of(cause) * way,
            modes=rates.roots[number][:, None] * way,
        )
        for number, cause in enumerate(rates.causes)
    }


def _of_blackbody(evidence: Evidence) -> Trends:
    """Offset, and a black body that starts anew before each background."""
    way, rise = _way(evidence), evidence.rise
    since = np.array([places.since.mean() for places in evidence.places["reference"]])
    rates = _rates(evidence, {"offset": np.ones_like(way), "black body": rise})
    found: dict[Cause, Trend] = {}
    for cause in rates.causes:
        shape, course = (rise, rise * since) if cause == "black body" else (np.ones_like(way), way)
        alone = np.zeros((len(rates.causes), 1))  # its start says nothing of the camera's drift
        alone[rates.causes.index(cause)] = np.sqrt(rates.moment(cause))
        found[cause] = Trend(
            rate=rates.of(cause) * shape, course=rates.of(cause) * course, modes=alone * course
        )
    return found


def _way(evidence: Evidence) -> Floats:
    """(K,) where the middle of the references lies on the drift's axis."""
    middle = np.array([places.at.mean() for places in evidence.places["reference"]])
    return np.asarray(middle - middle.mean())


def signal(evidence: Evidence) -> Floats:
    """(K,) mean of the references over all blocks."""
    return np.asarray(evidence.mean("reference").mean(axis=1))


def unit(evidence: Evidence, cause: Cause) -> Floats:
    """(K,) by what an error of 1 moves the references; a black body's is one of radiance.

    Args:
        evidence: of K backgrounds.
        cause: of the error.

    Returns:
        (K,) radiance; of the gain, the references' signal.
    """
    seen = signal(evidence)
    return seen if cause == "gain" else np.ones_like(seen)


@dataclass(frozen=True)
class _Rates:
    """Rates (N,) that are no chance, an interval, and their covariance (N, N)."""

    causes: tuple[Cause, ...]
    best: Floats
    covariance: Floats

    def of(self, cause: Cause) -> float:
        return float(self.best[self.causes.index(cause)]) if cause in self.causes else 0.0

    def moment(self, cause: Cause) -> float:
        at = self.causes.index(cause)
        return float(self.best[at] ** 2 + self.covariance[at, at])

    @property
    def roots(self) -> Floats:
        """(N, N) L with L L' the second moment about zero; the first column is largest."""
        size = np.sqrt(self.best**2 + np.diag(self.covariance))
        moment = np.outer(self.best, self.best) + self.covariance
        values, vectors = np.linalg.eigh(moment / np.outer(size, size))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return np.asarray(size[:, None] * root[:, ::-1])


def _rates(
    evidence: Evidence, columns: Mapping[Cause, Floats], *, beside: Floats | None = None
) -> _Rates:
    """Change of the references' mean an interval, in proportion to `columns`, (K,) each.

    What may be chance is left out, and the others are found without it. Those that remain are found
    once more beside another change, in proportion to `beside`, where there are backgrounds enough.
    """
    every = np.ones(evidence.blocks, bool)
    series = evidence.picture("reference", every)
    variance = evidence.variance("reference", every) * evidence.number("reference")
    rate, weight = np.zeros(len(series)), np.zeros(len(series))
    for k, (places, one) in enumerate(zip(evidence.places["reference"], series, strict=True)):
        away = places.away(places.at)
        if len(one) - places.parts > 1:
            rate[k] = away @ one / (away @ away)
            weight[k] = (away @ away) / variance[k]
    least = sure(evidence.degrees("reference"))
    causes = list(columns)
    while causes:
        best, covariance = _weighted([columns[cause] for cause in causes], rate, weight)
        told = np.abs(best) / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        if told.min() > least:
            if beside is not None and np.count_nonzero(weight) > len(causes):
                some = [*(columns[cause] for cause in causes), beside]
                best, covariance = _weighted(some, rate, weight)
            n = len(causes)
            return _Rates(tuple(causes), best[:n], covariance[:n, :n])
        del causes[int(np.argmin(told))]
    return _Rates((), np.zeros(0), np.zeros((0, 0)))


def _weighted(columns: Sequence[Floats], values: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Weighted least squares of `values` (K,) by `columns`: amounts, and their covariance."""
    size = np.array([np.max(np.abs(one)) for one in columns])
    design = np.stack(columns, axis=1) / size
    half = np.sqrt(weight / max(float(weight.max()), 1e-300))
    inverse = np.linalg.pinv(design * half[:, None])
    covariance = inverse @ inverse.T / max(float(weight.max()), 1e-300)
    return inverse @ (half * values) / size, covariance / np.outer(size, size)


def without(evidence: Evidence, trends: Trends, *, fitted: bool = False) -> Evidence:
    """The evidence without steady drifts.

    Args:
        evidence: of K backgrounds.
        trends: the drifts. That of the black body is the same before all backgrounds, and stays.
        fitted: all as much larger or smaller as suits the references' line best.
    """
    trends = {cause: one for cause, one in trends.items() if cause != "black body"}
    if not trends:
        return evidence
    amount = 1.0
    if fitted:
        still = without(evidence, trends)
        x, rise = evidence.source["reference"], evidence.rise
        design = np.stack([x / x.max(), np.ones_like(x)], axis=1) / rise[:, None]
        keep = np.eye(len(x)) - design @ np.linalg.pinv(design)
        whole = np.sum([one.course * unit(still, cause) for cause, one in trends.items()], axis=0)
        column, seen = keep @ (whole / rise), keep @ (signal(evidence) / rise)
        amount = float(np.clip(column @ seen / (column @ column), 1.0 - _NEAR, 1.0 + _NEAR))
    shots = {kind: list(parts) for kind, parts in evidence.shots.items()}
    for cause, one in trends.items():
        for parts in shots.values():
            for k, part in enumerate(parts):
                here = amount * one.course[k]
                parts[k] = part / (1.0 + here) if cause == "gain" else part - here
    return replace(evidence, shots={kind: tuple(parts) for kind, parts in shots.items()})
