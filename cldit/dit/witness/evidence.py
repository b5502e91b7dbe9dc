"""What the witnesses look at: means of blocks of pixels, shot by shot, as radiance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.camera.calibration import Calibration
from cldit.dit.shots import Sums, thumbnail
from cldit.radiance.boundary import Boundary

Floats = NDArray[np.float64]

KINDS = ("reference", "injection")


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Blocks that see the background and never saturate, before K backgrounds.

    temperatures_K, source: of the black body, and of its radiance in the chamber, (K,) by kind.
    rise: (K,) radiance per kelvin. shots: by kind, for each background (n, B) radiance of each
    shot. camera: (K, B) by kind, variance of one shot's block by the camera's noise.
    own_radiance: of a black body, over its temperature. warmest: radiance that no spray without a
    flame exceeds.
    """

    setpoints: tuple[float, ...]
    temperatures_K: Mapping[str, Floats]
    source: Mapping[str, Floats]
    rise: Floats
    shots: Mapping[str, tuple[Floats, ...]]
    camera: Mapping[str, Floats]
    own_radiance: Callable[[Floats], Floats]
    warmest: float

    @classmethod
    def of(
        cls,
        sums: Mapping[tuple[float, str], Sums],
        setpoints: Sequence[float],
        *,
        sees: NDArray[np.bool_],
        whole: Boundary,
        calibration: Calibration,
        warmest_K: float,
    ) -> Evidence:
        """Of sums by set point and kind.

        Args:
            sums: of every background and kind.
            setpoints: rising.
            sees: (h, w) pixels that see the background, unsaturated.
            whole: measurement equation in the filter.
            calibration: of the camera.
            warmest_K: hottest of backgrounds, walls and windows.
        """
        chosen = thumbnail(sees.astype(float)).ravel() >= 1.0
        if not chosen.any():
            chosen = thumbnail(sees.astype(float)).ravel() > 0.5
        rows, columns = thumbnail(sees.astype(float)).shape
        pixels = max(sees.size / (rows * columns), 1.0)
        scale = calibration.counts_per_radiance * whole.front.transmission
        shots: dict[str, tuple[Floats, ...]] = {}
        camera: dict[str, Floats] = {}
        temperatures = {
            kind: np.array([sums[k, kind].temperature_K for k in setpoints]) for kind in KINDS
        }
        for kind in KINDS:
            parts: list[Floats] = []
            for setpoint in setpoints:
                group = sums[setpoint, kind]
                kept = [
                    small.ravel()[chosen]
                    for small, weight in zip(group.thumbnails, group.weights, strict=True)
                    if weight > 0.0
                ]
                parts.append((np.array(kept, float) - calibration.offset_counts) / scale)
            shots[kind] = tuple(parts)
            counts = np.array([part.mean(axis=0) for part in parts]) * scale
            noise = calibration.variance_counts2(counts + calibration.offset_counts)
            camera[kind] = noise / scale**2 / pixels
        near = temperatures["reference"]
        return cls(
            setpoints=tuple(setpoints),
            temperatures_K=temperatures,
            source={kind: whole.leaving(temperatures[kind]) for kind in KINDS},
            rise=(whole.leaving(near + 0.01) - whole.leaving(near - 0.01)) / 0.02,
            shots=shots,
            camera=camera,
            own_radiance=whole.radiance,
            warmest=float(whole.radiance(warmest_K)),
        )

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return self.shots["reference"][0].shape[1]

    def number(self, kind: str) -> Floats:
        """(K,) shots of a kind."""
        return np.array([float(len(part)) for part in self.shots[kind]])

    def degrees(self, kind: str) -> int:
        """Degrees of freedom of how shots of a kind scatter, over all backgrounds."""
        return int(np.sum(self.number(kind) - 1.0))

    def mean(self, kind: str) -> Floats:
        """(K, B) means over the shots of a kind."""
        return np.array([part.mean(axis=0) for part in self.shots[kind]])

    def picture(self, kind: str, chosen: NDArray[np.bool_]) -> list[Floats]:
        """For each background, (n,) means of each shot of a kind over the `chosen` blocks (B,)."""
        return [part[:, chosen].mean(axis=1) for part in self.shots[kind]]

    def variance(self, kind: str, chosen: NDArray[np.bool_]) -> Floats:
        """(K,) variance of the mean of a kind's shots over the `chosen` blocks (B,).

        The largest of the camera's noise, of the scatter before this background and of that before
        all of them: a few shots may agree by chance.
        """
        n = self.number(kind)
        noise = self.camera[kind][:, chosen].mean(axis=1) / chosen.sum()
        series = self.picture(kind, chosen)
        each = np.array([np.var(one, ddof=1) if len(one) > 1 else 0.0 for one in series])
        pooled = np.sum(each * (n - 1.0)) / max(np.sum(n - 1.0), 1.0)
        return np.asarray(np.maximum(np.maximum(noise, each), pooled) / n)

    def scatter(self, kind: str) -> Floats:
        """(K, B) variance of each block's mean: camera, and a scatter that grows with Delta I."""
        n = self.number(kind)[:, None]
        camera = self.camera[kind]
        if kind == "reference" or self.degrees(kind) == 0:
            return np.asarray(camera / n)
        square = (self.mean("injection") - self.mean("reference")) ** 2
        seen = np.array(
            [np.var(p, axis=0, ddof=1) if len(p) > 1 else 0.0 * p[0] for p in self.shots[kind]]
        )
        weight = (n - 1.0) * np.ones_like(square)
        total = float(np.sum(weight * square**2))
        q = float(np.sum(weight * (seen - camera) * square)) / total if total > 0.0 else 0.0
        return np.asarray((camera + max(q, 0.0) * square) / n)
