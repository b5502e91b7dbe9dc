"""Recorded shots: what the evaluation asks of them, and their sums before each background."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings

Floats = NDArray[np.float64]


class Shot(Protocol):
    """One recorded picture."""

    @property
    def id(self) -> str: ...
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
    def calibration(self) -> Mapping[str, Any]: ...
    @property
    def surroundings(self) -> Surroundings: ...
    @property
    def bad_pixels(self) -> NDArray[np.bool_] | None: ...
    @property
    def shots(self) -> Sequence[Any]:
        """`Shot` each."""
        ...

    def load(self, shot: Any) -> NDArray[Any]:
        """(rows, columns) counts of one shot."""
        ...


@dataclass
class Sums:
    """Of the counts of one kind before one background; exact, since counts are integers."""

    temperatures_K: list[float]
    total: Floats
    squares: Floats
    full: NDArray[np.bool_]  # at least one exposure was saturated

    def add(self, image: NDArray[Any], temperature_K: float, saturation_counts: float) -> None:
        counts = image.astype(np.float64)
        self.temperatures_K.append(temperature_K)
        self.total += counts
        self.squares += counts**2
        self.full |= counts >= saturation_counts

    @property
    def exposures(self) -> int:
        return len(self.temperatures_K)

    def mean(self, rows: slice) -> Floats:
        return self.total[rows] / self.exposures

    def variance(self, rows: slice) -> Floats:
        """Sample variance; 0 of one exposure."""
        if self.exposures < 2:
            return np.zeros_like(self.total[rows])
        spread = self.squares[rows] - self.total[rows] ** 2 / self.exposures
        return np.maximum(spread, 0.0) / (self.exposures - 1)


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
) -> dict[tuple[float, str], Sums]:
    """Reads every shot once, and sums by set point and kind.

    Raises:
        EvaluationError: the pictures differ in shape.
    """
    sums: dict[tuple[float, str], Sums] = {}
    bad = acquisition.bad_pixels
    shape = None if bad is None else bad.shape
    for done, shot in enumerate(acquisition.shots, start=1):
        image = acquisition.load(shot)
        if image.ndim != 2 or image.size == 0 or (shape is not None and image.shape != shape):
            raise EvaluationError(
                f"shot {shot.id}: picture of shape {image.shape}, expected {shape}"
            )
        shape = image.shape
        key = (shot.background_setpoint_K, shot.kind)
        if key not in sums:
            sums[key] = Sums([], np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=bool))
        sums[key].add(image, shot.background_K, saturation_counts)
        if progress is not None:
            progress(done, len(acquisition.shots))
    return sums
