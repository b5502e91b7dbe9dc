"""Recorded shots: what the evaluation asks of them, and their sums before each background."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.dit.drift_axis import Place
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings

Floats = NDArray[np.float64]


class Shot(Protocol):
    """One recorded picture. `time_s` and `stable_s` may be there too (`cldit.dit.drift_axis`)."""

    @property
    def id(self) -> str:
        """Names the shot."""

    @property
    def kind(self) -> str:
        """`reference` or `injection`."""
        ...

    @property
    def background_setpoint_K(self) -> float:
        """The background that was asked for; shots of one set point are averaged."""
        ...

    @property
    def background_K(self) -> float:
        """The background as measured."""
        ...


class Acquisition(Protocol):
    """What the evaluation asks of recorded data. `shots` are those that were recorded."""

    @property
    def calibration(self) -> Mapping[str, Any]:
        """The camera's, as plain data."""

    @property
    def surroundings(self) -> Surroundings:
        """What the camera sees beside the spray."""

    @property
    def bad_pixels(self) -> NDArray[np.bool_] | None:
        """(rows, columns) True where a pixel is not used; None where all are."""

    @property
    def shots(self) -> Sequence[Any]:
        """`Shot` each."""
        ...

    def load(self, shot: Any) -> NDArray[Any]:
        """(rows, columns) counts of one shot."""
        ...


@dataclass
class Sums:
    """Sums of the pictures (h, w) of one kind before one background.

    total, squares, course: (h, w) weighted sums of counts, of their squares, and of counts times
    the shot's place, that of the first taken as 0. largest: (h, w) of any exposure.
    Lists hold an entry a shot: digests of the pictures' bytes, places on the drift's axis.
    """

    temperatures_K: list[float]
    total: Floats
    squares: Floats
    course: Floats
    largest: NDArray[np.float32]
    saturation_counts: float
    weights: list[float]
    thumbnails: list[NDArray[np.float32]]
    ids: list[str]
    digests: list[bytes]
    places: list[Place]

    @classmethod
    def empty(cls, shape: tuple[int, ...], saturation_counts: float) -> Sums:
        """No shots yet, of pictures of this `shape`, full at and above `saturation_counts`."""
        zero = np.zeros(shape)
        low = np.full(shape, -np.inf, np.float32)
        return cls([], zero, zero.copy(), zero.copy(), low, saturation_counts, [], [], [], [], [])

    @property
    def full(self) -> NDArray[np.bool_]:
        """(h, w) where at least one exposure was saturated."""
        return np.asarray(self.largest >= self.saturation_counts)

    def add(self, image: NDArray[Any], shot: Shot, *, place: Place) -> None:
        """Counts one picture in full.

        Args:
            image: (h, w) counts.
            shot: whose picture it is.
            place: of the shot on the drift's axis.
        """
        self.places.append(place)
        counts = self._weigh(image, 1.0, place)
        np.maximum(self.largest, image, out=self.largest, casting="unsafe")
        self.digests.append(blake2b(np.ascontiguousarray(image).data, digest_size=16).digest())
        self.temperatures_K.append(shot.background_K)
        self.weights.append(1.0)
        self.thumbnails.append(thumbnail(counts))
        self.ids.append(shot.id)

    def reweigh(self, image: NDArray[Any], number: int, weight: float) -> None:
        """Counts a picture, already added, with another weight.

        Args:
            image: (h, w) counts.
            number: of the picture, in the order of adding.
            weight: the new one.
        """
        self._weigh(image, weight - self.weights[number], self.places[number])
        self.weights[number] = weight

    def _weigh(self, image: NDArray[Any], weight: float, place: Place) -> Floats:
        counts = image.astype(np.float64)
        if way := weight * (place.at - self.places[0].at):
            self.course += way * counts
        self.total += counts if weight == 1.0 else weight * counts
        self.squares += counts**2 if weight == 1.0 else weight * counts**2
        return counts

    @property
    def exposures(self) -> float:
        """How many equal exposures tell as much: (sum w)^2 / sum w^2; repeats count as one."""
        weights: dict[bytes, float] = {}
        for digest, weight in zip(self.digests, self.weights, strict=True):
            weights[digest] = weights.get(digest, 0.0) + weight
        each = np.array(list(weights.values()))
        return float(each.sum() ** 2 / np.sum(each**2))

    @property
    def temperature_K(self) -> float:
        """Weighted mean of the background's temperature [K]."""
        return float(np.average(self.temperatures_K, weights=self.weights))

    @property
    def temperature_variance_K2(self) -> float:
        """Variance of the mean reading, from how the readings scatter; 0 of one exposure."""
        if len(self.temperatures_K) < 2:
            return 0.0
        return float(np.var(self.temperatures_K, ddof=1) / len(self.temperatures_K))

    def mean(self, rows: slice) -> Floats:
        """Weighted mean (R, w) of the counts in `rows`."""
        return np.asarray(self.total[rows] / np.sum(self.weights))

    def variance(self, rows: slice, *, steady: bool = False) -> Floats:
        """Sample variance of one exposure; 0 of a single one.

        Args:
            rows: which.
            steady: about each pixel's straight line over the shots' places: a steady drift is no
                scatter.

        Returns:
            (R, w) counts^2.
        """
        weights = np.array(self.weights)
        if not self.spare(steady=steady) > 0.0:
            return np.zeros_like(self.total[rows])
        spread = self.squares[rows] - self.total[rows] ** 2 / weights.sum()
        if steady:
            places = np.array([place.at for place in self.places]) - self.places[0].at
            middle = float(np.average(places, weights=weights))
            along = self.course[rows] - middle * self.total[rows]
            spread = spread - along**2 / float(weights @ (places - middle) ** 2)
        return np.asarray(np.maximum(spread, 0.0) / self.spare(steady=steady))

    def spare(self, *, steady: bool = False) -> float:
        """Degrees of freedom of `variance`; 0 where there are none.

        Args:
            steady: as there.

        Returns:
            How many, by the shots' weights.
        """
        weights = np.array(self.weights)
        left = weights.sum() - np.sum(weights**2) / weights.sum()
        return max(float(left) - steady, 0.0) if len(weights) > 1 else 0.0


