"""Error by the wavelengths that stand for the filter, as estimated where they are chosen."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.base import OR_NONE, ErrorSource, Excess, Measurement
from cldit.scene import Scene


class _Wavelengths(ErrorSource):
    """The number of wavelengths; `cldit.optics.wavelengths` knows the error of each number."""

    name = "wavelengths"
    shared_by = "optics"
    cost_power = 1.0  # the error falls about as one over their number
    remedy: ClassVar = {
        "": "more optics.wavelengths",
        "optics.wavelengths": f"more optics.wavelengths{OR_NONE}",
        "optics.spectral_error_K": f"a smaller optics.spectral_error_K{OR_NONE}",
    }

    def key(self, scene: Scene) -> str:
        if scene.optics.wavelengths is not None:
            return "optics.wavelengths"
        return "optics.spectral_error_K" if scene.optics.spectral_error_K else ""

    def is_free(self, scene: Scene) -> bool:
        optics = scene.optics
        given = optics.wavelengths is not None or optics.spectral_error_K is not None
        return optics.preset == "spectral" and not given

    def estimate(self, at: Measurement) -> list[Estimate]:
        chosen = at.prepared.properties.chosen
        if not chosen.errors_K:
            return []
        how = f"{len(chosen.nodes)} nodes against more, on lines of sight through the spray"
        return [Estimate(Cause(self.name, chosen.error_K, how, self.key(at.scene)))]

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        return replace(resolution, spectral_K=_bounded(excess.share_K))


def spectral_K(scene: Scene, share_K: float) -> float:
    """Error asked of the wavelengths for a share: that of the scene where it sets one."""
    fixed_K = scene.optics.spectral_error_K
    return _bounded(share_K) if fixed_K is None else fixed_K


def _bounded(share_K: float) -> float:
    return min(max(share_K, 1e-3), 100.0)  # as the scene's own key


WAVELENGTHS = _Wavelengths()
