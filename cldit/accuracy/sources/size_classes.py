"""Error by the classes of droplet size of a cone, by a cone with half of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from cldit.accuracy.errors import Estimate
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.base import OR_NONE, ErrorSource, Excess, Measurement
from cldit.accuracy.sources.gas_grid import NO_COARSER_LATTICE, cone_image
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray

_MOST = 64


class _SizeClasses(ErrorSource):
    """The number of classes of droplet size: the error falls as one over their number."""

    name = "size classes"
    shared_by = "classes"
    cost_power, cost_share = 1.0, 0.3  # classes cost time only where the medium is made
    of_spray = True
    remedy: ClassVar = {
        "": "more spray.size_classes",
        "spray.size_classes": f"more spray.size_classes{OR_NONE}",
    }

    def key(self, scene: Scene) -> str:
        given = isinstance(scene.spray, ConeSpray) and scene.spray.size_classes is not None
        return "spray.size_classes" if given else ""

    def is_free(self, scene: Scene) -> bool:
        spray = scene.spray
        droplets = isinstance(spray, ConeSpray) and spray.droplets is not None
        return droplets and not self.key(scene)

    def applies(self, prepared: Prepared) -> bool:
        cone = prepared.cone
        return cone is not None and cone.droplets is not None and cone.classes > 1

    def predict(self, at: Measurement) -> list[Estimate]:
        cone = at.prepared.cone
        if cone is None or not self.applies(at.prepared):
            return []
        try:
            if at.prepared.on_lattice:
                cone, whole = at.tracer.cone_at(at.coarse), at.tracer.level(at.coarse)
            else:
                (cone, whole), _ = (cone_image(at, cone, up) for up in (2, 4))
            at.stages.tell("errors: half of the classes of size")
            half = cone.model_copy(update={"size_classes": cone.classes // 2})
            image = at.tracer.variant(
                f"{half.size_classes} classes", lambda: at.prepared.resprayed(half), at.coarse
            )
        except NO_COARSER_LATTICE:
            return []
        found = at.tracer.difference(whole, image)
        how = f"{half.size_classes} classes for {cone.classes}: error falls as 1 / number"
        return [Estimate.of(self.name, found, how, self.key(at.scene), size=1 / cone.classes)]

    def estimate(self, at: Measurement) -> list[Estimate]:
        cone = at.prepared.cone
        if cone is None or cone.droplets is None:
            return []
        if self.name in at.predicted:
            return [at.predicted[self.name].at(1 / cone.classes)]
        if at.prepared.is_empty:
            return []
        why = "one class alone, or no coarser lattice to compare on"
        return [Estimate.unknown(self.name, why, "spray.size_classes")]

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        if resolution.size_classes is None:
            return resolution
        classes = min(_MOST, math.ceil(resolution.size_classes * excess.ratio))
        return replace(resolution, size_classes=classes)


SIZE_CLASSES = _SizeClasses()
