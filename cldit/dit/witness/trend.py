"""Steady drift: change of references from shot to shot, and its effect on their means.

The rates at K backgrounds, r_k = offset + gain S_k with the signal S_k, are fitted by weighted
least squares, which gives the two rates m and their covariance C. The error of the means has the
same course, with the second moment m m' + C about zero, which is added to the covariance of the
lines' fit (`cldit.dit.fit`, steady errors): m is one random number of variance 1 for offset and
gain together, C the uncertainty of the rates.

A drift of the black body resembles one of the gain. Its rate, proportional to the radiance per
kelvin, is fitted too, so that C includes the ambiguity.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from cldit.arrays import Floats
from cldit.dit.chance import sure
from cldit.dit.solve import GAIN_ITERATIONS, Cause, Drift
from cldit.dit.witness.backgrounds import squares
from cldit.dit.witness.evidence import Evidence

_NEAR = 0.5  # largest relative deviation of a course from that of the rates
_NAMES = {
    "black body": "black body",
    "offset": "offset of the camera",
    "gain": "gain of the camera",
    "curvature": "non-linearity of the camera",
}


Trends = Mapping[Cause, Drift]


def steady(evidence: Evidence, *, beyond: bool, steps: bool = True) -> Trends:
    """Steady drifts, with the same course at all backgrounds.

    A drift of the black body restarts at each background. It is chosen in place of a gain if the
    references are then nearer to their line.

    beyond: True if references deviate from their line. steps: True if the camera's offset changes
    at breaks.
    """
    camera = _of_camera(evidence)
    if len(evidence.setpoints) == 2:  # a line would always fit
        return camera
    blackbody = _of_blackbody(evidence)
    if steps:
        camera, blackbody = (_with_steps(evidence, trends) for trends in (camera, blackbody))
    if not beyond:
        return blackbody
    x, rise = evidence.source["reference"], evidence.rise
    sums = [squares(x, signal(without(evidence, trends)), rise) for trends in (camera, blackbody)]
    return camera if sums[0] < sums[1] else blackbody


def _with_steps(evidence: Evidence, trends: Trends) -> Trends:
    """Trends with a step of the offset at each break, from the references' line.

    One line is fitted over all parts; a background with a break inside determines the step itself.
    """
    if not evidence.breaks:
        return trends
    first_part = min(int(places.part.min()) for places in evidence.places["reference"])
    breaks = first_part + np.arange(evidence.breaks)
    share = {  # (breaks, K) of a kind's shots that are after each
        kind: np.stack([(p.part[:, None] > breaks).mean(axis=0) for p in places], axis=1)
        for kind, places in evidence.places.items()
    }
    still = without(evidence, trends)
    x, all_blocks = evidence.source["reference"], np.ones(evidence.blocks, bool)
    rows, values, weight = [], [], []
    for k, (places, series) in enumerate(
        zip(evidence.places["reference"], still.series("reference", all_blocks), strict=True)
    ):
        rate = sum((trend.rate[k] * unit(still, of)[k] for of, trend in trends.items()), 0.0)
        series = series - rate * (places.at - places.at.mean())
        for part in np.unique(places.part):
            in_part = places.part == part
            rows.append([x[k] / x.max(), 1.0, *(part > breaks)])
            values.append(series[in_part].mean())
            weight.append(np.sqrt(np.count_nonzero(in_part)) / evidence.rise[k])
    weights = np.array(weight)
    design = np.array(rows, float) * weights[:, None]
    step = np.linalg.lstsq(design, np.array(values) * weights)[0][2:]
    modes = max((len(trend.modes) for trend in trends.values()), default=0)
    old = trends.get("offset", Drift(cause="offset", modes=np.zeros((modes, len(x)))))
    course = step @ share["reference"]
    new = step[:, None] * share["reference"]
    excess = step[:, None] * (share["injection"] - share["reference"])
    return {
        **trends,
        "offset": Drift(
            cause="offset",
            rate=old.rate,
            course=old.course + course - course.mean(),
            modes=np.concatenate([old.modes, new]),
            excess=np.concatenate([np.zeros_like(old.modes), excess]),
        ),
    }


def _of_camera(evidence: Evidence) -> Trends:
    """Drift of offset and gain that continues from one background to the next."""
    way = _way(evidence)
    seen, ones = signal(evidence), np.ones_like(way)
    rates, covariance = _rates(evidence, {"offset": ones, "gain": seen}, beside=evidence.rise)
    for _ in range(GAIN_ITERATIONS):  # at the signals for the gain at mid-course
        still = (seen - rates.get("offset", 0.0) * way) / (1.0 + rates.get("gain", 0.0) * way)
        rates, covariance = _rates(evidence, {"offset": ones, "gain": still}, beside=evidence.rise)
    roots = _roots(np.array(list(rates.values())), covariance)
    return {
        cause: Drift(cause=cause, rate=rate * ones, course=rate * way, modes=root[:, None] * way)
        for (cause, rate), root in zip(rates.items(), roots, strict=True)
    }


def _of_blackbody(evidence: Evidence) -> Trends:
    """Drift of the offset, and of a black body that restarts at each background."""
    way, rise = _way(evidence), evidence.rise
    since = np.array([places.since.mean() for places in evidence.places["reference"]])
    rates, covariance = _rates(evidence, {"offset": np.ones_like(way), "black body": rise})
    trends: dict[Cause, Drift] = {}
    for at, (cause, rate) in enumerate(rates.items()):
        shape, course = (rise, rise * since) if cause == "black body" else (np.ones_like(way), way)
        mode = np.zeros((len(rates), 1))  # independent of the camera's drift
        mode[at] = np.sqrt(rate**2 + covariance[at, at])
        trends[cause] = Drift(
            cause=cause, rate=rate * shape, course=rate * course, modes=mode * course
        )
    return trends


def _way(evidence: Evidence) -> Floats:
    """Mean position (K,) of the references on the drift's axis."""
    middle = np.array([places.at.mean() for places in evidence.places["reference"]])
    return np.asarray(middle - middle.mean())


