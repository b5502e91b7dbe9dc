"""Errors by the sample of droplets: parcels, the width of their deposit, classes of size.

Half of the parcels are traced against the other half, and a cone against one with half of the
classes, on cells twice as large as those of the image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cldit.accuracy.errors import Estimate
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.base import ErrorSource, remedies
from cldit.accuracy.variant_tracer import NO_COARSER_LATTICE, VariantTracer
from cldit.medium.cloud import SAMPLING, Kernel, copies_of, halves, variants
from cldit.medium.octree import Sources
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray

_SEED = 1  # of the halves
# The bias of the width falls with its fourth power: a variance and its half differ by 3/4 of it.
_OF_WIDTH = 4.0 / 3.0
# Split-half estimates of 13,700 parcels of gdi-flow are 0.9 of the scatter between seeds, those of
# 6,900 are 0.67 (docs/errors.md): the halves share a gas that few parcels drive more randomly.
_FEWEST_PARCELS = 13_000
_MOST_CLASSES = 64


# Sources of either half of the parcels, and of narrower clouds, None for parcels that come with an
# extent; sampling error over the difference of the halves.
ParcelVariants = tuple[tuple[Sources, Sources], Sources | None, float]


def parcel_variants(prepared: Prepared) -> ParcelVariants:
    """Variants of a spray whose parcels are a sample, see `cldit.medium.cloud.variants`."""
    traced, spray = prepared.made, prepared.spray
    assert traced.parcels is not None and spray.parcels is not None
    if spray.parcels.extent is None or traced.parcels.extent is not None:
        parts = halves(spray.parcels, seed=_SEED, copies=copies_of(traced))
        half_a, half_b = (prepared.sources_of(replace(spray, parcels=half)) for half in parts)
        return (half_a, half_b), None, 0.5
    kernel = Kernel(exposure_s=prepared.scene.camera.smear_s)
    sprays = variants(traced, kernel=kernel, seed=_SEED)
    half_a, half_b, narrower = (prepared.sources_of(spray) for spray in sprays)
    return (half_a, half_b), narrower, SAMPLING


class _Parcels(ErrorSource):
    """The parcels of a spray that are a sample of its droplets."""

    name = "parcels"
    shared_by = "spray"
    of_spray = True
    remedy = remedies(
        "a smaller spray.droplets_per_parcel (run time grows as the number of parcels), or more "
        "parcels in the file"
    )
    also = ("deposit width",)

    def key(self, scene: Scene) -> str:
        is_given = getattr(scene.spray, "droplets_per_parcel", None) is not None
        return "spray.droplets_per_parcel" if is_given else "spray.file"

    def applies(self, prepared: Prepared) -> bool:
        parcels = prepared.made.parcels
        if parcels is None or not parcels.sampled:
            return False
        return int(np.count_nonzero(parcels.droplets)) >= 2

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        variants_of: ParcelVariants = at.prepared.variant(
            self.name, lambda: parcel_variants(at.prepared)
        )
        (half_a, half_b), narrower, sampling = variants_of
        at.tell("errors: either half of the parcels")
        image_a = at.variant("first half of the parcels", lambda: half_a, at.coarse_m)
        image_b = at.variant("second half of the parcels", lambda: half_b, at.coarse_m)
        errors = [step.times(sampling) for step in at.difference(image_a, image_b)]
        method = f"{sampling:.2g} of the difference of two halves of the parcels"
        out = [Estimate.of(self.name, errors, method)]
        if narrower is not None:
            at.tell("errors: parcels spread less")
            image = at.variant("parcels spread less", lambda: narrower, at.coarse_m)
            steps = at.difference(at.level(at.coarse_m), image)
            width = [step.times(_OF_WIDTH) for step in steps]
            method = "4/3 of the step to half of the variance, for a bias of fourth order"
            out.append(Estimate.of("deposit width", width, method, at_most=True))
        points, _ = at.prepared.sources
        if isinstance(at.scene.spray, LagrangianSpray) and points is not None:
            if len(points.position_m) < _FEWEST_PARCELS:
                reason = (
                    f"{len(points.position_m)} parcels, whose halves share a gas that they drive; "
                    f"below {_FEWEST_PARCELS} the scatter between seeds exceeds this estimate"
                )
                out.append(Estimate.unknown("gas of few parcels", reason))
        return out


class _SizeClasses(ErrorSource):
    """The number of classes of droplet size: the error falls as one over their number."""

    name = "size classes"
    shared_by = "classes"
    cost_power, cost_share = 1.0, 0.3  # classes cost time only where the medium is made
    of_spray = True
    remedy = remedies("more spray.size_classes", "spray.size_classes")

    def is_free(self, scene: Scene) -> bool:
        return isinstance(scene.spray, ConeSpray) and not self.key(scene)

    def applies(self, prepared: Prepared) -> bool:
        return prepared.cone is not None and not prepared.is_empty

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        cone = at.prepared.cone
        assert cone is not None
        if at.image is None:
            return self._halved(at, cone) if cone.classes > 1 else []
        if self.name in at.predicted:
            return [at.predicted[self.name].at(1 / cone.classes)]
        reason = "one class alone, or no coarser lattice to compare on"
        return [Estimate.unknown(self.name, reason)]

    def _halved(self, at: VariantTracer, cone: ConeSpray) -> list[Estimate]:
        try:
            if at.prepared.on_lattice:
                cone, all_classes = at.cone_at(at.coarse_m), at.level(at.coarse_m)
            else:
                (cone, all_classes), _ = (at.on_lattice(up) for up in (2, 4))
            at.tell("errors: half of the classes of size")
            half = cone.model_copy(update={"size_classes": cone.classes // 2})
            image = at.variant(
                f"{half.size_classes} classes", lambda: at.prepared.resprayed(half), at.coarse_m
            )
        except NO_COARSER_LATTICE:
            return []
        differences = at.difference(all_classes, image)
        method = f"{half.size_classes} classes for {cone.classes}: error falls as 1 / number"
        return [Estimate.of(self.name, differences, method, size=1 / cone.classes)]

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        if old.size_classes is None:
            return old
        classes = min(_MOST_CLASSES, math.ceil(old.size_classes * ratio))
        return replace(old, size_classes=classes)


PARCELS, SIZE_CLASSES = _Parcels(), _SizeClasses()