def thumbnail(counts: Floats) -> NDArray[np.float32]:
    """Means of `counts` (h, w) over blocks, at most 32 x 32 of them."""
    rows, columns = (
        np.unique(np.linspace(0, n, min(n, 32), endpoint=False).astype(int)) for n in counts.shape
    )
    total = np.add.reduceat(np.add.reduceat(counts, rows, axis=0), columns, axis=1)
    high, wide = (
        np.diff(np.append(edges, n)) for edges, n in zip((rows, columns), counts.shape, strict=True)
    )
    return np.asarray(total / (high[:, None] * wide), np.float32)


def check_shots(shots: Sequence[Shot]) -> list[float]:
    """Set points in rising order, each with references and injections.

    Raises:
        EvaluationError: shots of another kind, without a measured background, or missing.
    """
    for shot in shots:
        if shot.kind not in ("reference", "injection"):
            raise EvaluationError(
                f"shot {shot.id}: kind {shot.kind!r}; allowed: reference, injection"
            )
        if not (np.isfinite(shot.background_K) and shot.background_K >= 0):
            raise EvaluationError(
                f"shot {shot.id}: background at {shot.background_K:g} K was not measured"
            )
    setpoints = sorted({shot.background_setpoint_K for shot in shots})
    for setpoint in setpoints:
        kinds = [shot.kind for shot in shots if shot.background_setpoint_K == setpoint]
        for kind in ("reference", "injection"):
            if kind not in kinds:
                raise EvaluationError(
                    f"background {setpoint:g} K: no {kind} among its {len(kinds)} shots; resume "
                    "the acquisition, or leave this background out"
                )
    if len(setpoints) < 2:
        raise EvaluationError(
            f"backgrounds: {setpoints} K; the evaluation needs at least two different temperatures"
        )
    return setpoints


def accumulate(
    acquisition: Acquisition,
    saturation_counts: float,
    progress: Callable[[int, int], None] | None,
    *,
    places: Sequence[Place],
) -> dict[tuple[float, str], Sums]:
    """Reads every shot once, and sums by set point and kind.

    Args:
        acquisition: recorded shots.
        saturation_counts: at and above which a pixel is full.
        progress: called with (shots read, shots in all).
        places: of the shots on the drift's axis, in their order.

    Returns:
        Sums by set point [K] and kind.

    Raises:
        EvaluationError: a picture has another shape than the others, or is not finite.
    """
    sums: dict[tuple[float, str], Sums] = {}
    bad = acquisition.bad_pixels
    shape = None if bad is None else bad.shape
    for done, (shot, place) in enumerate(zip(acquisition.shots, places, strict=True), start=1):
        image = acquisition.load(shot)
        if image.ndim != 2 or image.size == 0 or (shape is not None and image.shape != shape):
            raise EvaluationError(
                f"shot {shot.id}: picture of shape {image.shape}, expected {shape}"
            )
        shape = image.shape
        if image.dtype.kind not in "uif":
            raise EvaluationError(f"shot {shot.id}: {image.dtype} are no counts")
        if image.dtype.kind == "f" and not np.all(np.isfinite(image)):
            broken = int(np.count_nonzero(~np.isfinite(image)))
            raise EvaluationError(
                f"shot {shot.id}: {broken} pixels are not finite; leave the shot out, or name the "
                "pixels as bad"
            )
        key = (shot.background_setpoint_K, shot.kind)
        if key not in sums:
            sums[key] = Sums.empty(shape, saturation_counts)
        sums[key].add(image, shot, place=place)
        if progress is not None:
            progress(done, len(acquisition.shots))
    return sums
