"""A scene traced by a plan, its errors measured, and traced again where they are too large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from cldit.accuracy.budget import Budget, Sized
from cldit.accuracy.cells import Cells, choose_cells, error_at, foretold_cells, too_fine, too_many
from cldit.accuracy.error_maps import error_maps
from cldit.accuracy.errors import Cause, Errors
from cldit.accuracy.evaluation import evaluated, sensor_of
from cldit.accuracy.fixed_causes import fixed_causes, foreseen
from cldit.accuracy.lattice_memory import hardly_finer, held
from cldit.accuracy.outcome import Attempt
from cldit.accuracy.picture import Picture, Step
from cldit.accuracy.pilot import Pilot
from cldit.accuracy.plan import Plan, free_causes
from cldit.accuracy.spectral import (
    Difference,
    NodeTraces,
    node_settings,
    trace_nodes,
    traced_stages,
)
from cldit.accuracy.trace_error import StatedError
from cldit.errors import MediumError, SprayError
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, build_octree
from cldit.optics.spectral import Quadrature
from cldit.prepare.medium import Medium, Prepared, prepare
from cldit.prepare.probed import Probed
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, GridSpray
from cldit.spray.result import Spray
from cldit.transport.trace import Settings, settings_for, trace

Found = list[tuple[Cause, Step | None]]


@dataclass
class Attempts:
    """Traces a scene until its error is what was asked for, or cannot be made smaller.

    What a plan leaves as it was (spray and optics, coarse traces, measured causes) is kept from one
    attempt to the next.
    """

    scene: Scene
    device: Device
    stages: Stages
    cache: Path
    spray: Spray | None
    _prepared: tuple[Scene, Prepared] | None = None
    _pilot: tuple[Scene, Pilot] | None = None
    _sources: Found | None = None
    _sized: dict[str, Sized] = field(default_factory=dict)

    def best(self) -> Attempt:
        """The last attempt.

        Raises:
            ClditError: as `cldit.simulate`.
        """
        plan = Plan.first(self.scene)
        if not self.scene.transport.audit:
            self.stages.remark((_NO_AUDIT,))
        before: Attempt | None = None
        while True:
            made = self._made(plan)
            if before is not None and _errs_more(made, before):
                # Memory did not hold what was wanted, and less is worse than what there was.
                self.stages.remark((_KEPT.format(before=before.errors, made=made.errors),))
                made = replace(before, plan=replace(before.plan, limited=made.plan.limited))
                break
            better = self._better(made)
            if better is not None:
                limited = hardly_finer(better, made.plan, self._prepared)
                if limited:
                    made = replace(made, plan=replace(made.plan, limited=limited))
                    better = self._better(made)
            if better is None:
                break
            self.stages.remark((_again(made, better),))
            plan, before = better, made
        self._conclude(made)
        return made

    def _better(self, made: Attempt) -> Plan | None:
        """A plan for what errs too much; None: nothing can be made smaller."""
        if made.errors is None:
            return None
        return made.plan.refined(
            made.errors,
            self.scene,
            reducible=self._reducible(made),
            orders=self._orders(made.plan),
        )

    def against_paper(self, last: Attempt) -> Difference | None:
        """Difference from the paper's optical properties; None where it is not wanted."""
        if last.medium.paper is None:
            return None
        with self.stages.stage("the paper's properties"):
            scene = last.plan.scene(self.scene)
            grey = settings_for(scene, last.medium.properties.paper_phase)
            other = trace(last.medium.paper, scene, self.device, grey).weights
            chosen = last.quadrature
            one = Quadrature.grey(chosen.filter_um, reference_K=chosen.reference_K)
            maps = evaluated(self.scene, one, (other,), last.reference, last.sensor)
            return Difference.of(last.maps, maps)

    def _made(self, plan: Plan) -> Attempt:
        plan, prepared = self._prepare(plan)
        scene = plan.scene(self.scene)
        properties = prepared.properties
        quadrature = properties.chosen.quadrature
        settings = node_settings(scene, quadrature, properties.phases)
        pilot = None
        if prepared.probed is not None:
            number = prepared.probed.number
            settings[number] = replace(settings[number], subpixels=True)
            pilot = self._piloted(scene, prepared.probed, settings)
            if plan.depth is None:
                settled = self._knowing(plan, pilot)
                if settled.scene(self.scene) == scene:
                    settled = self._settled(settled, pilot)
                    self.stages.remark(settled.bounded())
                if settled.scene(self.scene) != scene:
                    return self._made(settled)
                plan = settled
        try:
            plan, medium = self._grown(prepared, plan)
        except MediumError:
            if plan.lattice_of_m is None or plan.depth is None or plan.depth <= 3:
                raise
            assert plan.spacing_m is not None
            coarser = plan.on_lattice(_COARSER * plan.spacing_m)
            return self._made(replace(coarser, limited=plan.limited or too_many(plan.spacing_m)))
        frame = medium.trees[0].frame
        say = self.stages.say
        result = trace_nodes(medium.trees, quadrature, scene, self.device, settings, report=say)
        grey = settings_for(scene, properties.paper_phase)
        reference = trace(_nothing(frame), scene, self.device, grey).weights
        self.stages.done += traced_stages(result, scene.transport.order)
        with self.stages.stage("evaluation"):
            sensor = sensor_of(scene, quadrature, (result.spectral, reference))
            maps = evaluated(scene, quadrature, result.spectral, reference, sensor)
        stated = StatedError.of(scene, result, maps)
        errors, images = None, {}
        if pilot is not None:
            with self.stages.stage("errors"):
                of_cells = self._of_cells(pilot, result, plan)
                if stated is not None:
                    known = {cause.name: cause.error_K for cause, _ in of_cells}
                    stated = stated.beyond(known.get("cells"))
                found = self._causes(pilot, medium, stated, plan, of_cells)
                errors = Errors.of(cause for cause, _ in found)
                maps_K = {cause.name: step.map_K for cause, step in found if step is not None}
                images = error_maps(errors, maps_K, maps.has_temperature)
        return Attempt(
            self.scene, plan, medium, result, reference, maps, sensor, stated, errors, images
        )

    def _prepare(self, plan: Plan) -> tuple[Plan, Prepared]:
        """Spray and optics; kept where the plan does not change them. A lattice that is too fine
        for the cone becomes as fine as it may be."""
        given_m = self.scene.spray.lattice_m if isinstance(self.scene.spray, ConeSpray) else 0.0
        while True:
            plan = held(plan, self._prepared)
            scene = plan.scene(self.scene)
            alike = scene.model_copy(update={"transport": self.scene.transport})
            if self._prepared is not None and self._prepared[0] == alike:
                return plan, self._prepared[1]
            try:
                prepared = prepare(
                    scene,
                    self.device,
                    self.stages,
                    self.cache,
                    self.spray,
                    lattice_of_m=plan.lattice_of_m,
                )
            except SprayError:
                tried_m = plan.spacing_m
                if tried_m is None or tried_m == given_m:
                    raise
                if tried_m > given_m:  # a short plume: the lattice to learn from is too coarse
                    plan = replace(plan, spacing_m=given_m)
                    continue
                coarser_m = min(_COARSER * tried_m, given_m)
                if plan.lattice_of_m is not None:
                    plan = replace(plan.on_lattice(coarser_m), limited=too_fine(coarser_m))
                plan = replace(plan, spacing_m=coarser_m, finest_lattice=True)
                continue
            self._prepared, self._sources = (alike, prepared), None
            return plan, prepared

    def _piloted(self, scene: Scene, probed: Probed, settings: Sequence[Settings]) -> Pilot:
        """Coarse traces; kept where the plan does not change ordinates."""
        if self._pilot is None or self._pilot[0] != scene:
            before = None if self._pilot is None else self._pilot[1]
            mine = settings[probed.number]
            self._pilot = scene, Pilot.of(scene, self.device, mine, probed, before)
        return self._pilot[1]

    def _knowing(self, plan: Plan, pilot: Pilot) -> Plan:
        """The plan that knows what the scene errs by whatever is chosen."""
        if plan.fixed is not None or self._nothing_there(pilot):
            return plan
        with self.stages.stage("pilots of fixed causes") as note:
            causes = fixed_causes(self.scene, pilot, self.stages.tell)
            note.append(", ".join(f"{one.name} {one.text}" for one in causes) or "none")
        return plan.knowing(self.scene, causes).shared(self.scene)

    def _settled(self, plan: Plan, pilot: Pilot) -> Plan:
        """The plan with its cells, chosen or fixed; classes and lattice for what these leave."""
        points, boxes = pilot.probed.sources
        depth = pilot.probed.frame.depth
        if points is None and not boxes:
            return replace(plan, depth=depth)
        if isinstance(self.scene.spray, GridSpray):
            chosen = Cells(depth, None)
        elif "cells" not in free_causes(self.scene):
            chosen = foretold_cells(pilot, depth)
        else:
            plan, found = self._chosen_cells(plan, pilot)
            chosen = found or Cells(depth, None)
        plan = plan.at_depth(chosen.depth, chosen.limited)
        if plan.lattice_of_m is not None and plan.spacing_m is not None:
            plan = plan.on_lattice(plan.spacing_m * chosen.less)
        with self.stages.stage("pilots of the spray"):
            self._sized = Budget(self.scene, pilot, chosen.depth, self.stages.tell).sized()
        known = {
            name: (one.step.error_K, one.order)
            for name, one in self._sized.items()
            if one.step.error_K is not None
        }
        return plan.settled(self.scene, chosen.error_K, known)

    def _chosen_cells(self, plan: Plan, pilot: Pilot) -> tuple[Plan, Cells | None]:
        """The plan that knows what the pilots foretell of other causes, and its cells."""

        def knowing(picture: Picture) -> Plan:
            return foreseen(plan, self.scene, pilot, picture, self.stages.tell)

        with self.stages.stage("pilots") as note:
            chosen = choose_cells(pilot, lambda one: knowing(one).cells_K, self.stages.tell)
            plan = knowing(pilot.kept[max(pilot.kept)])
            if chosen is None:
                note.append("no pixel has a T_app: cells as the paper's")
            else:
                cell_mm = 1e3 * pilot.probed.frame.edge_m / 2**chosen.depth
                note.append(f"cells of {cell_mm:.3g} mm for {plan.cells_K:.2g} K")
        return plan, chosen

    def _grown(self, prepared: Prepared, plan: Plan) -> tuple[Plan, Medium]:
        """The medium; on larger cells where those of the plan do not fit the memory."""
        if plan.lattice_of_m is not None:  # cells and lattice were made together
            return plan, prepared.grown(self.stages)
        fixed = "cells" not in free_causes(self.scene) or plan.depth is None
        while True:
            try:
                return plan, prepared.grown(self.stages, plan.depth)
            except MediumError:
                if fixed or plan.depth is None or plan.depth <= 3:
                    raise
                plan = _coarser(plan, prepared.frame.edge_m)

    def _of_cells(self, pilot: Pilot, result: NodeTraces, plan: Plan) -> Found:
        if self._nothing_there(pilot):
            return []
        assert plan.depth is not None
        budget = Budget(self.scene, pilot, plan.depth, self.stages.tell)
        if self.scene.transport.method != "source":
            return budget.of_cells_by_pilot()
        exact = not result.scatters or self.scene.transport.order == 0
        picture = Picture.of(result.traces[pilot.probed.number])
        return budget.of_cells(picture, audited=exact or result.audit is not None)

    def _causes(
        self,
        pilot: Pilot,
        medium: Medium,
        stated: StatedError | None,
        plan: Plan,
        of_cells: Found,
    ) -> Found:
        found: Found = []
        if self._nothing_there(pilot):
            return found
        for cause in () if stated is None else stated.causes:
            fixed = "" if self.scene.transport.directions is None else "transport.directions"
            map_K = None if stated is None or cause.name != "trace" else stated.map_K
            step = None if map_K is None else Step(cause.error_K, map_K)
            found.append((replace(cause, fixed=fixed), step))
        spectral = medium.properties.chosen
        if spectral.errors_K:
            how = f"{len(spectral.nodes)} nodes against more, on lines of sight through the spray"
            optics = self.scene.optics
            fixed = "optics.wavelengths" if optics.wavelengths is not None else ""
            fixed = fixed or ("optics.spectral_error_K" if optics.spectral_error_K else "")
            found.append((Cause("wavelengths", spectral.error_K, how, fixed), None))
        assert plan.depth is not None
        budget = Budget(self.scene, pilot, plan.depth, self.stages.tell)
        if self._sources is None:
            self._sources = budget.of_sources()
        sizes = {
            "size classes": 1.0 / (plan.size_classes or 1),
            "gas grid": plan.spacing_m or 0.0,
        }
        sized = [one.at(sizes[name]) for name, one in self._sized.items()]
        return [*found, *of_cells, *self._sources, *sized, *budget.unsized(self._sized)]

    def _nothing_there(self, pilot: Pilot) -> bool:
        """Whether camera and background have nothing between them that a trace could get wrong."""
        points, boxes = pilot.probed.sources
        return points is None and not boxes and not self.scene.patches

    def _orders(self, plan: Plan) -> dict[str, float]:
        """In which errors fall with what makes them: lattice, classes, cells that are the lattice.

        Other cells are halved, whatever their order: none is traced for it.
        """
        orders = {name: one.order for name, one in self._sized.items()}
        if self._pilot is not None and plan.depth is not None and plan.lattice_of_m is not None:
            found = error_at(self._pilot[1], plan.depth)
            if found is not None:
                orders["cells"] = found.order
        return orders

    def _reducible(self, made: Attempt) -> set[str]:
        """Causes that another plan can make smaller."""
        free = set(free_causes(self.scene))
        if made.plan.limited:
            free.discard("cells")
        if made.plan.finest_lattice:
            free.discard("gas grid")
        if made.stated is None or not made.stated.can_shrink or made.result.short:
            free.discard("trace")
        return free

    def _conclude(self, made: Attempt) -> None:
        """Remarks on what is not known, and on what is more than was asked for."""
        self.stages.remark(made.result.short)
        wanted = self.scene.transport
        if made.errors is not None:
            unknown = () if made.stated is None else made.stated.unknown_remarks
            limits = made.plan.limits
            self.stages.remark((*unknown, *made.errors.remarks(wanted.accuracy_K, limits)))
        elif made.stated is not None:
            self.stages.remark(made.stated.remarks(wanted))


_COARSER = 1.15  # steps to the finest lattice that a cone takes, or that memory holds
_KEPT = "error {made.text}: the picture before, of {before.text}, is kept"
_NO_AUDIT = (
    "transport.audit: false: transport.accuracy_K is that of the trace alone, and the error of the "
    "picture is not measured"
)


def _errs_more(made: Attempt, before: Attempt) -> bool:
    """Whether a picture that was to err less than the one before errs more."""
    if made.errors is None or before.errors is None:
        return False
    now_K, then_K = made.errors.total_K, before.errors.total_K
    return now_K is not None and then_K is not None and now_K > then_K


def _coarser(plan: Plan, edge_m: float) -> Plan:
    assert plan.depth is not None
    return plan.at_depth(plan.depth - 1, too_many(edge_m / 2**plan.depth))


def _again(made: Attempt, better: Plan) -> str:
    assert made.errors is not None
    largest = made.errors.largest()
    assert largest is not None
    return (
        f"error {made.errors.text}, {largest.text} of it by {largest.name}: refined, "
        f"{better.refinements} of at most 2 times"
    )


def _nothing(frame: Frame) -> Octree:
    """The same cube without a spray."""
    return build_octree(frame, None, [], optical_depth_split=1.0)
