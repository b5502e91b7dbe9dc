"""Error by the grid that the gas is computed on.

The lattice of a cone is varied by factors of two and four, and the error extrapolated. A computed
gas is computed again on cells twice and four times as large. Its droplets start alike on all three,
and the eddies that a droplet meets are drawn by its number and time, so the random part of all
three sprays is the same and the differences are the grid's. The ratio of the two steps to half of
the cells and their correlation give the error (`Rest`). The vapour's penetration, which the heads
of the plumes set, gets an error by the same three sprays. A gas that is read comes on one grid
alone: what is stated is the error of its linear reconstruction (`cldit.medium.gas_reconstruction`),
by the same gas in cells twice and four times as large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution, gas_is_free, lattice_is_cells
from cldit.accuracy.richardson import extrapolated, richardson
from cldit.accuracy.sources.base import ErrorSource, remedies
from cldit.accuracy.variant_tracer import NO_COARSER_LATTICE, VariantTracer
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
# Ratio of the displacements of two steps, and the fastest that is relied on: between first order,
# of fronts, and second, of smooth gas. In 27 rows of
# docs/benchmarks/error-sources.md stated / true is 0.70 to 2.4; with 0.5 it was 0.94 to 3.1.
_FASTEST = 0.375
_SLOWEST = 0.75  # displacements that fall by less need not converge
_HEAD = "vapour_penetration_m"  # of the figures of a spray
_FINEST_LATTICE_m = 0.1e-3
_CONE_KEY, _FLOW_KEY, _FILE_KEY = "spray.spacing_m", "spray.box.spacing_m", "spray.file"
ORDER = "order of the gas grid"

Coarser = tuple[Sources, float]  # sources of a spray, and its vapour's penetration in m


class _GasGrid(ErrorSource):
    """The lattice of a cone, or the grid of a computed or imported gas."""

    name = "gas grid"
    shared_by = "spray"
    # As dear as cells: a computed gas on half the cells takes 3 to 12 times as long.
    cost_power = 3.0
    of_spray = True
    remedy = remedies(
        "a smaller spray.spacing_m, or spray.box.spacing_m of a computed spray",
        spray__spacing_m="a smaller spray.spacing_m, or none, so that the run chooses",
        spray__box__spacing_m="a smaller spray.box.spacing_m (half takes 3 to 12 times as long), "
        "or none, so that the run chooses",
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
            return not (prepared.on_lattice or prepared.is_empty)
        return prepared.spray.vapour is not None

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        cone = at.prepared.cone
        if cone is None:
            return self._grid(at)
        if at.image is None:
            return self._lattice(at, cone)
        if self.name in at.predicted:
            return [at.predicted[self.name].at(cone.lattice_m)]
        twice, four = (f"{1e3 * up * cone.lattice_m:.3g}" for up in (2, 4))
        reason = (
            f"no estimate from lattices of {twice} and {four} mm, which do not resolve the plumes "
            f"or reach out of the domain; allowed: a smaller {_CONE_KEY}"
        )
        return [Estimate.unknown(self.name, reason)]

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        if old.gas_m is not None:
            return old.with_gas(old.gas_m / 2)  # the sprays on its coarser cells are there
        if old.spacing_m is None:
            return old
        spacing_m = old.spacing_m / ratio ** (1.0 / order)
        return replace(old, spacing_m=max(spacing_m, _FINEST_LATTICE_m))

    def _lattice(self, at: VariantTracer, cone: ConeSpray) -> list[Estimate]:
        at.tell("errors: a lattice twice and four times as coarse")
        try:
            coarser, coarsest = (at.on_lattice(up)[1] for up in (2, 4))
        except NO_COARSER_LATTICE:
            return []
        estimates = richardson(at, (at.level(at.coarse_m), coarser, coarsest))
        sizes = ", ".join(f"{1e3 * up * cone.lattice_m:.3g}" for up in (1, 2, 4))
        method = f"cone on lattices of {sizes} mm"
        options = {"at_most": estimates[0].bound_K is not None, "size": cone.lattice_m}
        return [extrapolated(self.name, method, estimates, **options)]

    def _grid(self, at: VariantTracer) -> list[Estimate]:
        spec = at.prepared.spec
        if not isinstance(spec, LagrangianSpray):
            reason = "the gas comes on one grid alone; compare with a run from a finer one"
            return [*self._imported(at), Estimate.unknown(ORDER, reason)]
        twice = self._traced(at, spec, 2)
        if isinstance(twice, str):
            return [Estimate.unknown(self.name, twice)]
        image_2h, head_m = twice
        heads_m = [at.prepared.spray.notes[_HEAD], head_m]
        image = at.level(at.cell_m)
        fine_steps = at.difference(image, image_2h)
        h_mm = 1e3 * spec.box.cell_m
        method = f"step from cells of gas of {2 * h_mm:.3g} to {h_mm:.3g} mm with the same eddies"
        again = self._traced(at, spec, 4)
        rests: list[Rest | str]
        if isinstance(again, str):
            rests = [again]
        else:
            image_4h, head_m = again
            heads_m.append(head_m)
            coarse_steps, sums = (at.difference(i, image_4h) for i in (image_2h, image))
            triples = zip(fine_steps, coarse_steps, sums, strict=True)
            rests = [Rest.of(*(step.error_K for step in triple)) for triple in triples]
        remainder = rests[0]
        figures = {_HEAD: head_error_m(heads_m)}
        if isinstance(remainder, str):
            stated = Estimate.of(self.name, fine_steps, method)
            return [replace(stated, figures=figures), Estimate.unknown(ORDER, remainder)]
        method += f", times {remainder.factor:.2g}: steps fall by {remainder.ratio:.2g}, "
        method += f"correlation {remainder.correlation:.2g}"
        factors = ((remainder if isinstance(rest, str) else rest).factor for rest in rests)
        errors = [step.times(factor) for step, factor in zip(fine_steps, factors, strict=True)]
        h_m = spec.box.cell_m
        stated = Estimate.of(self.name, errors, method, order=remainder.order, size=h_m)
        return [replace(stated, figures=figures)]

    def _imported(self, at: VariantTracer) -> list[Estimate]:
        """The error of linear cells, by the same gas in cells twice and four times as large."""
        gas, images = at.prepared.made.vapour, [at.level(at.cell_m)]
        for times in _TIMES.values():
            gas = None if gas is None else coarsened(gas)
            if gas is None:
                return [Estimate.unknown(self.name, "its cells are on no lattice")]
            name = f"gas averaged over cells {times} as large"
            at.tell(f"errors: {name}")
            larger = replace(at.prepared.spray, vapour=reconstructed(gas))
            try:
                image = at.variant(name, partial(at.prepared.sources_of, larger), at.cell_m)
            except (MediumError, TransportError) as error:  # larger cells reach further
                return [Estimate.unknown(self.name, f"{name}: {error}")]
            images.append(image)
        method = "gas averaged over cells twice and four times as large, linear in all"
        return [extrapolated(self.name, method, richardson(at, images))]

    def _traced(
        self, at: VariantTracer, spec: LagrangianSpray, up: int
    ) -> tuple[ImagePair, float] | str:
        """Image of the spray on cells of gas `up` times as large, and the vapour's penetration; or
        why there is none."""
        name = f"gas on cells {_TIMES[up]} as large"
        gas: Coarser | str = at.prepared.variant(name, lambda: coarser_gas(at.prepared, spec, up))
        if isinstance(gas, str):
            return gas
        at.tell(f"errors: {name}")
        sources, head_m = gas
        try:
            # On the image's own cells: larger ones would blur those of the gas.
            return at.variant(name, lambda: sources, at.cell_m), head_m
        except (MediumError, TransportError) as error:  # it fills more cells, or reaches further
            return f"the spray on larger cells of gas: {error}"


def coarser_gas(prepared: Prepared, spec: LagrangianSpray, up: int) -> Coarser | str:
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
        with prepared.stages.stage(f"spray on cells of gas {_TIMES[up]} as large"):
            spray = prepared.other_spray(spec.on_gas(larger_m))
            sources = prepared.sources_of(spray)
    except (SprayError, OpticsError) as error:
        return f"the spray on {name}: {error}"
    sources, lost = within(prepared.cube, sources)
    if lost > _MOST_LOST:
        return (
            f"{100 * lost:.2g} % of the spray on {name} lies outside the domain; allowed: a "
            "larger domain.edge_m"
        )
    return sources, spray.notes[_HEAD]


def head_error_m(heads_m: Sequence[float]) -> float:
    """Error of the vapour's penetration on the first of grids, each of twice the cells of the one
    before: the larger one by first order from any step, since steps change sign."""
    steps_m = np.abs(np.diff(heads_m))
    return float(np.max(steps_m * 0.5 ** np.arange(len(steps_m))))


@dataclass(frozen=True)
class Rest:
    """Error of the image on the finest of three grids, over the last step between them.

    A grid displaces the plumes. Where T_app is smooth it changes in proportion, and the changes by
    two steps correlate. At a front the RMS grows as the root of the displacement, and two steps
    change different pixels. So with a correlation c the RMS is taken to grow as the power
    (1 + c) / 2 of the displacement: exact for c of 0 and 1.

    factor: the error over the last step. order: power of the cell with which the error falls.
    ratio: of a step to the one before. correlation: of both.
    """

    factor: float
    order: float
    ratio: float
    correlation: float

    @classmethod
    def of(cls, last_K: float | None, before_K: float | None, both_K: float | None) -> Rest | str:
        """The sum by the last step, the one before, and that over both; or why it is unknown."""
        if not last_K or not before_K or both_K is None:
            return "a step is unknown"
        ratio = last_K / before_K
        alike = (both_K**2 - last_K**2 - before_K**2) / (2.0 * last_K * before_K)
        correlation = min(max(alike, 0.0), 1.0)
        power = (1.0 + correlation) / 2.0
        displacements = max(float(ratio ** (1.0 / power)), _FASTEST)
        if displacements > _SLOWEST:
            return (
                f"the steps are {before_K:.2g} and {last_K:.2g} K: no convergence is seen; "
                f"allowed: a smaller {_FLOW_KEY}"
            )
        factor = (displacements / (1.0 - displacements)) ** power  # Richardson's, of displacements
        return cls(float(factor), -power * math.log2(displacements), ratio, correlation)


GAS_GRID = _GasGrid()
