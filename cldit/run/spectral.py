"""Spectral resolution of a run, and the difference of two maps of one scene."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cldit.dit.maps import Maps
from cldit.optics.node_count import stays_K
from cldit.optics.spectral import Quadrature


@dataclass(frozen=True)
class Difference:
    """Difference of two maps of one scene, over the pixels of emissivity above 0.05 in both."""

    rms_K: float
    mean_K: float
    mean_emissivity: float
    pixels: int

    @classmethod
    def of(cls, maps: Maps, baseline: Maps) -> "Difference | None":
        """`maps` minus `baseline`; None where no pixel has a temperature in both."""
        valid = maps.has_temperature & baseline.has_temperature
        if not valid.any():
            return None
        difference_K, emissivity = (
            getattr(maps, name)[valid].astype(float) - getattr(baseline, name)[valid]
            for name in ("apparent_temperature_K", "emissivity")
        )
        return cls(
            rms_K=float(np.sqrt(np.mean(difference_K**2))),
            mean_K=float(np.mean(difference_K)),
            mean_emissivity=float(np.mean(emissivity)),
            pixels=int(valid.sum()),
        )


@dataclass(frozen=True)
class SpectralInfo:
    """Spectral resolution of the filter.

    errors_K: estimated RMS error in T_app with 1, 2, .. nodes, on lines of sight through the spray;
    empty where one node is exact. nodes: mean wavelength, um, and share of the light at
    `reference_K`. from_paper: this run minus the same scene with the paper's optical properties.
    """

    reference_K: float
    nodes: tuple[tuple[float, float], ...]
    errors_K: tuple[float, ...] = ()
    from_paper: Difference | None = None

    @property
    def error_K(self) -> float:
        """Estimated error of the nodes that were traced: the largest from their number on."""
        return stays_K(self.errors_K, len(self.nodes)) if self.errors_K else 0.0

    @classmethod
    def of(
        cls, quadrature: Quadrature, errors_K: Sequence[float], from_paper: Difference | None
    ) -> "SpectralInfo":
        """Takes the nodes, the errors of each number of them, and the difference from the paper."""
        at = quadrature.reference_K
        nodes = tuple((node.wavelength_um, float(node.share(at))) for node in quadrature.nodes)
        return cls(at, nodes, tuple(errors_K), from_paper)
