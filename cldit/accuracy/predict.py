"""Prediction: coarse traces tell the resolution that a scene needs for a tolerance.

Sources that the scene fixes are estimated first, on the coarsest cells: if they alone exceed the
tolerance, finer cells, ordinates and wavelengths that add little to them are in vain. Then the
cells are chosen by traces on finer and finer ones. The image of the run is one of these traces, or
the next.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cldit.accuracy.allocation import Allocation, free_sources
from cldit.accuracy.errors import Estimate
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution, too_many
from cldit.accuracy.richardson import SAFE, error_at
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.base import ErrorSource
from cldit.accuracy.sources.discretisation import spectral_K
from cldit.accuracy.trace_error import TraceError
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import DEEPEST
from cldit.prepare.medium import Prepared
from cldit.prepare.preview import coarsest_depth
from cldit.scene import Scene
from cldit.scene.spray import GridSpray

_NO_AUDIT = (
    "transport.audit: false: transport.accuracy_K applies to the trace alone, and the error of the "
    "image is not estimated"
)


def predict(problem: Problem, tolerance_K: float) -> tuple[Resolution, Allocation]:
    """The resolution that a scene needs for a tolerance, and the error allocated to each source."""
    scene = problem.scene
    start = Resolution.first(scene, ordinates_K=tolerance_K, spectral_K=scene.optics.bound_K)
    if start.gas_m is not None and problem.spray is not None:
        gas_m = problem.spray.notes.get("gas_spacing_m", start.gas_m)
        start = replace(start, gas_m=gas_m).limited("gas grid", "the spray was given")
    if not scene.transport.audit:
        problem.stages.remark((_NO_AUDIT,))
        return start, Allocation(tolerance_K, {})
    allocation = Allocation.of(scene, tolerance_K)
    resolution, tracer = problem.tracer(_asked(start, scene, allocation))
    if not tracer.prepared.is_clear:
        with problem.stages.stage("coarsest traces") as note:
            estimates = coarse_estimates(tracer)
            fixed = [e for e in estimates if e.cause.name not in allocation.shares_K]
            note.append(", ".join(f"{e.cause.name} {e.cause.text}" for e in estimates) or "none")
        allocation = Allocation.of(scene, tolerance_K, fixed)
        resolution = _asked(resolution, scene, allocation)
        if tracer.prepared.cone is not None:
            tracer.predicted.update({e.cause.name: e for e in estimates})
        for name, estimate in tracer.predicted.items():
            error_K, share_K = estimate.error_K or 0.0, allocation.shares_K.get(name, math.inf)
            if error_K > share_K:
                ratio, finer = error_K / share_K, BY_NAME[name].finer
                resolution = finer(resolution, share_K=share_K, ratio=ratio, order=estimate.order)
        resolution, tracer = problem.tracer(resolution)
    if tracer.prepared.is_empty:
        return replace(resolution, depth=tracer.prepared.cube.depth), allocation
    cell_m, limited = tracer.prepared.cube.cell_m, ""
    if "cells" in free_sources(scene):
        with problem.stages.stage("coarse traces") as note:
            chosen = choose_cells(tracer, allocation.cells_K)
            cell_m, limited = chosen or (cell_m, limited)
            reason = "no pixel has a T_app" if chosen is None else f"{allocation.cells_K:.2g} K"
            note.append(f"cells of {1e3 * cell_m:.3g} mm for {reason}")
    resolution = resolution.at_depth(tracer.frame(cell_m).depth, cell_m)
    return resolution.limited("cells", limited), allocation


def _asked(resolution: Resolution, scene: Scene, allocation: Allocation) -> Resolution:
    """The resolution with the errors allocated to trace, wavelengths and pixels."""
    return replace(
        resolution,
        ordinates_K=allocation["trace"],
        spectral_K=spectral_K(scene, allocation["wavelengths"]),
        pixels_K=allocation.shares_K.get("pixel sampling"),
    )


def coarse_estimates(tracer: VariantTracer) -> tuple[Estimate, ...]:
    """Known errors of the sources that the scene fixes, and of a cone's classes and lattice, on the
    coarsest cells that will do.

    Those of rays and ordinates are errors of the image on these cells.
    """
    scene, prepared = tracer.scene, tracer.prepared
    listed = [source for source in SOURCES if told_before_cells(source, prepared)]
    if not listed:
        return ()
    estimates: list[Estimate] = []
    cell_m = coarsest_m(tracer)
    if isinstance(scene.spray, GridSpray):  # cells smaller than its voxels show no more
        cell_m = max(cell_m, prepared.cube.cell_m)
    while True:
        at = tracer.on_cells(cell_m, cell_m)
        try:
            image = tracer.level(cell_m)
            errors = TraceError.of_halves(tracer.temperature, image)
            traced = tracer.on_cells(cell_m, cell_m, image=image, trace_errors=errors)
            for source in listed:
                estimates += source.of(at if source.of_spray else traced)
            break
        except (SprayError, TransportError):  # no cone has the lattice, or cells reach too far
            estimates, cell_m = [], cell_m / tracer.step
            if isinstance(scene.spray, GridSpray) or cell_m < 2 * _finest_m(tracer):
                break
    return tuple(estimate for estimate in estimates if estimate.error_K is not None)


def told_before_cells(source: ErrorSource, prepared: Prepared) -> bool:
    """True if coarse cells tell the error of a source: of a cone, or fixed by the scene."""
    if not source.applies(prepared):
        return False
    if source.of_spray:
        return prepared.cone is not None or not source.is_free(prepared.scene)
    return bool(source.key(prepared.scene)) and not source.of_cells


# Highest order of a prediction, since coarse cells overestimate it, and least ratio of the cells.
_ORDER, _LEAST = 1.4, 0.35
_ALL_HALVINGS = (
    f"the cube is halved {DEEPEST} times at most; allowed: a smaller domain.edge_m, or a larger "
    "transport.accuracy_K"
)


def coarsest_m(tracer: VariantTracer) -> float:
    """Edge of the cells of the coarsest trace."""
    edge_m = tracer.prepared.cube.edge_m
    depth = min(coarsest_depth(tracer.scene, edge_m), DEEPEST - 3)
    return float(edge_m / 2**depth)


def _finest_m(tracer: VariantTracer) -> float:
    return float(tracer.prepared.cube.edge_m / 2**DEEPEST)


def _after_two_traces(tracer: VariantTracer, finest_m: float) -> float:
    """Traces on the two coarsest cells that will do; the edge of the next finer cells."""
    cell_m, traced = coarsest_m(tracer), 0
    while traced < 2:
        tracer.tell(f"coarse trace: cells of {1e3 * cell_m:.3g} mm")
        try:
            tracer.level(cell_m)
            traced += 1
        except (SprayError, TransportError):  # as in `error_at`
            if cell_m / 8 < finest_m:
                raise
            traced = 0
        cell_m /= tracer.step
    return cell_m


def choose_cells(tracer: VariantTracer, tolerance_K: float) -> tuple[float, str] | None:
    """Edge of the largest cells within the tolerance; None if no pixel has a T_app.

    The text is why they are not smaller, if the tolerance needs it; else empty.

    The search ends when the error that is predicted for the next finer cells is small enough, so
    that these are traced once, for the image of the run. Cells that were traced for the order
    alone, and have a smaller error than is needed, leave the image to larger ones.

    Raises:
        SprayError: the cone suits none of the coarse lattices.
        TransportError: cells reach behind a patch, however small.
        MediumError: not even coarse cells fit the memory.
    """
    step, on_lattice = tracer.step, tracer.prepared.on_lattice
    finest_m = _finest_m(tracer) * (1 - 1e-9)
    cell_m = _after_two_traces(tracer, finest_m)
    while True:
        tracer.tell(f"coarse trace: cells of {1e3 * cell_m:.3g} mm")
        try:
            estimates = error_at(tracer, cell_m)
        except MediumError:
            return step * cell_m, too_many(cell_m)
        except SprayError:
            # The finest lattice that suits the cone lies between: the run finds it, step by step.
            return cell_m, ""
        if estimates is None:
            return None
        ends = cell_m / step < finest_m
        if max(estimate.bound_K or 0.0 for estimate in estimates) > tolerance_K / SAFE:
            if not ends:
                cell_m /= step
                continue  # outside the asymptotic range: finer cells tell the order
        else:
            larger = [estimate.at(step) for estimate in estimates]
            if max(estimate.most_K for estimate in larger) <= tolerance_K:  # they were traced
                return step * cell_m, ""
        if max(estimate.error_K for estimate in estimates) <= tolerance_K:
            return cell_m, ""
        if ends:
            return cell_m, _ALL_HALVINGS
        less = 1 / step
        if on_lattice:
            less = min(
                (SAFE * tolerance_K / estimate.error_K) ** (1.0 / min(estimate.order, _ORDER))
                for estimate in estimates
                if estimate.error_K
            )
        predicted_K = max(estimate.at(less).error_K for estimate in estimates)
        if less >= _LEAST and predicted_K <= tolerance_K / SAFE:
            return cell_m * less, ""
        cell_m /= step
        if cell_m / step < finest_m:
            return cell_m, _ALL_HALVINGS
