"""Errors by keys that omit physics: the image is compared with one that omits nothing.

Both images are traced with the same ordinates and independent halves. A key at its default, or on
the side of it that omits less, is no source of error and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cldit.accuracy.errors import OMISSION, Estimate
from cldit.accuracy.sources.base import MOST_SWEPT, ErrorSource, remedies
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import counted
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import GridSpray
from cldit.scene.vessel import Domain

_SPLIT = float(Domain.model_fields["optical_depth_split"].default)


@dataclass(frozen=True)
class Omission(ErrorSource):
    """A key that omits physics, a row of the table below.

    omits: True if a scene omits something. method: both images, with {} for the scene's value.
    complete: settings of a trace without it, or `split`: the optical depth at which its cells are
    divided. of_gas: the error depends on the absorption of gas, which changes by orders of
    magnitude with the wavelength. costly: all else costs many times the image, so that larger cells
    are compared, of a grid its voxels.
    """

    name: str
    fixed_by: str
    method: str
    remedy: Mapping[str, str]
    omits: Callable[[Scene], bool]
    complete: Mapping[str, Any]
    split: float | None = None
    of_gas: bool = False
    costly: bool = False
    of_spray = True
    shared_by = OMISSION

    def key(self, scene: Scene) -> str:
        """The key, where the scene omits something by it."""
        return self.fixed_by if self.omits(scene) else ""

    def applies(self, prepared: Prepared) -> bool:
        """True if the scene omits something of a medium."""
        return self.omits(prepared.scene) and not prepared.is_empty

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        """The error of the image; on coarse cells before there is one."""
        method = at.scene.transport.method
        if at.image is None:
            return self._stated(at, at.coarse_m)
        if self is CUTOFF and method != "source" and at.trace_errors:
            reason = f"method {method} ends rays at every scattering"  # `path` has one of its own
            return [] if method == "path" else [Estimate.unknown(self.name, reason)]
        cells = counted(at.frame(at.cell_m), at.prepared.sources, at.prepared.device).swept
        fine = isinstance(at.scene.spray, GridSpray) and cells <= MOST_SWEPT
        return self._stated(at, at.cell_m if fine or not self.costly else at.coarse_m)

    def _stated(self, at: VariantTracer, cell_m: float) -> list[Estimate]:
        out = [self._compared(at, cell_m)]
        nodes = len(at.prepared.properties.chosen.quadrature.nodes)
        if self.of_gas and nodes > 1 and at.prepared.sources[1]:
            reason = f"compared at one of {nodes} wavelengths; gas may be opaque at others"
            name = f"{self.name} at other wavelengths"
            out.append(Estimate.unknown(name, reason))
        return out

    def _compared(self, at: VariantTracer, cell_m: float) -> Estimate:
        at.tell(f"errors: {self.name}")
        try:
            image = at.level(cell_m)
            complete = at.variant(self.name, None, cell_m, self.complete, self.split)
        except (MediumError, SprayError, TransportError) as error:
            reason = f"the image that omits nothing cannot be traced: {error}"
            return Estimate.unknown(self.name, reason)
        section, name = self.fixed_by.split(".")
        value = getattr(getattr(at.scene, section), name)
        method = f"{self.method.format(value)}, on cells of {1e3 * cell_m:.3g} mm"
        return Estimate.of(self.name, at.difference(image, complete), method)


ORDERS = Omission(
    "orders of scattering",
    "transport.order",
    "order {} against all orders",
    remedies("a larger transport.order, or none for all orders"),
    lambda scene: scene.transport.order is not None,
    {"order": None},
    costly=True,
)
CUTOFF = Omission(
    "cutoff of rays",
    "transport.cutoff",
    "cutoff {:g} against one chosen for the sources",
    remedies("no transport.cutoff"),
    lambda scene: bool(scene.transport.cutoff),
    {"cutoff": None},
    of_gas=True,
)
GATHER = Omission(
    "sources within cells",
    "transport.gather",
    "constant sources against the final gather",
    remedies("transport.gather: true"),
    lambda scene: (
        not scene.transport.gather
        and scene.transport.method == "source"
        and scene.transport.order != 0
    ),
    {"gather": True},
)
VAPOUR_CELLS = Omission(
    "cells of vapour",
    "domain.optical_depth_split",
    f"split at {{:g}} against {_SPLIT:g}",
    remedies(f"domain.optical_depth_split: {_SPLIT:g}"),
    lambda scene: scene.domain.optical_depth_split > _SPLIT,
    {},
    split=_SPLIT,
    of_gas=True,
)
