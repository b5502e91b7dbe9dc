"""What a run states as its own error of T_app, and what it says where that is more than asked."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.errors import Cause
from cldit.accuracy.spectral import NodeTraces
from cldit.dit.maps import Maps
from cldit.optics.response import scene_filter
from cldit.radiance.apparent_temperature import temperature_errors_K
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.scene.transport import Transport


@dataclass(frozen=True)
class StatedError:
    """RMS errors of T_app; None where one is unknown.

    halves_K: from the difference of two pictures, each of half of the directions or samples. It is
    the error of one half, above that of the picture, and does not have what both simplify.
    audit_K: from pixels that were traced by `path` as well: of the picture, with all that it
    simplifies, and one standard error more.
    cells_K: error of the cells that is stated beside this one, and has a part of the audit's in it.
    unknown: why the error is known in part only, or not at all; "" where it is known.
    map_K: (H, W) half the halves' difference in every pixel; None where it is not known.
    """

    halves_K: float | None
    audit_K: float | None = None
    cells_K: float = 0.0
    unknown: str = ""
    map_K: NDArray[np.float64] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, scene: Scene, result: NodeTraces, maps: Maps) -> StatedError | None:
        """None where nothing scatters.

        Args:
            scene: what was traced.
            result: its traces.
            maps: of the same run.
        """
        if not result.scatters:
            return None
        if result.difference is None:
            return cls(None, unknown=f"method {scene.transport.method} does not know its error")
        count = int(np.count_nonzero(maps.has_temperature))
        if not count:
            return cls(None, unknown="no pixel has an apparent temperature")

        def errors_K(
            error: Weights, pixels: NDArray[np.int64] | slice = slice(None)
        ) -> NDArray[np.float64]:
            return temperature_errors_K(
                error,
                emissivity=maps.emissivity.reshape(-1)[pixels],
                temperature_K=maps.apparent_temperature_K.reshape(-1)[pixels],
                surroundings=Surroundings.from_scene(scene),
                filter_um=scene_filter(scene),
            )

        halves = errors_K(result.difference).reshape(maps.emissivity.shape)
        halves_K, map_K = float(np.sqrt(np.sum(halves**2) / count)), np.abs(halves)
        audit = result.audit
        if audit is None:
            return cls(halves_K, unknown="; ".join(result.unaudited), map_K=map_K)
        one, other = (errors_K(error, audit.sample.pixels) for error in audit.errors)
        square, doubt = audit.sample.mean_square(one, other, count=count)
        return cls(halves_K, float(np.sqrt(max(square, 0.0) + doubt)), map_K=map_K)

    def beyond(self, cells_K: float | None) -> StatedError:
        """The error without what the audit finds of the cells' size.

        `path` sees what even sources in cells of this size miss. The step to other cells, of which
        `cells` is found, has that in it as well. So the square of the audit that `cells_K` explains
        is left to the cells. Were the audit's part none of the cells', that takes a factor
        2^(1/2) from the sum of both at most; counted twice, it would add as much.

        Args:
            cells_K: error of the cells; None where it is unknown.
        """
        return replace(self, cells_K=cells_K or 0.0)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The trace's part of the picture's errors, and what of it is not known."""
        if self.error_K is None:
            return (Cause("trace", None, self.unknown),)
        how = "half the difference of two images, each by half of the ordinates or samples"
        if self.audit_K is not None:
            how = "some pixels traced by `path` as well, one standard error added, less the cells'"
        known = Cause("trace", self.error_K, f"{how}; holds ordinates, iteration and gather")
        return (known, Cause("audit", None, self.unknown)) if self.unknown else (known,)

    @property
    def whole_K(self) -> float | None:
        """The audit's where there is one, with what it finds of the cells; else the halves' [K]."""
        return self.halves_K if self.audit_K is None else self.audit_K

    @property
    def error_K(self) -> float | None:
        """The audit's where there is one, less what the cells explain; else the halves' [K].

        The halves' part is not the cells', and is left as far as the audit finds so much.
        """
        if self.audit_K is None or self.halves_K is None:
            return self.halves_K
        rest = math.sqrt(max(self.audit_K**2 - self.cells_K**2, 0.0))
        return max(rest, min(self.halves_K, self.audit_K))

    @property
    def can_shrink(self) -> bool:
        """Whether ordinates and samples make most of its square: not what only the audit sees."""
        return self.halves_K is not None and 2 * self.halves_K**2 > (self.error_K or 0.0) ** 2

    @property
    def unknown_remarks(self) -> tuple[str, ...]:
        """What is not known of the error."""
        if self.error_K is None:
            return (f"error of the trace in T_app: unknown ({self.unknown})",)
        if not self.unknown:
            return ()
        part = f"error of the trace in T_app: at least {self.error_K:.2g} K RMS, of directions and "
        return (part + f"paths alone ({self.unknown})",)

    def remarks(self, asked: Transport) -> tuple[str, ...]:
        """What is not known of the error; and where it is, as it is printed, more than `asked` for,
        what it is made of, and what can be done."""
        error_K, unknown = self.error_K, self.unknown_remarks
        if error_K is None or not float(f"{error_K:.2g}") > asked.accuracy_K:
            return unknown
        if asked.method == "source":
            finer = "a smaller transport.accuracy_K"
            if asked.directions is not None:
                finer = "more transport.directions"
            why = f"directions and chains make it; allowed is {finer}"
            if self.halves_K is not None and error_K > self.halves_K:
                why = (
                    f"the audit by path tracing finds it, where directions and chains make some "
                    f"{self.halves_K:.2g} K; allowed is {finer} for that part, and "
                    "transport.method: path for the rest"
                )
        else:
            why = "it is the samples' noise; allowed is a larger transport.max_samples, or less "
            why += "accuracy"
        return (
            *unknown,
            f"stated error {error_K:.2g} K RMS, more than transport.accuracy_K: "
            f"{asked.accuracy_K:g} asks for: {why}",
        )
