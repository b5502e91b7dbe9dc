"""Error by the grid that the gas is computed on.

The lattice of a cone is varied by factors of two and four, and the error extrapolated. A computed
gas is computed again on cells twice as large. Its error falls by first order: T_app of one plume
of gdi-flow moves by 18.2, 8.7 and 4.3 K from 4 to 2, to 1 and to 0.5 mm (docs/errors.md). So the
difference between cells of 2 h and h is the error at h. Droplets start alike on both, but eddies
move them differently at every time step, so that the random parts of the two sprays are
independent: images of the same seed differ as much as those of different ones. The square of the
difference contains the square of that error twice. A gas that is read comes on one grid alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.resolution import Resolution, lattice_is_cells
from cldit.accuracy.richardson import RichardsonEstimate
from cldit.accuracy.sources.base import OR_NONE, ErrorSource, Excess, Measurement
from cldit.accuracy.sources.parcels import PARCELS
from cldit.errors import MediumError, OpticsError, SprayError, TransportError
from cldit.medium.octree import Sources
from cldit.medium.resolution import within
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray

_LARGER = 2.0
_LARGEST_M = 1e-2  # that a scene may have
_FEWEST = 12  # cells along the gas's fuel, 4 mm of 48: fewer were not seen to follow first order
# The part that is cut off changes T_app by less than this share of the spray: 0.1 K of 100 K.
_MOST_LOST = 1e-3
_HALF = 0.5  # of the square of a difference: if chance makes more, it hides the error
_FINEST_LATTICE_m = 0.1e-3
# A coarser lattice does not resolve the plumes, reaches out of the domain, or behind a patch.
NO_COARSER_LATTICE = (SprayError, MediumError, TransportError)
_CONE_KEY, _FLOW_KEY = "spray.spacing_m", "spray.box.spacing_m"


class _GasGrid(ErrorSource):
    """The lattice of a cone, or the grid of a computed or imported gas."""

    name = "gas grid"
    shared_by = "spray"
    # The error falls with the lattice to the power 3/2; it costs time only where the medium is
    # made, a third of a run of gdi at 0.5 K.
    cost_power, cost_share = 2.0, 0.3
    of_spray = True
    remedy: ClassVar = {
        "": "a smaller spray.spacing_m",
        _CONE_KEY: f"a smaller spray.spacing_m{OR_NONE}",
        _FLOW_KEY: "a smaller spray.box.spacing_m (half takes up to 16 times as long)",
    }

    def key(self, scene: Scene) -> str:
        if isinstance(scene.spray, ConeSpray):
            return "" if scene.spray.spacing_m is None else _CONE_KEY
        return _FLOW_KEY if isinstance(scene.spray, LagrangianSpray) else ""

    def is_free(self, scene: Scene) -> bool:
        cone = isinstance(scene.spray, ConeSpray)
        return cone and not self.key(scene) and not lattice_is_cells(scene)

    def applies(self, prepared: Prepared) -> bool:
        if prepared.cone is not None:
            return not prepared.on_lattice
        return prepared.spray.vapour is not None

    def predict(self, at: Measurement) -> list[Estimate]:
        if not self.applies(at.prepared):
            return []
        return self._lattice(at) if at.prepared.cone is not None else self._grid(at)

    def estimate(self, at: Measurement) -> list[Estimate]:
        cone = at.prepared.cone
        if cone is None:
            return self.predict(at)
        if self.name in at.predicted:
            return [at.predicted[self.name].at(cone.lattice_m)]
        if at.prepared.on_lattice or at.prepared.is_empty:
            return []
        twice, four = (f"{1e3 * up * cone.lattice_m:.3g}" for up in (2, 4))
        why = (
            f"no estimate from lattices of {twice} and {four} mm, which do not resolve the plumes "
            f"or reach out of the domain; allowed: a smaller {_CONE_KEY}"
        )
        return [Estimate.unknown(self.name, why, _CONE_KEY)]

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        if resolution.spacing_m is None:
            return resolution
        spacing_m = resolution.spacing_m / excess.ratio ** (1.0 / excess.order)
        return replace(resolution, spacing_m=max(spacing_m, _FINEST_LATTICE_m))

    def _lattice(self, at: Measurement) -> list[Estimate]:
        cone, tracer = at.prepared.cone, at.tracer
        assert cone is not None
        at.stages.tell("errors: a lattice twice and four times as coarse")
        try:
            coarser, coarsest = (cone_image(at, cone, up)[1] for up in (2, 4))
        except NO_COARSER_LATTICE:
            return []
        before = tracer.difference(coarser, coarsest)
        last = tracer.difference(tracer.level(at.coarse), coarser)
        found = RichardsonEstimate.of(before, last)
        sizes = ", ".join(f"{1e3 * up * cone.lattice_m:.3g}" for up in (1, 2, 4))
        return [
            Estimate.of(
                self.name,
                found.difference,
                f"cone on lattices of {sizes} mm, extrapolated by order {found.order:.2g}",
                self.key(at.scene),
                at_most=found.bound_K is not None,
                order=found.order,
                size=cone.lattice_m,
            )
        ]

    def _grid(self, at: Measurement) -> list[Estimate]:
        gas: CoarserGas = at.prepared.variant(self.name, lambda: _coarser_gas(at))
        fixed = self.key(at.scene)
        sources = gas.sources
        if sources is None:
            return [Estimate.unknown(self.name, gas.how, fixed)]
        at.stages.tell("errors: larger cells of gas")
        try:
            # On the image's own cells: larger ones would blur those of the gas.
            other = at.tracer.variant(self.name, lambda: sources, at.depth)
        except (MediumError, TransportError) as error:  # it fills more cells, or reaches further
            why = f"the spray on larger cells of gas: {error}"
            return [Estimate.unknown(self.name, why, fixed)]
        whole = at.tracer.difference(at.tracer.level(at.depth), other)
        found, chance = without_chance(whole, at.error_K(PARCELS))
        how = f"{gas.how}; {chance}"
        return [Estimate.of(self.name, found, how, fixed, at_most=found is whole)]


def cone_image(at: Measurement, cone: ConeSpray, up: int) -> tuple[ConeSpray, ImagePair]:
    """A cone on a lattice `up` times as coarse, and its image; raises `NO_COARSER_LATTICE`."""
    wider = cone.model_copy(update={"spacing_m": up * cone.lattice_m})
    name = f"{up} times the lattice"
    return wider, at.tracer.variant(name, lambda: at.prepared.resprayed(wider), at.coarse)


@dataclass(frozen=True)
class CoarserGas:
    """A spray on larger cells of gas: its sources, None if there are none, and what it is."""

    sources: Sources | None
    how: str


def _coarser_gas(at: Measurement) -> CoarserGas:
    if not isinstance(at.scene.spray, LagrangianSpray):
        why = "the gas comes on one grid alone; compare with a run from a finer one"
        return CoarserGas(None, why)
    with at.stages.stage("spray on cells of gas twice as large"):
        return coarser_gas(at.prepared, at.scene.spray)


def coarser_gas(prepared: Prepared, spec: LagrangianSpray) -> CoarserGas:
    """The spray on cells of gas twice as large, or the reason why there is none."""
    vapour, h_m = prepared.spray.vapour, spec.box.spacing_m
    assert vapour is not None
    larger_m = _LARGER * h_m
    edges_m = vapour.cells.upper_m - vapour.cells.lower_m
    if not np.allclose(edges_m, h_m, rtol=1e-6):
        return CoarserGas(None, f"the spray was given, on other cells than {_FLOW_KEY}")
    long_m = float(np.max(vapour.cells.upper_m.max(axis=0) - vapour.cells.lower_m.min(axis=0)))
    if long_m < (_FEWEST - 1e-6) * larger_m:
        why = (
            f"cells twice as large are {long_m / larger_m:.3g} along the vapour, and below "
            f"{_FEWEST} no order is known; allowed: a smaller {_FLOW_KEY}"
        )
        return CoarserGas(None, why)
    if larger_m > _LARGEST_M:
        return CoarserGas(None, f"cells twice as large are above {_LARGEST_M:g} m")
    box = spec.box.model_copy(update={"spacing_m": larger_m})
    try:
        sources = prepared.resprayed(spec.model_copy(update={"box": box}))
    except (SprayError, OpticsError) as error:
        return CoarserGas(None, f"the spray on cells twice as large: {error}")
    sources, lost = within(prepared.cube, sources)
    if lost > _MOST_LOST:
        why = (
            f"{100 * lost:.2g} % of the spray on cells twice as large lies outside the domain; "
            "allowed: a larger domain.edge_m"
        )
        return CoarserGas(None, why)
    how = f"step from cells of gas of {1e3 * larger_m:.3g} to {1e3 * h_m:.3g} mm, by first order"
    return CoarserGas(sources, how)


def without_chance(found: ImageDifference, sampling_K: float | None) -> tuple[ImageDifference, str]:
    """Subtracts the random part of two sprays from their difference.

    `sampling_K` is the RMS of the random part of one spray. If it is unknown, or contributes more
    than half of the square, the difference stays whole: an upper bound. The text says which.
    """
    if found.error_K is None:
        return found, ""
    if sampling_K is None:
        return found, "at most: it contains the random part of both sprays"
    square = found.error_K**2 - 2.0 * sampling_K**2
    if square < _HALF * found.error_K**2:
        return found, "at most: chance may contribute half of its square"
    return found.times(square**0.5 / found.error_K), "random part of both sprays subtracted"


GAS_GRID = _GasGrid()