def signal(evidence: Evidence) -> Floats:
    """Mean (K,) of the references over all blocks."""
    return np.asarray(evidence.mean("reference").mean(axis=1))


def unit(evidence: Evidence, cause: Cause) -> Floats:
    """Change (K,) of the references by an error of 1: radiance, or for the gain their signal."""
    seen = signal(evidence)
    return seen if cause == "gain" else np.ones_like(seen)


def _roots(rate: Floats, covariance: Floats) -> Floats:
    """Root L (N, N) of the second moment about zero, L L'; the first column is largest."""
    size = np.sqrt(rate**2 + np.diag(covariance))
    moment = np.outer(rate, rate) + covariance
    values, vectors = np.linalg.eigh(moment / np.outer(size, size))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(size[:, None] * root[:, ::-1])


def _rates(
    evidence: Evidence, columns: Mapping[Cause, Floats], *, beside: Floats | None = None
) -> tuple[dict[Cause, float], Floats]:
    """Change of the references' mean per interval, proportional to `columns`, (K,) each, and the
    covariance (N, N) of the N significant rates.

    Insignificant rates are removed one by one. The remaining ones are fitted again together with a
    change proportional to `beside`, if there are enough backgrounds.
    """
    all_blocks = np.ones(evidence.blocks, bool)
    series = evidence.series("reference", all_blocks)
    variance = evidence.variance("reference", all_blocks) * evidence.number("reference")
    rate, weight = np.zeros(len(series)), np.zeros(len(series))
    for k, (places, values) in enumerate(zip(evidence.places["reference"], series, strict=True)):
        centred = places.about_part_means(places.at)
        if len(values) - places.parts > 1:
            rate[k] = centred @ values / (centred @ centred)
            weight[k] = (centred @ centred) / variance[k]
    threshold = sure(evidence.degrees("reference"))
    causes = list(columns)
    while causes:
        best, covariance = _weighted([columns[cause] for cause in causes], rate, weight)
        significance = np.abs(best) / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        if significance.min() > threshold:
            if beside is not None and np.count_nonzero(weight) > len(causes):
                all_columns = [*(columns[cause] for cause in causes), beside]
                best, covariance = _weighted(all_columns, rate, weight)
            n = len(causes)
            return dict(zip(causes, best[:n].tolist(), strict=True)), covariance[:n, :n]
        del causes[int(np.argmin(significance))]
    return {}, np.zeros((0, 0))


