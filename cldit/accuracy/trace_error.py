"""Error of a trace in both results: by its independent halves, and by an audit of some pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.node_traces import NodeTraces
from cldit.arrays import Floats, Ints
from cldit.dit.maps import Maps
from cldit.radiance.apparent_temperature import NodeTemperature, result_errors_K
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.monte_carlo.pixel_sampling import PixelSample, sampled_square
from cldit.transport.ray_choice import contrast_K


@dataclass(frozen=True)
class TraceError:
    """RMS errors of one result by the trace, in kelvin; None where one is unknown.

    halves_K: from two images, each of half of the ordinates or samples. It is the error of one
    half, which exceeds that of the image, and lacks approximations that both halves share.
    audit_K: from pixels that were traced by `path` as well, plus one standard error: contains all
    approximations. cells_K: stated error of the cells, part of which is in the audit. unknown: why
    the error is known in part only, or not at all; empty where it is known. map_K: (H, W) half the
    halves' difference in each pixel, or what the audit shows in pixels like it, if that is larger;
    None if unknown.
    """

    halves_K: float | None
    audit_K: float | None = None
    cells_K: float = 0.0
    unknown: str = ""
    map_K: Floats | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, scene: Scene, result: NodeTraces, maps: Maps) -> tuple[TraceError, ...]:
        """Compares the halves and the audit of a scene's traces: T_app, then emissivity times
        `kelvin_per_emissivity`; empty if nothing scatters."""
        if not result.scatters:
            return ()
        if result.difference is None:
            return (cls(None, unknown=f"method {scene.transport.method} has no error estimate"),)
        count = int(np.count_nonzero(maps.has_temperature))
        if not count:
            return (cls(None, unknown="no pixel has an apparent temperature"),)

        def errors_K(error: Weights, pixels: Ints | slice = slice(None)) -> tuple[Floats, Floats]:
            images = maps.emissivity, maps.apparent_temperature_K
            emissivity, kelvin = (image.reshape(-1)[pixels] for image in images)
            return result_errors_K(error, emissivity=emissivity, temperature_K=kelvin, scene=scene)

        audit, halves = result.audit, np.array(errors_K(result.difference))
        halves_K = np.sqrt(np.sum(halves**2, axis=1) / count).tolist()
        maps_K = np.abs(halves.reshape(2, *maps.emissivity.shape))
        if audit is None:
            unknown = "; ".join(result.unaudited)
            pairs = zip(halves_K, maps_K, strict=True)
            return tuple(cls(half_K, unknown=unknown, map_K=map_K) for half_K, map_K in pairs)
        sample, out = audit.sample, []
        pairs_K = zip(*(errors_K(error, sample.pixels) for error in audit.errors), strict=True)
        for half_K, map_K, (half_a, half_b) in zip(halves_K, maps_K, pairs_K, strict=True):
            square, doubt = sample.mean_square(half_a, half_b, count=count)
            map_K = _audited_map(maps, sample, half_a * half_b, map_K)
            out.append(cls(half_K, float(np.sqrt(max(square, 0.0) + doubt)), map_K=map_K))
        return tuple(out)

    @classmethod
    def of_halves(cls, temperature: NodeTemperature, image: ImagePair) -> tuple[TraceError, ...]:
        """Errors of an image of one wavelength by its halves alone; empty if it has none, or no
        pixel is visible."""
        count = int(np.count_nonzero(image.visible(temperature)))
        if image.difference is None or not count:
            return ()
        squares = np.nansum(image.noise_K(temperature) ** 2, axis=(1, 2))
        return tuple(cls(half_K) for half_K in np.sqrt(squares / count).tolist())

    @property
    def whole_K(self) -> float | None:
        """Error by the audit where there is one, the cells' part included; else by the halves."""
        return self.halves_K if self.audit_K is None else self.audit_K

    @property
    def error_K(self) -> float | None:
        """Error by the audit where there is one, less the cells' part; else by the halves.

        `path` sees what constant sources in cells miss, and so does the difference from other
        cells, from which `cells_K` is estimated: that part of the audit's square is attributed to
        the cells. If none of it were the cells', the sum of both would be too small by a factor of
        2^(1/2) at most; counted twice, it would be too large by as much. The halves' part is not
        the cells', and is kept as far as the audit shows as much.
        """
        if self.audit_K is None or self.halves_K is None:
            return self.halves_K
        rest = math.sqrt(max(self.audit_K**2 - self.cells_K**2, 0.0))
        return max(rest, min(self.halves_K, self.audit_K))

    @property
    def can_shrink(self) -> bool:
        """True if ordinates and samples make most of its square, not what only the audit shows."""
        return self.halves_K is not None and 2 * self.halves_K**2 > (self.error_K or 0.0) ** 2

    @property
    def unknown_remarks(self) -> tuple[str, ...]:
        """Remark on the unknown part of the error."""
        if self.error_K is None:
            return (f"error of the trace in T_app: unknown ({self.unknown})",)
        if not self.unknown:
            return ()
        part = f"error of the trace in T_app: at least {self.error_K:.2g} K RMS, by directions and "
        return (part + f"paths alone ({self.unknown})",)


def _audited_map(maps: Maps, sample: PixelSample, square: Floats, halves_K: Floats) -> Floats:
    """Map (H, W) of the error by its `square` (N,) in a sample of pixels, and by the halves."""
    counted = maps.has_temperature
    apparent_K = np.where(counted, maps.apparent_temperature_K.astype(float), np.nan)
    features = maps.emissivity.astype(float), contrast_K(apparent_K)
    alike = np.nan_to_num(sampled_square(sample, square, features, counted))
    return np.maximum(np.sqrt(alike), halves_K)
