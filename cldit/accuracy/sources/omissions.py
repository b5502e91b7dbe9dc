"""Errors by keys that omit physics: the image is compared with one that omits nothing.

Both images are traced with the same ordinates and independent halves. A key at its default, or on
the side of it that omits less, is no source of error and costs nothing.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from cldit.accuracy.errors import OMISSION, Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.sources.base import ErrorSource, Measurement
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import swept_cells
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import GridSpray
from cldit.scene.transport import Transport
from cldit.scene.vessel import Domain

_MOST_CELLS = 4e6  # swept, on which all orders are solved; more take longer than most images
_CUTOFF = float(Transport.model_fields["cutoff"].default)
_SPLIT = float(Domain.model_fields["optical_depth_split"].default)


class _Omission(ErrorSource):
    """A key that omits physics.

    whole: settings of the trace without it. of_gas: the error depends on the absorption of gas,
    which changes by orders of magnitude with the wavelength.
    """

    of_spray = True
    shared_by = OMISSION
    fixed_by: ClassVar[str]
    whole: ClassVar[Mapping[str, Any]] = {}
    of_gas: ClassVar[bool] = False

    @abstractmethod
    def omits(self, scene: Scene) -> bool:
        """True if the scene omits something."""

    @abstractmethod
    def how(self, scene: Scene) -> str:
        """Description of both images."""

    def key(self, scene: Scene) -> str:
        return self.fixed_by if self.omits(scene) else ""

    def applies(self, prepared: Prepared) -> bool:
        return self.omits(prepared.scene) and not prepared.is_empty

    def predict(self, at: Measurement) -> list[Estimate]:
        return self._stated(at, at.coarse) if self.applies(at.prepared) else []

    def estimate(self, at: Measurement) -> list[Estimate]:
        return self._stated(at, at.depth) if self.applies(at.prepared) else []

    def without(self, at: Measurement, depth: int) -> ImagePair:
        """The image that omits nothing."""
        return at.tracer.changed(self.name, depth, self.whole)

    def _stated(self, at: Measurement, depth: int) -> list[Estimate]:
        out = [self._compared(at, depth)]
        nodes = len(at.prepared.properties.chosen.quadrature.nodes)
        if self.of_gas and nodes > 1 and at.prepared.sources[1]:
            why = f"compared at one of {nodes} wavelengths; gas may be opaque at others"
            name = f"{self.name} at other wavelengths"
            out.append(Estimate.unknown(name, why, self.fixed_by))
        return out

    def _compared(self, at: Measurement, depth: int) -> Estimate:
        at.stages.tell(f"errors: {self.name}")
        try:
            given, whole = at.tracer.level(depth), self.without(at, depth)
        except (MediumError, SprayError, TransportError) as error:
            why = f"the image that omits nothing cannot be traced: {error}"
            return Estimate.unknown(self.name, why, self.fixed_by)
        cell_mm = 1e3 * at.prepared.cube.at(depth).cell_m
        how = f"{self.how(at.scene)}, on cells of {cell_mm:.3g} mm"
        return Estimate.of(self.name, at.tracer.difference(given, whole), how, self.fixed_by)


class _Orders(_Omission):
    """Light that is scattered more often than `transport.order`."""

    name = "orders of scattering"
    fixed_by = "transport.order"
    whole: ClassVar = {"order": None}
    remedy: ClassVar = {"": "a larger transport.order, or none for all orders"}

    def omits(self, scene: Scene) -> bool:
        return scene.transport.order is not None

    def how(self, scene: Scene) -> str:
        return f"order {scene.transport.order} against all orders"

    def estimate(self, at: Measurement) -> list[Estimate]:
        """Compares larger cells, as all orders cost many times the first; of a grid its voxels."""
        if not self.applies(at.prepared):
            return []
        cells = swept_cells(at.prepared.cube.at(at.depth), at.prepared.sources)
        fine = isinstance(at.scene.spray, GridSpray) and cells <= _MOST_CELLS
        return self._stated(at, at.depth if fine else at.coarse)


class _Cutoff(_Omission):
    """Content behind the transmission at which rays end."""

    name = "cutoff of rays"
    fixed_by = "transport.cutoff"
    whole: ClassVar = {"cutoff": _CUTOFF}
    of_gas = True
    remedy: ClassVar = {"": f"transport.cutoff: {_CUTOFF:g}"}

    def omits(self, scene: Scene) -> bool:
        return scene.transport.cutoff > _CUTOFF

    def how(self, scene: Scene) -> str:
        return f"cutoff {scene.transport.cutoff:g} against {_CUTOFF:g}"

    def estimate(self, at: Measurement) -> list[Estimate]:
        method = at.scene.transport.method
        assert at.solved is not None
        if method == "source" or not self.applies(at.prepared) or not at.solved.scatters:
            return super().estimate(at)
        if method == "path":  # has a cutoff of its own
            return []
        why = f"method {method} ends rays at every scattering"
        return [Estimate.unknown(self.name, why, self.fixed_by)]


class _Gather(_Omission):
    """Variation of sources within cells, which `transport.gather: false` omits."""

    name = "sources within cells"
    fixed_by = "transport.gather"
    whole: ClassVar = {"gather": True}
    remedy: ClassVar = {"": "transport.gather: true"}

    def omits(self, scene: Scene) -> bool:
        spec = scene.transport
        return not spec.gather and spec.method == "source" and spec.order != 0

    def how(self, scene: Scene) -> str:
        return "constant sources against the final gather"


class _VapourCells(_Omission):
    """Vapour in cells that `domain.optical_depth_split` does not divide."""

    name = "cells of vapour"
    fixed_by = "domain.optical_depth_split"
    of_gas = True
    remedy: ClassVar = {"": f"domain.optical_depth_split: {_SPLIT:g}"}

    def omits(self, scene: Scene) -> bool:
        return scene.domain.optical_depth_split > _SPLIT

    def how(self, scene: Scene) -> str:
        return f"split at {scene.domain.optical_depth_split:g} against {_SPLIT:g}"

    def without(self, at: Measurement, depth: int) -> ImagePair:
        return at.tracer.changed(self.name, depth, {}, split=_SPLIT)


ORDERS, CUTOFF, GATHER, VAPOUR_CELLS = _Orders(), _Cutoff(), _Gather(), _VapourCells()
