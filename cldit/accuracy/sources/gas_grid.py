"""Error by the grid that the gas is computed on.

The lattice of a cone is varied by factors of two and four, and the error extrapolated. A computed
gas is computed again on cells twice and four times as large. Its droplets start alike on all three,
and the eddies that a droplet meets are drawn by its number and time, so the random part of all
three sprays is the same and the differences are the grid's. Each step to half of the cells is
smaller than the one before by a ratio, and correlates with it. Both are measured, and the steps
that are left are summed with them: with full correlation that is Richardson's extrapolation,
without any a sum of squares. A gas that is read comes on one grid alone: what is stated is the
error of its linear reconstruction (`cldit.medium.gas_reconstruction`), by the same gas in cells
twice and four times as large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution, gas_is_free, lattice_is_cells
from cldit.accuracy.richardson import RichardsonEstimate
from cldit.accuracy.sources.base import NO_COARSER_LATTICE, ErrorSource, Measurement, remedies
from cldit.errors import MediumError, OpticsError, SprayError, TransportError
from cldit.medium.gas_reconstruction import coarsened, reconstructed
from cldit.medium.octree import Sources
from cldit.medium.resolution import within
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray

_TIMES = {2: "twice", 4: "four times"}
_LARGEST_M = 1e-2  # that a scene may have
_FEWEST = 6  # cells along the vapour, where a plume has three across
# The part that is cut off changes T_app by less than this share of the spray: 0.1 K of 100 K.
_MOST_LOST = 1e-3
_SMALLEST_RATIO = 0.5  # as for first order: 0.38 between coarse grids was 0.65 at the next
_LARGEST_RATIO = 0.75  # steps that fall by less need not converge
_FINEST_LATTICE_m = 0.1e-3
_CONE_KEY, _FLOW_KEY, _FILE_KEY = "spray.spacing_m", "spray.box.spacing_m", "spray.file"
ORDER = "order of the gas grid"


class _GasGrid(ErrorSource):
    """The lattice of a cone, or the grid of a computed or imported gas."""

    name = "gas grid"
    shared_by = "spray"
    # A computed gas on half the cells takes 3 to 12 times as long, and most of a run: as dear as
    # cells, or gas is made finer for an error that cells would mend in a second.
    cost_power = 3.0
    of_spray = True
    remedy = remedies(
        "a smaller spray.spacing_m, or spray.box.spacing_m of a computed spray",
        spray__spacing_m="a smaller spray.spacing_m, or none, so that the run chooses",
        spray__box__spacing_m="a smaller spray.box.spacing_m (half takes 3 to 12 times as long)",
        spray__file="finer cells in the file",
    )
    also = (ORDER,)

    def key(self, scene: Scene) -> str:
        if isinstance(scene.spray, ConeSpray):
            return "" if scene.spray.spacing_m is None else _CONE_KEY
        if isinstance(scene.spray, LagrangianSpray):
            return "" if gas_is_free(scene) else _FLOW_KEY
        return _FILE_KEY

    def is_free(self, scene: Scene) -> bool:
        if gas_is_free(scene):
            return True
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
            imported = not isinstance(at.scene.spray, LagrangianSpray)
            known = self._imported(at) if imported and self.applies(at.prepared) else []
            return [*known, *self.predict(at)]
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

    def finer(self, now: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        if now.gas_m is not None:
            return now.with_gas(now.gas_m / min(ratio ** (1.0 / order), 2.0))
        if now.spacing_m is None:
            return now
        spacing_m = now.spacing_m / ratio ** (1.0 / order)
        return replace(now, spacing_m=max(spacing_m, _FINEST_LATTICE_m))

    def _lattice(self, at: Measurement) -> list[Estimate]:
        cone, tracer = at.prepared.cone, at.tracer
        assert cone is not None
        at.stages.tell("errors: a lattice twice and four times as coarse")
        try:
            coarser, coarsest = (at.on_lattice(up)[1] for up in (2, 4))
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
        fixed, spec = self.key(at.scene), at.prepared.spec
        if not isinstance(spec, LagrangianSpray):
            why = "the gas comes on one grid alone; compare with a run from a finer one"
            return [Estimate.unknown(ORDER, why, fixed)]
        first = self._traced(at, spec, 2)
        if isinstance(first, str):
            return [Estimate.unknown(self.name, first, fixed)]
        tracer = at.tracer
        image = tracer.level(at.depth)
        last = tracer.difference(image, first)
        h_mm = 1e3 * spec.box.cell_m
        how = f"step from cells of gas of {2 * h_mm:.3g} to {h_mm:.3g} mm with the same eddies"
        second = self._traced(at, spec, 4)
        left: Rest | str
        if isinstance(second, str):
            left = second
        else:
            both = tracer.difference(image, second)
            left = Rest.of(last.error_K, tracer.difference(first, second).error_K, both.error_K)
        if isinstance(left, str):
            stated = Estimate.of(self.name, last, how, fixed)
            return [stated, Estimate.unknown(ORDER, left, fixed)]
        how += f", times {left.factor:.2g}: {left.text}"
        found = last.times(left.factor)
        return [Estimate.of(self.name, found, how, fixed, order=left.order, size=spec.box.cell_m)]

    def _imported(self, at: Measurement) -> list[Estimate]:
        """The error of linear cells, by the same gas in cells twice and four times as large."""
        gas, images = at.prepared.made.vapour, [at.tracer.level(at.depth)]
        for times in _TIMES.values():
            gas = None if gas is None else coarsened(gas)
            if gas is None:
                return [Estimate.unknown(self.name, "its cells are on no lattice")]
            name = f"gas averaged over cells {times} as large"
            at.stages.tell(f"errors: {name}")
            larger = replace(at.prepared.spray, vapour=reconstructed(gas))
            try:
                made = at.tracer.variant(name, partial(at.prepared.sources_of, larger), at.depth)
            except (MediumError, TransportError) as error:  # larger cells reach further
                return [Estimate.unknown(self.name, f"{name}: {error}")]
            images.append(made)
        last, before = (at.tracer.difference(*pair) for pair in pairwise(images))
        found = RichardsonEstimate.of(before, last)
        how = (
            "gas averaged over cells twice and four times as large, linear in all; extrapolated by "
        )
        how += f"order {found.order:.2g}"
        return [Estimate.of(self.name, found.difference, how, "", order=found.order)]

    def _traced(self, at: Measurement, spec: LagrangianSpray, up: int) -> ImagePair | str:
        """Image of the spray on cells of gas `up` times as large, or why there is none."""
        name = f"gas on cells {_TIMES[up]} as large"
        gas: Sources | str = at.prepared.variant(name, lambda: _coarser_gas(at, spec, up))
        if isinstance(gas, str):
            return gas
        at.stages.tell(f"errors: {name}")
        try:
            # On the image's own cells: larger ones would blur those of the gas.
            return at.tracer.variant(name, lambda: gas, at.depth)
        except (MediumError, TransportError) as error:  # it fills more cells, or reaches further
            return f"the spray on larger cells of gas: {error}"


def _coarser_gas(at: Measurement, spec: LagrangianSpray, up: int) -> Sources | str:
    with at.stages.stage(f"spray on cells of gas {_TIMES[up]} as large"):
        return coarser_gas(at.prepared, spec, up)


def coarser_gas(prepared: Prepared, spec: LagrangianSpray, up: int) -> Sources | str:
    """The spray on cells of gas `up` times as large, or the reason why there is none."""
    vapour, h_m = prepared.spray.vapour, spec.box.cell_m
    assert vapour is not None
    larger_m, name = up * h_m, f"cells {_TIMES[up]} as large"
    if prepared.spray.notes.get("gas_spacing_m") != h_m:
        return f"the spray was given, on other cells than {_FLOW_KEY}"
    long_m = float(np.max(vapour.cells.upper_m.max(axis=0) - vapour.cells.lower_m.min(axis=0)))
    if long_m < (_FEWEST - 1e-6) * larger_m:
        return (
            f"{name} are {long_m / larger_m:.3g} along the vapour, and below {_FEWEST} no order is "
            f"known; allowed: a smaller {_FLOW_KEY}"
        )
    if larger_m > _LARGEST_M:
        return f"{name} are above {_LARGEST_M:g} m"
    try:
        sources = prepared.resprayed(spec.on_gas(larger_m))
    except (SprayError, OpticsError) as error:
        return f"the spray on {name}: {error}"
    sources, lost = within(prepared.cube, sources)
    if lost > _MOST_LOST:
        return (
            f"{100 * lost:.2g} % of the spray on {name} lies outside the domain; allowed: a "
            "larger domain.edge_m"
        )
    return sources


@dataclass(frozen=True)
class Rest:
    """Sum of the steps to ever smaller cells that are left, over the last step.

    ratio: of a step to the one before; correlation: of both.
    """

    ratio: float
    correlation: float

    @classmethod
    def of(cls, last_K: float | None, before_K: float | None, both_K: float | None) -> Rest | str:
        """The sum by the last step, the one before, and that over both; or why it is unknown."""
        if not last_K or not before_K or both_K is None:
            return "a step is unknown"
        ratio = last_K / before_K
        if ratio > _LARGEST_RATIO:
            return (
                f"the steps are {before_K:.2g} and {last_K:.2g} K: no convergence is seen; "
                f"allowed: a smaller {_FLOW_KEY}"
            )
        alike = (both_K**2 - last_K**2 - before_K**2) / (2.0 * last_K * before_K)
        return cls(max(ratio, _SMALLEST_RATIO), min(max(alike, 0.0), 1.0))

    @property
    def factor(self) -> float:
        """Root of the sum of r^(j + k) c^|j - k| over all j, k >= 1."""
        r, c = self.ratio, self.correlation
        return float((r**2 / (1 - r**2) * (1 + c * r) / (1 - c * r)) ** 0.5)

    @property
    def order(self) -> float:
        """Power of the cell with which the steps fall."""
        return -math.log2(self.ratio)

    @property
    def text(self) -> str:
        """Ratio and correlation."""
        return f"steps fall by {self.ratio:.2g}, correlation {self.correlation:.2g}"


GAS_GRID = _GasGrid()
