"""Apparent temperature in the light of one spectral node, from weights: DIT without noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.optics.spectral import SpectralNode
from cldit.radiance.weights import Weights
from cldit.scene import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class NodeTemperature:
    """Inverts weights of one scene and node.

    grid_K, radiance: (N,), the node's curve. before_background: (H, W), which lines of sight end on
    the background.
    """

    scene: Scene
    grid_K: Floats
    radiance: Floats
    before_background: NDArray[np.bool_]

    @classmethod
    def of(
        cls, scene: Scene, node: SpectralNode, before_background: NDArray[np.bool_]
    ) -> NodeTemperature:
        """Tabulates the node's curve.

        Args:
            scene: whose walls and patches shine.
            node: of the spectral quadrature.
            before_background: (H, W).
        """
        grid_K = np.geomspace(20.0, 5000.0, 20_000)
        return cls(scene, grid_K, np.asarray(node.radiance(grid_K), float), before_background)

    def picked(self, pixels: NDArray[np.int64]) -> NodeTemperature:
        """The same of pixels (N,), flat numbers, whose weights are one row (1, N)."""
        return replace(self, before_background=self.before_background.reshape(1, -1)[:, pixels])

    def __call__(self, weights: Weights) -> Floats:
        """(H, W) apparent temperature; NaN where emissivity says nothing, or off the background.

        Emissivity is 1 - w_bg, and B(T_app) is what does not come from the background, over it.
        """
        wall = np.interp(self.scene.walls.temperature_K, self.grid_K, self.radiance)
        own = weights.wall * wall + weights.vapour.astype(float) + weights.liquid
        for patch in self.scene.patches:
            lit = np.interp(patch.temperature_K, self.grid_K, self.radiance)
            own += weights.patches[patch.name] * lit
        emissivity = 1.0 - weights.background.astype(float)
        apparent = np.divide(own, emissivity, out=np.zeros_like(own), where=emissivity > 1e-6)
        # Interpolated between logarithms, whose curve over 1 / T is nearly straight.
        known = (apparent > self.radiance[0]) & self.before_background
        inverse = np.interp(
            np.log(np.where(known, apparent, 1.0)), np.log(self.radiance), -1.0 / self.grid_K
        )
        return np.where(known, -1.0 / inverse, np.nan)
