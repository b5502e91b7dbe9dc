"""Prediction: coarse traces tell the resolution that a scene needs for a tolerance.

Sources that the scene fixes are estimated first, on the coarsest cells: if they alone exceed the
tolerance, finer cells, ordinates and wavelengths that add little to them are in vain. Coarse cells
blur the effect of these sources, and with it their predicted error. Then the cells are chosen by a
few coarse traces, each of which costs an eighth of the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from cldit.accuracy.allocation import Allocation, free_sources
from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution, too_many
from cldit.accuracy.richardson import SAFE, RichardsonEstimate, error_at, predicted_error, worst
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.base import Measurement
from cldit.accuracy.sources.discretisation import spectral_K
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError
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
        return start, Allocation(tolerance_K, tolerance_K, {})
    allocation = Allocation.of(scene, tolerance_K)
    resolution, tracer = problem.tracer(_asked(start, scene, allocation))
    if not problem.is_clear(tracer.prepared):
        with problem.stages.stage("coarse traces of fixed error sources") as note:
            fixed = fixed_estimates(problem, tracer)
            note.append(", ".join(f"{e.cause.name} {e.cause.text}" for e in fixed) or "none")
        allocation = allocation.with_known(scene, fixed).allocated(scene)
        resolution, tracer = problem.tracer(_asked(resolution, scene, allocation))
    if tracer.prepared.is_empty:
        resolution = replace(resolution, depth=tracer.prepared.cube.depth)
    else:
        resolution, allocation = _for_spray(problem, resolution, allocation, tracer)
    return resolution, allocation


def _asked(resolution: Resolution, scene: Scene, allocation: Allocation) -> Resolution:
    """The resolution with the errors allocated to trace, wavelengths and pixels."""
    return replace(
        resolution,
        ordinates_K=allocation["trace"],
        spectral_K=spectral_K(scene, allocation["wavelengths"]),
        pixels_K=allocation.shares_K.get("pixel sampling"),
    )


def _for_spray(
    problem: Problem, resolution: Resolution, allocation: Allocation, tracer: VariantTracer
) -> tuple[Resolution, Allocation]:
    """Chooses the cells, then size classes and lattice for their shares of the error."""
    scene, depth = problem.scene, tracer.prepared.cube.depth
    if isinstance(scene.spray, GridSpray):
        cells = Cells(depth, None)
    elif "cells" not in free_sources(scene):
        cells = Cells(depth, predicted_error(tracer, depth)[0])
    else:
        allocation, chosen = _choose_cells(problem, resolution, allocation, tracer)
        cells = chosen or Cells(depth, None)
    resolution = resolution.at_depth(cells.depth).limited("cells", cells.limited)
    if resolution.cube_m is not None and resolution.spacing_m is not None:
        resolution = resolution.on_lattice(resolution.spacing_m * cells.less)
    with problem.stages.stage("coarse traces of the spray"):
        at = Measurement(
            scene, tracer, problem.stages, depth=cells.depth, coarse=max(cells.depth - 1, 0)
        )
        if tracer.prepared.cone is not None:
            estimates = [e for source in SOURCES if source.of_spray for e in at.of(source)]
            problem.predicted = {e.cause.name: e for e in estimates}
    for name, estimate in problem.predicted.items():
        error_K, share_K = estimate.error_K or 0.0, allocation.shares_K.get(name, math.inf)
        if error_K > share_K:
            ratio, finer = error_K / share_K, BY_NAME[name].finer
            resolution = finer(resolution, share_K=share_K, ratio=ratio, order=estimate.order)
    if cells.error_K is not None:
        predicted_K = {**allocation.predicted_K, "cells": cells.error_K}
        allocation = replace(allocation, predicted_K=predicted_K)
    return resolution, allocation


def _choose_cells(
    problem: Problem, resolution: Resolution, allocation: Allocation, tracer: VariantTracer
) -> tuple[Allocation, Cells | None]:
    """The cells for an allocation that includes what each coarse image shows."""

    def seen(image: ImagePair) -> Allocation:
        """Adds errors of fixed sources, on cells twice as large, and those that the image shows."""
        depth = max(tracer.levels)
        fixed = fixed_estimates(problem, tracer, depth=depth - 1)
        with_fixed = allocation.with_known(problem.scene, fixed)
        at = Measurement(
            problem.scene, tracer, problem.stages, depth, depth - 1, resolution=resolution
        )
        shown = {source.name: source.of_image(at, image) for source in SOURCES}
        errors_K = {name: error_K for name, error_K in shown.items() if error_K is not None}
        return replace(with_fixed, predicted_K={**with_fixed.predicted_K, **errors_K})

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
    out = [estimate for source in fixed if not source.of_spray for estimate in at.of(source)]
    of_spray = [source for source in fixed if source.of_spray and source.applies(prepared)]
    depths: Sequence[int] = coarse_depths(tracer) if depth is None else (depth,)
    if isinstance(scene.spray, GridSpray):  # cells smaller than its voxels show no more
        depths = (min(depths[0], prepared.cube.depth),)
    for on in depths if of_spray else ():
        at = Measurement(scene, tracer, problem.stages, depth=on, coarse=on)
        try:
            tracer.level(on)
            out += [estimate for source in of_spray for estimate in at.of(source)]
        except (SprayError, TransportError):  # no cone has the lattice, or cells reach too far
            continue
        break
    return tuple(estimate for estimate in out if estimate.error_K is not None)


_FINEST = 12  # 4096 cells along an edge
_ORDER, _LEAST = 1.4, 0.35  # highest order of a prediction, and how much smaller cells may be
_MOST = 1.3  # how much larger: cells twice those of `depth` are 1.5 of them, and tell their error
_CLOSE = 1.1  # of the tolerance: a coarse trace of the image's own cells costs as much as that
_ACROSS = 32  # cells across the image, of the coarsest trace
_ALL_HALVINGS = (
    f"the cube is halved {_FINEST} times at most; allowed: a smaller domain.edge_m, or a larger "
    "transport.accuracy_K"
)


@dataclass(frozen=True)
class Cells:
    """The chosen cells.

    depth: number of times that the cube is halved. error_K: found or predicted; None: unknown.
    limited: why it is not halved more often, if the tolerance needs it; else empty. less: edge of
    the chosen cells over that of `depth`, where any edge is possible.
    """

    depth: int
    error_K: float | None
    limited: str = ""
    less: float = 1.0


def coarse_depths(tracer: VariantTracer) -> range:
    """Numbers of halvings for coarse traces: the first is the coarsest to try."""
    across = tracer.scene.camera.field_m
    depth = max(3, math.ceil(math.log2(_ACROSS * tracer.prepared.cube.edge_m / max(across))))
    return range(min(depth, _FINEST - 3), _FINEST - 2)


def _times(estimate: RichardsonEstimate, error_K: float) -> float:
    """Edge of the cells with an error, over that of the cells with an estimate.

    Coarse cells overestimate the order: it is limited for the prediction of finer ones.
    """
    if not estimate.error_K:
        return math.inf
    ratio = error_K / estimate.error_K
    if ratio < 1.0:
        return float(ratio ** (1.0 / min(estimate.order, _ORDER)))
    return float(max((error_K / estimate.most_K) ** (1.0 / estimate.order), 1.0))


def choose_cells(
    tracer: VariantTracer, allowed_K: Callable[[ImagePair], float], say: Callable[[str], None]
) -> Cells | None:
    """The largest cells within the tolerance; None if no pixel has a T_app.

    `allowed_K` is the error that the cells may have, by an image of theirs. The search ends
    when the error that is predicted for the next finer cells is small enough, so that these are
    traced once, for the image of the run. Cells that were traced for the order alone, and have a
    smaller error than is needed, leave the image to larger ones.

    Raises:
        SprayError: the cone suits none of the coarse lattices.
        TransportError: cells reach behind a patch, however small.
        MediumError: not even coarse cells fit the memory.
    """
    cube = tracer.prepared.cube
    coarse = coarse_depths(tracer)
    depth, traced = coarse[0], 0
    while traced < 2:
        say(f"coarse trace: cells of {1e3 * cube.at(depth).cell_m:.3g} mm")
        try:
            tracer.level(depth)
            traced += 1
        except (SprayError, TransportError):  # as in `error_at`
            if depth >= coarse[-1]:
                raise
            traced = 0
        depth += 1
    while True:
        say(f"coarse trace: cells of {1e3 * cube.at(depth).cell_m:.3g} mm")
        try:
            estimates = error_at(tracer, depth)
        except MediumError:
            coarser = error_at(tracer, depth - 1)
            error_K = None if coarser is None else worst(coarser).error_K
            return Cells(depth - 1, error_K, too_many(cube.at(depth).cell_m))
        except SprayError:
            # The finest lattice that suits the cone lies between: the run finds it, step by step.
            return Cells(depth, predicted_error(tracer, depth)[0])
        if estimates is None:
            return None
        largest, tolerance_K = worst(estimates), allowed_K(tracer.level(depth))
        error_K = largest.error_K
        bound_K = max(estimate.bound_K or 0.0 for estimate in estimates)
        if bound_K > _CLOSE * tolerance_K and depth < _FINEST:
            depth += 1  # outside the asymptotic range: finer cells tell the order
            continue
        larger = [estimate.at(2.0) for estimate in estimates]
        if max(estimate.most_K for estimate in larger) <= tolerance_K:  # such cells were traced
            return Cells(depth - 1, worst(larger).error_K)
        less = min(_times(estimate, SAFE * tolerance_K) for estimate in estimates)
        if tracer.prepared.on_lattice and less >= _LEAST:
            less = min(less, _MOST)
            return Cells(depth, max(estimate.at(less).error_K for estimate in estimates), less=less)
        if error_K <= tolerance_K:
            return Cells(depth, error_K)
        if depth == _FINEST:
            return Cells(depth, error_K, _ALL_HALVINGS)
        predicted_K = error_K / 2**largest.order
        if predicted_K <= _CLOSE * tolerance_K:
            return Cells(depth + 1, predicted_K)
        if depth + 1 == _FINEST:
            return Cells(depth + 1, predicted_K, _ALL_HALVINGS)
        depth += 1
