"""Error by ordinates, iteration and final gather, from halves of the trace and its audit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.base import OR_NONE, ErrorSource, Excess, Measurement
from cldit.accuracy.sources.cells import CELLS
from cldit.accuracy.sources.omissions import CUTOFF, GATHER
from cldit.scene import Scene

_FEWEST_K = 0.4  # for which, and for any larger error, a trace has its fewest ordinates
_LEAST_MORE = 2.0  # times the ordinates of a trial: less is lost in the audit's own error


class _Ordinates(ErrorSource):
    """The ordinates of a trace, or its random samples."""

    name = "trace"
    shared_by = "seed"
    cost_power = 1.5  # the error falls with the number of ordinates to the power -2/3
    remedy: ClassVar = {
        "": "more transport.directions or a larger transport.max_samples, or, for the part that "
        "only the audit shows, transport.method: path, or domain.leaf_edge_m of half the voxels of "
        "a grid",
        "transport.directions": f"more transport.directions{OR_NONE}",
    }

    def key(self, scene: Scene) -> str:
        return "" if scene.transport.directions is None else "transport.directions"

    def is_free(self, scene: Scene) -> bool:
        droplets = getattr(scene.spray, "droplets", True) is not None
        return scene.transport.directions is None and droplets

    def of_image(self, at: Measurement, image: ImagePair) -> float | None:
        noise_K = at.tracer.noise_K(image)
        if not noise_K:
            return noise_K
        # Each wavelength has ordinates of its own, whose errors are independent.
        assert at.resolution is not None
        return noise_K * (at.resolution.ordinates_K / at.tracer.settings.accuracy_K)

    def estimate(self, at: Measurement) -> list[Estimate]:
        assert at.solved is not None
        found = at.solved.trace_error
        if found is None:
            return []
        key = self.key(at.scene)
        found = found.beyond(audited_K(at))
        if found.error_K is None:
            return [Estimate.unknown(self.name, found.unknown, key)]
        how = "half the difference of two images, each by half of the ordinates or samples"
        if found.audit_K is not None:
            how = "some pixels traced by `path` as well, one standard error added, less the cells'"
        how += "; contains ordinates, iteration and gather"
        out = [Estimate(Cause(self.name, found.error_K, how, key), found.map_K)]
        return out + ([Estimate.unknown("audit", found.unknown, key)] if found.unknown else [])

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        finer = excess.ratio**self.cost_power
        now_K, then_K = resolution.ordinates_K, resolution.ordinates_K / finer
        more = finer * max(1.0, _FEWEST_K / now_K) / max(1.0, _FEWEST_K / then_K)
        more *= resolution.more_ordinates
        return replace(resolution, ordinates_K=then_K, more_ordinates=more)

    def denser(self, resolution: Resolution, excess: Excess) -> Resolution:
        """More ordinates with as many paths: a trial for an error that both halves share."""
        more = max(excess.ratio**self.cost_power, _LEAST_MORE)
        return replace(resolution, more_ordinates=more * resolution.more_ordinates)


def audited_K(at: Measurement) -> float | None:
    """Error that other sources state and the audit sees, too; None: none is known.

    `path` samples sources within cells, and follows rays to a cutoff of its own.
    """
    known = [one for one in map(at.error_K, (CELLS, CUTOFF, GATHER)) if one is not None]
    return math.hypot(*known) if known else None


ORDINATES = _Ordinates()