def _weighted(columns: Sequence[Floats], values: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Weighted least squares of `values` (K,) by `columns`: amounts, and their covariance."""
    size = np.array([np.max(np.abs(column)) for column in columns])
    design = np.stack(columns, axis=1) / size
    half = np.sqrt(weight / max(float(weight.max()), 1e-300))
    inverse = np.linalg.pinv(design * half[:, None])
    covariance = inverse @ inverse.T / max(float(weight.max()), 1e-300)
    return inverse @ (half * values) / size, covariance / np.outer(size, size)


def without(evidence: Evidence, trends: Trends, *, fitted: bool = False) -> Evidence:
    """The evidence without steady drifts, except that of the black body, equal at all backgrounds.

    With `fitted` the drifts are scaled by a common factor for the best line of the references.
    """
    trends = {cause: trend for cause, trend in trends.items() if cause != "black body"}
    if not trends:
        return evidence
    amount = 1.0
    if fitted:
        still = without(evidence, trends)
        x, rise = evidence.source["reference"], evidence.rise
        design = np.stack([x / x.max(), np.ones_like(x)], axis=1) / rise[:, None]
        keep = np.eye(len(x)) - design @ np.linalg.pinv(design)
        course = np.sum(
            [trend.course * unit(still, cause) for cause, trend in trends.items()], axis=0
        )
        column, seen = keep @ (course / rise), keep @ (signal(evidence) / rise)
        amount = float(np.clip(column @ seen / (column @ column), 1.0 - _NEAR, 1.0 + _NEAR))
    shots = {kind: list(parts) for kind, parts in evidence.shots.items()}
    for cause, trend in trends.items():
        for parts in shots.values():
            for k, part in enumerate(parts):
                change = amount * trend.course[k]
                parts[k] = part / (1.0 + change) if cause == "gain" else part - change
    return replace(evidence, shots={kind: tuple(parts) for kind, parts in shots.items()})


@dataclass(frozen=True, kw_only=True)
class DriftTerm:
    """One term of the covariance that references and injections share.

    name: cause and kind. setpoints, kelvin: by background; a steady drift has a sign, the others
    are standard deviations.
    """

    name: str
    setpoints: tuple[float, ...]
    kelvin: tuple[float, ...]

    def to_dict(self) -> dict[str, object]:
        """Plain data."""
        return asdict(self)


def terms(
    evidence: Evidence, *, stated: Sequence[Drift], estimated: Sequence[Drift]
) -> tuple[DriftTerm, ...]:
    """Terms above 0: those stated by the user or by readings, then those found."""
    listed: list[tuple[str, Floats]] = []
    for origin, drifts in (("stated, or by readings", stated), ("found", estimated)):
        for drift in drifts:
            per_kelvin = unit(evidence, drift.cause) / evidence.rise
            name = _NAMES[drift.cause]
            listed += [
                (f"{name}, steady drift", drift.course * per_kelvin),
                (f"{name}, at each background ({origin})", np.sqrt(drift.variance) * per_kelvin),
            ]
    return tuple(
        DriftTerm(name=name, setpoints=evidence.setpoints, kelvin=tuple(kelvin.tolist()))
        for name, kelvin in listed
        if kelvin.any()
    )
