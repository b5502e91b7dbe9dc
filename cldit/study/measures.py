"""Numbers from maps: means over parts of the spray, differences between two maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Image, Mask
from cldit.comparison.regions import Spray2D
from cldit.run import Run
from cldit.scene.sizes import Monodisperse, NukiyamaTanasawa
from cldit.spray.result import Spray

_PRESENT = 0.02  # smallest share of the light of a pixel that makes a phase visible in it
# Largest share of droplets in what a ray loses and emits, where it sees vapour only: with as much
# light of walls, 0 to 570 K, vapour of 520 K changes by 0.6 K.
_ABSENT = 0.005
_SOME = 20  # pixels of a mean, at least


def named(sizes: NukiyamaTanasawa | Monodisperse) -> str:
    """Name of a droplet size distribution."""
    if isinstance(sizes, Monodisperse):
        return f"all {sizes.diameter_um:g} µm"
    return f"m {sizes.m_um:g} µm, n {sizes.n:.3g}, p {sizes.p:g}"


def spray_of(run: Run) -> Spray2D:
    """Pixels of the run's maps with their positions and regions."""
    x, _, z = run.scene.target_m
    return Spray2D.of(run.maps, pixel_m=run.pixel_m, centre_m=(x, z))


def visible(run: Run) -> Mask:
    """Pixels with an apparent temperature and an emissivity above 0.05."""
    return spray_of(run).visible


def root(run: Run) -> Mask:
    """Visible spray 1 to 8 mm below the injector tip."""
    return spray_of(run).root


def rim(run: Run) -> Mask:
    """Visible spray (H, W) around the plumes, of an emissivity up to 0.3."""
    return spray_of(run).regions["halo"]


def tips(run: Run) -> Mask:
    """Visible spray (H, W) beyond 85 % of its reach."""
    return spray_of(run).tips()


def _scattered(run: Run) -> Image:
    """Weight (H, W) of the walls that the spray adds: droplets scatter, vapour does not."""
    wall = run.weights.wall
    return np.asarray(wall - np.minimum(run.reference.wall, wall))


def both_phases(run: Run) -> Mask:
    """Pixels (H, W) of the visible spray with light of droplets and of vapour."""
    weights = run.weights
    emitted = np.maximum(weights.vapour + weights.liquid, 1e-30)
    wet = (_scattered(run) > _PRESENT) & (weights.vapour > _PRESENT * emitted)
    return np.asarray(visible(run) & wet)


def vapour_only(run: Run) -> Mask:
    """Pixels (H, W) of the visible spray that see vapour and no droplets."""
    weights = run.weights
    emitted = weights.vapour + weights.liquid
    extinct = 1.0 - weights.background / np.maximum(run.reference.background, 1e-6)
    dry = (_scattered(run) < _ABSENT * extinct) & (weights.liquid < _ABSENT * emitted)
    return np.asarray(visible(run) & dry)


def mean_K(run: Run, where: Mask) -> float:
    """Mean T_app over pixels `where` (H, W), weighted by emissivity; NaN over fewer than 20."""
    chosen = where & np.isfinite(run.maps.apparent_temperature_K)
    if np.count_nonzero(chosen) < _SOME:
        return float("nan")
    return float(
        np.average(
            run.maps.apparent_temperature_K[chosen].astype(float),
            weights=run.maps.emissivity[chosen].astype(float),
        )
    )


def mean_emissivity(run: Run, where: Mask) -> float:
    """Mean emissivity of `run` over the pixels `where` (H, W); NaN over none."""
    chosen = where & np.isfinite(run.maps.emissivity)
    return float(np.mean(run.maps.emissivity[chosen])) if chosen.any() else float("nan")


@dataclass(frozen=True)
class Change:
    """T_app of one run minus that of another, (H, W); NaN if not visible in both."""

    image: NDArray[np.float32]

    @classmethod
    def of(cls, run: Run, reference: Run) -> Change:
        """Difference of T_app from `other` to `run`."""
        in_both = visible(run) & visible(reference)
        change = run.maps.apparent_temperature_K - reference.maps.apparent_temperature_K
        return cls(np.where(in_both, change, np.float32(np.nan)))

    def within(self, where: Mask | None = None) -> Floats:
        """(N,) changes in the pixels `where` (H, W); NaN alone if there are fewer than 20."""
        chosen = np.isfinite(self.image) if where is None else np.isfinite(self.image) & where
        values = self.image[chosen].astype(float)
        return values if len(values) >= _SOME else np.array([np.nan])

    def rms(self, where: Mask | None = None) -> float:
        """RMS over the pixels `where` (H, W)."""
        return float(np.sqrt(np.mean(self.within(where) ** 2)))

    def mean(self, where: Mask | None = None) -> float:
        """Mean over the pixels `where` (H, W)."""
        return float(np.mean(self.within(where)))

    def largest(self, where: Mask | None = None, *, share: float = 99.0) -> float:
        """Percentile `share` of the magnitude in the pixels `where` (H, W)."""
        return float(np.percentile(np.abs(self.within(where)), share))


def droplets_K(spray: Spray, *, within_m: float | None = None) -> float:
    """Mean droplet temperature of a spray by mass, of all or those `within_m` of the tip."""
    parcels = spray.parcels
    if parcels is None or not len(parcels.diameter_m):
        return float("nan")
    mass = parcels.masses_kg
    if within_m is not None:
        mass = mass * (np.linalg.norm(parcels.position_m, axis=1) < within_m)
    return float(np.average(parcels.temperature_K, weights=mass)) if mass.any() else float("nan")
