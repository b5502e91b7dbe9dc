"""Stated and true error of T_app."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.radiance.weights import Weights, compose
from cldit.run import Run
from cldit.scene import Scene

_LEAST = 0.5  # of the true error, which is to be stated
_ROUNDING_K = 1e-4  # 400 K in float32, and weights that are sums of many


@dataclass(frozen=True)
class Stated:
    """Stated and true RMS error of T_app.

    known_K: sum of the known error sources; None if there is none. text: the same in words. true_K:
    over the pixels that have a T_app; None without any. doubt_K: standard error of the truth.
    """

    known_K: float | None
    text: str
    true_K: float | None
    doubt_K: float = 0.0

    @classmethod
    def of(cls, run: Run, truth_K: tuple[Floats, Floats]) -> Stated:
        """Comparison of a run with the truth.

        Args:
            run: with its error measured.
            truth_K: T_app (H, W) of two independent estimates a and b, equal if the truth has no
                noise, which cancels in the mean of (x - a)(x - b).
        """
        known_K = None if run.errors is None else run.errors.total_K
        text = "unknown" if run.errors is None else run.errors.text
        one, other = truth_K
        counted = run.maps.has_temperature & np.isfinite(one + other)
        if not counted.any():
            return cls(known_K, text, None)
        mine = run.maps.apparent_temperature_K.astype(float)
        square = float(np.mean(((mine - one) * (mine - other))[counted]))
        doubt = float(np.sqrt(np.mean((one - other)[counted] ** 2))) / 2
        return cls(known_K, text, float(np.sqrt(max(square, 0.0))), doubt)

    @property
    def holds(self) -> bool:
        """True if at least half of the true error is stated; without T_app, none."""
        if self.true_K is None or self.known_K is None:
            return self.true_K is None and self.known_K is None
        return self.known_K >= _LEAST * (self.true_K - self.doubt_K - _ROUNDING_K)

    @property
    def true(self) -> str:
        """True error for a table; bold if too little is stated."""
        if self.true_K is None:
            return "no T_app"
        text = f"{self.true_K:.2g} K"
        if self.doubt_K > 0.1 * self.true_K:
            text += f" (± {self.doubt_K:.1g} K)"
        return text if self.holds else f"**{text}**"

    @property
    def ratio(self) -> str:
        """Stated over true for a table."""
        if not self.true_K or self.known_K is None:
            return "-"
        return f"{self.known_K / self.true_K:.2g}"


def apparent_K(weights: Weights, scene: Scene) -> Floats:
    """T_app (H, W) from the weights of a scene of one wavelength without patches; NaN or infinite
    where nothing is in the line of sight."""
    filter_um = scene_filter(scene)
    wall = float(band_radiance(scene.walls.temperature_K, filter_um=filter_um))
    added = compose(weights, background=0.0, wall=wall)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = added / (1.0 - weights.background.astype(float))
    return temperature_of_radiance(own, filter_um=filter_um)
