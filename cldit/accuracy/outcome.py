"""What one attempt at a scene came to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.errors import Errors
from cldit.accuracy.model_spread import model_spread
from cldit.accuracy.plan import Plan
from cldit.accuracy.spectral import Difference, NodeTraces, SpectralInfo
from cldit.accuracy.trace_error import StatedError
from cldit.camera.sensor import SensorModel
from cldit.dit.maps import Maps
from cldit.optics.spectral import Quadrature
from cldit.prepare.medium import Medium
from cldit.radiance.weights import Weights
from cldit.scene import Scene


@dataclass(frozen=True)
class Attempt:
    """A scene traced by a plan.

    error_maps: of `errors` (H, W), by cause. errors: None where the scene wants no audit.
    """

    scene: Scene
    plan: Plan
    medium: Medium
    result: NodeTraces
    reference: Weights
    maps: Maps
    sensor: SensorModel
    stated: StatedError | None
    errors: Errors | None
    error_maps: Mapping[str, NDArray[np.float32]]

    @property
    def quadrature(self) -> Quadrature:
        """The nodes that were traced."""
        return self.medium.properties.chosen.quadrature

    def spectral(self, from_paper: Difference | None) -> SpectralInfo:
        """How the filter was resolved, with the difference from the paper's optics."""
        errors_K = self.medium.properties.chosen.errors_K
        return SpectralInfo.of(self.quadrature, errors_K, from_paper)

    def with_model(self, from_paper: Difference | None) -> Errors | None:
        """The errors, and beside them what is known of the model's own spread."""
        if self.errors is None:
            return None
        return replace(self.errors, model=model_spread(self.scene, from_paper))
