"""Prediction: coarse traces tell the resolution that a scene needs for a tolerance.

Sources that the scene fixes are estimated first, on the coarsest cells: if they alone exceed the
tolerance, finer cells, ordinates and wavelengths that add little to them are in vain. Coarse cells
blur the effect of these sources, and with it their predicted error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cldit.accuracy.allocation import Allocation, free_sources
from cldit.accuracy.cell_choice import Cells, choose_cells, coarse_depths
from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.richardson import predicted_error
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.base import Excess, Measurement
from cldit.accuracy.sources.wavelengths import spectral_K
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import SprayError, TransportError
from cldit.scene import Scene
from cldit.scene.spray import GridSpray

_NO_AUDIT = (
    "transport.audit: false: transport.accuracy_K applies to the trace alone, and the error of the "
    "image is not estimated"
)


def predict(problem: Problem, tolerance_K: float) -> tuple[Resolution, Allocation]:
    """The resolution that a scene needs for a tolerance, and the error allocated to each source."""
    scene = problem.scene
    first = Resolution.first(scene, ordinates_K=tolerance_K, spectral_K=scene.optics.bound_K)
    if not scene.transport.audit:
        problem.stages.remark((_NO_AUDIT,))
        return first, Allocation(tolerance_K, tolerance_K, {})
    allocation = Allocation.of(scene, tolerance_K)
    resolution, tracer = problem.tracer(_asked(first, scene, allocation))
    if not problem.is_clear(tracer.prepared):
        with problem.stages.stage("coarse traces of fixed error sources") as note:
            known = fixed_estimates(problem, tracer)
            note.append(", ".join(f"{e.cause.name} {e.cause.text}" for e in known) or "none")
        allocation = allocation.with_known(scene, known).allocated(scene)
        resolution, tracer = problem.tracer(_asked(resolution, scene, allocation))
    if tracer.prepared.is_empty:
        resolution = replace(resolution, depth=tracer.prepared.cube.depth)
    else:
        resolution, allocation = _for_spray(problem, resolution, allocation, tracer)
    problem.stages.remark(allocation.remark())
    return resolution, allocation


def _asked(resolution: Resolution, scene: Scene, allocation: Allocation) -> Resolution:
    """The resolution with the errors allocated to trace, wavelengths and pixels."""
    wavelengths_K = spectral_K(scene, allocation["wavelengths"])
    return replace(
        resolution,
        ordinates_K=allocation["trace"],
        spectral_K=wavelengths_K,
        pixels_K=allocation.shares_K.get("pixel sampling"),
    )


def _for_spray(
    problem: Problem, resolution: Resolution, allocation: Allocation, tracer: VariantTracer
) -> tuple[Resolution, Allocation]:
    """Chooses the cells, then size classes and lattice for the error that these leave."""
    scene, depth = problem.scene, tracer.prepared.cube.depth
    if isinstance(scene.spray, GridSpray):
        cells = Cells(depth, None)
    elif "cells" not in free_sources(scene):
        cells = Cells(depth, predicted_error(tracer, depth)[0])
    else:
        allocation, found = _choose_cells(problem, resolution, allocation, tracer)
        cells = found or Cells(depth, None)
    resolution = resolution.at_depth(cells.depth).limited("cells", cells.limited)
    if resolution.cube_m is not None and resolution.spacing_m is not None:
        resolution = resolution.on_lattice(resolution.spacing_m * cells.less)
    with problem.stages.stage("coarse traces of the spray"):
        at = Measurement(
            scene, tracer, problem.stages, depth=cells.depth, coarse=max(cells.depth - 1, 0)
        )
        if tracer.prepared.cone is not None:
            estimates = [one for source in SOURCES if source.of_spray for one in at.of(source)]
            problem.predicted = {one.cause.name: one for one in estimates}
    known = {name: one for name, one in problem.predicted.items() if one.error_K is not None}
    errors_K = {name: one.error_K or 0.0 for name, one in known.items()}
    before, allocation = allocation, allocation.beside_cells(scene, cells.error_K, errors_K)
    for name in errors_K if allocation is not before else ():
        share_K = allocation.shares_K.get(name, errors_K[name])
        if name in free_sources(scene) and errors_K[name] > share_K:
            excess = Excess(share_K, errors_K[name] / share_K, known[name].order)
            resolution = BY_NAME[name].finer(resolution, excess)
    return resolution, allocation


def _choose_cells(
    problem: Problem, resolution: Resolution, allocation: Allocation, tracer: VariantTracer
) -> tuple[Allocation, Cells | None]:
    """The cells for an allocation that includes what each coarse image shows."""

    def seen(image: ImagePair) -> Allocation:
        """Adds errors of fixed sources, on cells twice as large, and those that the image shows."""
        depth = max(tracer.levels)
        fixed = fixed_estimates(problem, tracer, depth=depth - 1)
        known = allocation.with_known(problem.scene, fixed)
        at = Measurement(
            problem.scene, tracer, problem.stages, depth, depth - 1, resolution=resolution
        )
        shown = {source.name: source.of_image(at, image) for source in SOURCES}
        errors_K = {name: error_K for name, error_K in shown.items() if error_K is not None}
        return replace(known, predicted_K={**known.predicted_K, **errors_K})

    with problem.stages.stage("coarse traces") as note:
        chosen = choose_cells(tracer, lambda image: seen(image).cells_K, problem.stages.tell)
        finest = seen(tracer.levels[max(tracer.levels)])
        if chosen is None:
            note.append("no pixel has a T_app: cells as the paper's")
        else:
            cell_mm = 1e3 * tracer.prepared.cube.at(chosen.depth).cell_m
            note.append(f"cells of {cell_mm:.3g} mm for {finest.cells_K:.2g} K")
    return finest, chosen


def fixed_estimates(
    problem: Problem, tracer: VariantTracer, *, depth: int | None = None
) -> tuple[Estimate, ...]:
    """Known errors of the sources that the scene fixes.

    `depth` is that of cells that were traced already; None: the coarsest that will do. Pixel
    sampling, and the trace where the scene sets its directions, are not among them: each image of
    a tracer shows them.
    """
    scene, prepared = problem.scene, tracer.prepared
    fixed = [source for source in SOURCES if not source.is_free(scene)]
    at = Measurement(scene, tracer, problem.stages, 0, 0)
    out = [one for source in fixed if not source.of_spray for one in at.of(source)]
    of_spray = [source for source in fixed if source.of_spray and source.applies(prepared)]
    depths: Sequence[int] = coarse_depths(tracer) if depth is None else (depth,)
    if isinstance(scene.spray, GridSpray):  # cells smaller than its voxels show no more
        depths = (min(depths[0], prepared.cube.depth),)
    for on in depths if of_spray else ():
        at = Measurement(scene, tracer, problem.stages, depth=on, coarse=on)
        try:
            tracer.level(on)
            out += [one for source in of_spray for one in at.of(source)]
        except (SprayError, TransportError):  # no cone has the lattice, or cells reach too far
            continue
        break
    return tuple(one for one in out if one.error_K is not None)
