"""Numbers from maps: means over parts of the spray, differences between two maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.run import Run
from cldit.spray.result import Spray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROOT_M = (1e-3, 8e-3)  # below the tip, where the plumes overlap and are hardly heated
_SCATTERED = 0.02  # smallest weight of the walls with droplets
_ABSORBED = 0.02  # smallest share of a phase in the light of a pixel
_SOME = 20  # pixels of a mean, at least


def positions_m(run: Run) -> tuple[Floats, Floats]:
    """Coordinates x and z (H, W) of the pixels in the plane of the target."""
    height, width = run.maps.emissivity.shape
    x, _, z = run.scene.target_m
    pixel_x, pixel_z = run.pixel_m
    across = x + (np.arange(width) - (width - 1) / 2) * pixel_x
    up = z - (np.arange(height) - (height - 1) / 2) * pixel_z
    x_m, z_m = np.meshgrid(across, up)
    return x_m, z_m


def visible(run: Run) -> Mask:
    """Pixels with an apparent temperature and an emissivity above 0.05."""
    known = np.isfinite(run.maps.apparent_temperature_K)
    return np.asarray(known & (run.maps.emissivity > VISIBLE_EMISSIVITY))


def root(run: Run) -> Mask:
    """Visible spray 1 to 8 mm below the injector tip."""
    _, z = positions_m(run)
    return np.asarray(visible(run) & (z < -_ROOT_M[0]) & (z > -_ROOT_M[1]))


def reach_m(run: Run) -> float:
    """Distance from the injector that contains 97 % of the visible spray, by emissivity."""
    x, z = positions_m(run)
    seen = visible(run)
    if not seen.any():
        return float("nan")
    far, weight = np.hypot(x, z)[seen], run.maps.emissivity[seen].astype(float)
    order = np.argsort(far)
    return float(far[order][np.searchsorted(np.cumsum(weight[order]) / weight.sum(), 0.97)])


def tips(run: Run, share: float = 0.85) -> Mask:
    """Visible spray (H, W) beyond `share` of its reach, which single droplets do not determine."""
    x, z = positions_m(run)
    return np.asarray(visible(run) & (np.hypot(x, z) > share * reach_m(run)))


@dataclass(frozen=True)
class Phases:
    """Pixels that see droplets and vapour together, or vapour alone."""

    both: Mask
    vapour_only: Mask

    @classmethod
    def of(cls, run: Run) -> Phases:
        """Phases by the weights: droplets scatter light of the walls, vapour does not."""
        weights, seen = run.weights, visible(run)
        before = np.maximum(run.reference.background, 1e-6)
        extinct = 1.0 - weights.background / before
        scattered = weights.wall - np.minimum(run.reference.wall, weights.wall)
        emitted = np.maximum(weights.vapour + weights.liquid, 1e-30)
        dry = (scattered < 1e-3) & (weights.liquid < 1e-3 * emitted) & (extinct > 0)
        wet = (scattered > _SCATTERED) & (weights.vapour > _ABSORBED * emitted)
        return cls(both=np.asarray(seen & wet), vapour_only=np.asarray(seen & dry))


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
    def of(cls, run: Run, other: Run) -> Change:
        """Difference of T_app from `other` to `run`."""
        here = visible(run) & visible(other)
        change = run.maps.apparent_temperature_K - other.maps.apparent_temperature_K
        return cls(np.where(here, change, np.float32(np.nan)))

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
    mass = parcels.droplets * parcels.density_kg_m3 * parcels.diameter_m**3
    if within_m is not None:
        mass = mass * (np.linalg.norm(parcels.position_m, axis=1) < within_m)
    return float(np.average(parcels.temperature_K, weights=mass)) if mass.any() else float("nan")
