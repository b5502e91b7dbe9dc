"""Solve, estimate, refine: until both errors are within their tolerances, or cannot be reduced.

This is the loop of adaptive finite elements. `predict` starts it with a resolution from coarse
traces; `solve` traces the image and estimates its error by source; `refine` chooses a finer
resolution by the same rule of allocation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.allocation import IN_VAIN, Allocation, free_sources, shares_of
from cldit.accuracy.error_maps import error_maps
from cldit.accuracy.errors import Cause, Errors, Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.model_spread import lens_omission, phase_spread
from cldit.accuracy.node_traces import NodeTraces, summed, traced_stages
from cldit.accuracy.predict import predict
from cldit.accuracy.problem import Problem
from cldit.accuracy.remarks import expected, too_large
from cldit.accuracy.resolution import Resolution, cells_are_free
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.discretisation import ORDINATES, beyond
from cldit.accuracy.sources.omissions import CUTOFF, GATHER
from cldit.accuracy.sources.pixel_sampling import MOST_RAYS, PIXEL_SAMPLING
from cldit.accuracy.trace_error import TraceError
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluated, sensor_of
from cldit.dit.maps import Maps
from cldit.medium.octree import build_octree
from cldit.optics.spectral import Quadrature
from cldit.prepare.medium import Medium
from cldit.radiance.point_spread import blur_of
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.scene.spray import GridSpray
from cldit.transport.trace import settings_for, trace, trace_each

MAX_REFINEMENTS = 2
_WORTH = 0.8  # of the square of an error that stays too large: less gain is not worth a trace
_GAIN = 0.75  # of the error before: a trial with less gain is not made again
_MORE = "more ordinates"
_NO_GAIN = "a trial did not make the error smaller"
_CLOSE = 1.2  # to the error asked of the rays: else the trace could not add more of them
_MOST_RATIO = 4.0  # of an error to its share, in one refinement: a smaller share is not worth it


@dataclass(frozen=True)
class Result:
    """The solution of a problem at one resolution.

    trace_errors: of both results; empty if nothing scatters. estimates: by source, empty without
    audit. error_maps, emissivity_error_maps: of `errors` (H, W), by source. unstated: why no error
    is stated, if none is. model: change by a lens and spread of the model itself, as far as they
    are known.
    """

    resolution: Resolution
    allocation: Allocation
    medium: Medium
    traces: NodeTraces
    reference: Weights
    maps: Maps
    sensor: SensorModel
    trace_errors: tuple[TraceError, ...]
    estimates: tuple[Estimate, ...] = ()
    error_maps: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    emissivity_error_maps: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    refinements: int = 0
    unstated: str = ""
    model: tuple[Cause, ...] = ()

    @property
    def errors(self) -> Errors:
        """Errors by source, and their sum."""
        per_K = self.allocation.per_emissivity_K
        causes = tuple(estimate.stated(per_K) for estimate in self.estimates)
        figures = {k: error for e in self.estimates for k, error in e.figures.items()}
        return Errors(causes, self.model, why=self.unstated, figures=figures)

    @property
    def trace_error(self) -> TraceError | None:
        """Error of T_app by the trace; None if nothing scatters."""
        return self.trace_errors[0] if self.trace_errors else None

    @property
    def quadrature(self) -> Quadrature:
        """The nodes that were traced."""
        return self.medium.properties.chosen.quadrature

    def limited(self, source: str, reason: str) -> Result:
        """The result with the reason why a source cannot be smaller; empty: none."""
        return replace(self, resolution=self.resolution.limited(source, reason))

    @property
    def plan(self) -> dict[str, Any]:
        """Resolution and allocation as plain data for run.json."""
        chosen = {**self.allocation.to_dict(), **self.resolution.to_dict()}
        return {**chosen, "refinements": self.refinements}


def converge(problem: Problem, tolerance_K: float) -> Result:
    """Traces until the error is within the tolerance, or cannot be reduced.

    Raises:
        ClditError: as `cldit.simulate`.
    """
    result = newest = solve(problem, *predict(problem, tolerance_K))
    for number in range(1, 1 + MAX_REFINEMENTS):
        result, finer = refine(problem, result)
        if finer is None:
            break
        largest = result.errors.largest()
        by = "" if largest is None else f", {largest.text} of it by {largest.name}"
        problem.stages.remark(
            (f"error {result.errors.text}{by}: refinement {number} of at most {MAX_REFINEMENTS}",)
        )
        newest = better = solve(problem, *finer)
        tried = _remedy(problem, result) if _trace_K(result) > finer[1]["trace"] else ""
        if not _exceeds(better, result):
            gained = _trace_K(better) < _GAIN * _trace_K(result)
            result = replace(better, refinements=number)
            if tried and not gained:
                result = result.limited(tried, _NO_GAIN)
            continue
        problem.stages.remark(
            (
                f"refinement did not help (error {better.errors.text}): the previous image is kept "
                f"({result.errors.text})",
            )
        )
        if not tried:  # memory did not hold the finer resolution
            result = result.limited("cells", better.resolution.limits.get("cells", ""))
            break
        result = result.limited(tried, _NO_GAIN)
    problem.stages.remark(tuple(_last_remarks(problem.scene, result)))
    return replace(result, model=_model_spread(problem, newest))


def _last_remarks(scene: Scene, result: Result) -> Iterator[str]:
    """Remarks on unknown errors, and on an error that exceeds the tolerance."""
    error, transport = result.trace_error, scene.transport
    yield from result.traces.short
    if result.errors.why and transport.audit:
        yield f"error of T_app: {result.errors.text}"
        return
    yield from () if error is None else error.unknown_remarks
    errors = result.errors
    if error is not None and not transport.audit:  # that of the trace alone
        errors = Errors.of([Cause(ORDINATES.name, error.error_K, "", ORDINATES.key(scene))])
    bounds = transport.accuracy_K, result.resolution.limits
    yield from too_large(errors, *bounds, emissivity=result.allocation.emissivity)


def _model_spread(problem: Problem, result: Result) -> tuple[Cause, ...]:
    """Change by a lens, and the spread by the phase function, where anything scatters into a pixel
    with a T_app."""
    scatters = result.traces.scatters and problem.scene.transport.order != 0
    if result.resolution.depth is None or not result.estimates or not scatters:
        return result.model
    with problem.stages.stage("phase function") as note:
        tracer = problem.tracer(result.resolution)[1]
        spread = phase_spread(tracer, result.medium.cell_m)
        note.append(spread.text)
    return (*result.model, spread)


def _trace_K(result: Result) -> float:
    return (result.trace_error and result.trace_error.error_K) or 0.0


def solve(
    problem: Problem, resolution: Resolution, allocation: Allocation, *, unstated: str = ""
) -> Result:
    """Traces the image, evaluates it, and estimates its error by source.

    With a reason why it is `unstated`, the error is not estimated.
    """
    scene, device, stages = problem.scene, problem.device, problem.stages
    resolution, prepared, medium = problem.medium(resolution)
    audit = scene.transport.audit and not unstated
    tracer = problem.tracer(resolution)[1] if audit else None
    frame = medium.trees[0].frame
    quadrature = prepared.properties.chosen.quadrature
    settings = [replace(setting, audit=audit) for setting in problem.settings(resolution, prepared)]
    costs = [] if tracer is None else tracer.costs
    stages.remark(expected(prepared, frame, settings, coarse=costs, allocation=allocation))
    traced = None
    if tracer is not None and scene.transport.method == "source":
        traced = tracer.known(medium.cell_m)
    results = trace_each(medium.trees, scene, device, settings, report=stages.tell, known=traced)
    traces = summed(results, quadrature, scene)
    grey = settings_for(scene, prepared.properties.paper_phase, tolerance_K=resolution.ordinates_K)
    nothing = build_octree(frame, None, [], optical_depth_split=1.0)
    reference = blur_of(scene)(trace(nothing, scene, device, grey, rays=traces.rays).weights)
    stages.done += traced_stages(traces, scene.transport.order)
    with stages.stage("evaluation"):
        sensor = sensor_of(scene, quadrature, (traces.spectral, reference))
        maps = evaluated(scene, quadrature, traces.spectral, reference, sensor)
    errors = TraceError.of(scene, traces, maps)
    result = Result(resolution, allocation, medium, traces, reference, maps, sensor, errors)
    if tracer is None:
        return replace(result, unstated=unstated)
    with stages.stage("errors"):
        return _estimated(problem, tracer, result)


def _estimated(problem: Problem, tracer: VariantTracer, result: Result) -> Result:
    """The result with the error of each source."""
    if tracer.prepared.is_clear:
        return result
    if not result.maps.has_temperature.any():
        return replace(result, unstated=f"no pixel has a T_app ({result.maps.causes})")
    scene, traces, cell_m = problem.scene, result.traces, result.medium.cell_m
    image = ImagePair.of(traces.traces[tracer.prepared.number])
    exact = scene.transport.method == "path"
    if scene.transport.method == "source":
        tracer.put(cell_m, traces.traces[tracer.prepared.number])
        exact = not traces.scatters or scene.transport.order == 0 or traces.audit is not None
    coarse_m, errors = tracer.coarser(cell_m), result.trace_errors
    at = tracer.on_cells(cell_m, coarse_m, image=image, exact=exact, trace_errors=errors)
    estimates = tuple(estimate for source in SOURCES for estimate in source.of(at))
    tracer.estimates.update({source.name: source.of(at) for source in SOURCES if source.of_spray})
    result = replace(result, trace_errors=beyond(at), estimates=estimates)
    pixels_K, asked_K = PIXEL_SAMPLING.errors_K(at), result.resolution.pixels_K
    if asked_K is not None and max(error_K or 0.0 for error_K in pixels_K) > _CLOSE * asked_K:
        result = result.limited("pixel sampling", next(iter(traces.short), MOST_RAYS))
    causes, local = result.errors.causes, (PIXEL_SAMPLING.name,)
    warm, finite = result.maps.has_temperature, np.isfinite(result.maps.emissivity)
    stated = [{c.name: (c.error_K, c.emissivity)[n] for c in causes} for n in (0, 1)]
    maps_K = [{e.cause.name: e.maps_K[n] for e in estimates if e.maps_K} for n in (0, 1)]
    return replace(
        result,
        error_maps=error_maps(stated[0], maps_K[0], warm, local=local),
        emissivity_error_maps=error_maps(stated[1], maps_K[1], finite, warm, local=local),
        model=lens_omission(tracer.prepared, image),
    )


def refine(problem: Problem, result: Result) -> tuple[Result, tuple[Resolution, Allocation] | None]:
    """A finer resolution and its allocation; None if the error is small enough, or cannot be
    reduced. The result comes back with the limits that were found."""
    finer = _finer(problem, result)
    if finer is not None:
        limited = problem.hardly_finer(finer[0], result.resolution)
        if limited:
            result = result.limited("cells", limited)
            finer = _finer(problem, result)
    return result, finer


def _finer(problem: Problem, result: Result) -> tuple[Resolution, Allocation] | None:
    """Allocates anew the part of the tolerance that irreducible errors leave."""
    tolerance_K = result.allocation.tolerance_K
    if not result.errors.exceed(tolerance_K, result.allocation.emissivity):
        return None
    of = 0 if result.errors.exceed(tolerance_K) else 1  # the result whose sources are refined
    by_name = {e.cause.name: e for e in result.estimates if e.errors_K[of] is not None}
    errors_K = {name: estimate.errors_K[of] or 0.0 for name, estimate in by_name.items()}
    reducible = _reducible(problem, result)
    free = [name for name in by_name if name in reducible]
    fixed_K = {name: error_K for name, error_K in errors_K.items() if name not in free}
    fixed_K2 = sum(error_K**2 for error_K in fixed_K.values())
    left_K2 = max(tolerance_K**2 - fixed_K2, IN_VAIN * fixed_K2)
    free_K2 = sum(errors_K[name] ** 2 for name in free)
    hopeless = fixed_K2 > tolerance_K**2 and fixed_K2 + left_K2 > _WORTH * (fixed_K2 + free_K2)
    if hopeless or free_K2 <= left_K2:
        return None  # no refinement of these mends the sum
    shares_K = shares_of(left_K2, {name: errors_K[name] for name in free})
    resolution, remedy = result.resolution, _remedy(problem, result)
    for name in free:
        if errors_K[name] > shares_K[name]:
            ratio = min(errors_K[name] / shares_K[name], _MOST_RATIO)
            by = "cells" if name == "trace" and remedy == "cells" else name
            if name == "trace" and remedy == _MORE:
                resolution = ORDINATES.denser(resolution, ratio)
                continue
            resolution = BY_NAME[by].finer(
                resolution, share_K=shares_K[name], ratio=ratio, order=by_name[name].order
            )
    return resolution, replace(result.allocation, shares_K=shares_K, fixed_K=fixed_K)


def _reducible(problem: Problem, result: Result) -> set[str]:
    """Names of the sources that another resolution can make smaller."""
    free = set(free_sources(problem.scene))
    if cells_are_free(problem.scene):
        free.add("cells")
    free -= set(result.resolution.limits)
    if not ((_shrinks(result) and not result.traces.short) or _remedy(problem, result)):
        free.discard("trace")
    return free


def _shrinks(result: Result) -> bool:
    """True if more ordinates and paths surely make the error of the trace smaller."""
    return result.trace_error is not None and result.trace_error.can_shrink


def _remedy(problem: Problem, result: Result) -> str:
    """Remedy to try for an error that only the audit shows; empty: none is left.

    More ordinates cost less than smaller cells, which are tried for the voxels of a grid. With a
    key that omits what `path` sees, neither helps.
    """
    scene, limits = problem.scene, result.resolution.limits
    if CUTOFF.key(scene) or GATHER.key(scene):
        return ""
    if result.trace_error is None or _shrinks(result) or scene.transport.method != "source":
        return ""
    if scene.transport.directions is None and _MORE not in limits:
        return _MORE
    voxels = isinstance(scene.spray, GridSpray) and cells_are_free(scene)
    return "cells" if voxels and "cells" not in limits else ""


def _exceeds(result: Result, previous: Result) -> bool:
    """True if the error of a result is known to exceed that of the one before."""
    per_K = result.allocation.per_emissivity_K
    return result.errors.larger_K(per_K) > previous.errors.larger_K(per_K) > 0.0
