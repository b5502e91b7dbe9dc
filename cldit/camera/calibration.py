"""Calibration of a camera: counts to radiance, and the variance of counts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.errors import EvaluationError, SceneError
from cldit.optics.response import Filter, edges_um, from_plain, to_plain


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A linear camera: counts = offset + counts_per_radiance * L, up to `saturation_counts`.

    filter_um: lower and upper wavelength, or the response, in which L is defined.
    counts_per_radiance: counts per photon s-1 m-2 sr-1.
    saturation_counts: counts from which a pixel is saturated. step_counts: to which images are
    rounded; 0 for values that are not rounded.
    """

    filter_um: Filter
    counts_per_radiance: float
    offset_counts: float
    electrons_per_count: float
    read_noise_electrons: float
    saturation_counts: float
    step_counts: float = 1.0

    def __post_init__(self) -> None:
        try:
            edges_um(self.filter_um)
        except SceneError as error:
            raise EvaluationError(f"calibration.{error}") from error
        for name, zero in (
            ("counts_per_radiance", False),
            ("electrons_per_count", False),
            ("read_noise_electrons", True),
            ("saturation_counts", False),
            ("step_counts", True),
        ):
            value = getattr(self, name)
            if not (0.0 <= value < math.inf) or (value == 0.0 and not zero):
                raise EvaluationError(
                    f"calibration.{name}: {value:g}; allowed: a number "
                    f"{'from' if zero else 'above'} 0"
                )
        if not math.isfinite(self.offset_counts):
            raise EvaluationError(f"calibration.offset_counts: {self.offset_counts:g}")

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `from_dict` reads it."""
        plain = {item.name: getattr(self, item.name) for item in fields(self)}
        return {**plain, "filter_um": to_plain(self.filter_um)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Calibration":
        """Reads the result of `to_dict`."""
        names = {item.name for item in fields(cls)}
        missing = sorted(names - set(data) - {"step_counts"})
        if missing:
            raise EvaluationError(f"calibration: {', '.join(missing)} missing")
        try:
            filter_um = from_plain(data["filter_um"])
            numbers = {name: float(data[name]) for name in (names & set(data)) - {"filter_um"}}
            return cls(filter_um=filter_um, **numbers)
        except (TypeError, ValueError) as error:
            if isinstance(error, EvaluationError):
                raise
            raise EvaluationError(f"calibration: {error}") from error

    def radiance(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Radiance, photons s-1 m-2 sr-1, that gives these counts; any shape."""
        return (np.asarray(counts, np.float64) - self.offset_counts) / self.counts_per_radiance

    def counts(self, radiance: ArrayLike) -> NDArray[np.float64]:
        """Mean counts of these radiances, without rounding or saturation; any shape."""
        return self.offset_counts + np.asarray(radiance, np.float64) * self.counts_per_radiance

    def variance_counts2(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Variance of one exposure of mean `counts`, any shape: shot, read and rounding.

        Electrons follow a Poisson distribution, whose variance is its mean.
        """
        over = np.asarray(counts, np.float64) - self.offset_counts
        electrons = np.maximum(over, 0.0) * self.electrons_per_count
        read = self.read_noise_electrons**2
        rounding = self.step_counts**2 / 12.0
        return np.asarray((electrons + read) / self.electrons_per_count**2 + rounding)
