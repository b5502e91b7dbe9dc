"""One scene through spray, optics, octree, trace and noise-free evaluation.

run = cldit.simulate("gdi", out="runs/gdi")
run.maps.apparent_temperature_K
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.accuracy.allocation import Allocation
from cldit.accuracy.converge import Result, converge, solve
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.dit.evaluate import evaluated, sensor_of
from cldit.errors import EvaluationError, SprayError
from cldit.gpu.device import Device
from cldit.io.caches import default_cache
from cldit.io.exclusive import exclusive
from cldit.io.progress import Watch, silent
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.prepare.stages import Say, Stages
from cldit.radiance.effective import effective_weights
from cldit.radiance.point_spread import blur_of
from cldit.run.content import trace_content
from cldit.run.ensemble import UNSTATED, ensemble_run
from cldit.run.exposure import exposed, exposed_run
from cldit.run.folder import stored_run
from cldit.run.record import run_info
from cldit.run.result import Run, save_run
from cldit.run.spectral import Difference
from cldit.run.trusted import open_device
from cldit.scene import Scene
from cldit.scene.load import chosen_scene
from cldit.scene.scatter import members_of
from cldit.spray.result import Spray
from cldit.transport.trace import settings_for, trace


def simulate(
    scene: Scene | str | Path,
    out: str | Path | None = None,
    *,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
    device: Device | None = None,
    cache: Path | None = None,
    spray: Spray | None = None,
    progress: Say | None = None,
    watch: Watch = silent,
    like: Run | None = None,
) -> Run:
    """Traces a scene and evaluates it without noise: `cldit.simulate` without a rig.

    Arguments, run and errors are those of `cldit.simulate`; `watch` takes the progress of reading
    a CFD case alone.
    """
    scene = chosen_scene(scene, quick=quick, pixels=pixels)
    cache = cache or default_cache()

    def traced(scene: Scene, folder: Path | None, like: Run | None) -> Run:
        opened = device or open_device()
        problem = Problem(scene, opened, Stages(progress, watch), cache, spray)
        return _traced(problem, folder, like)

    def found_or_traced(scene: Scene, out: Path | None, like: Run | None) -> Run:
        trace = traced
        if members_of(scene) > 1:
            if spray is not None:
                raise SprayError("spray: is given; allowed: none for several injections")
            trace = partial(ensemble_run, trace=found_or_traced)
        elif exposed(scene):
            if spray is not None:
                raise SprayError("spray: is given; allowed: none for several times of an exposure")
            trace = partial(exposed_run, trace=found_or_traced)
        if out is None:
            return trace(scene, None, like)
        run = stored_run(out, scene)  # without the lock: the folder may be read-only
        if run is None:
            with exclusive(out, "run", nested=True):
                run = stored_run(out, scene)
                if run is None:
                    run = trace(scene, out, like)
                    save_run(run, out)
                    return run
        if progress is not None:
            progress(f"{out} holds this scene already: read, not traced again")
        return run

    return found_or_traced(scene, None if out is None else Path(out), like)


def _traced(problem: Problem, folder: Path | None, like: Run | None) -> Run:
    """Traces and evaluates, with the resolution of the run `like`, if there is one."""
    scene = problem.scene
    if like is None or like.info.plan is None:
        result = converge(problem, scene.transport.accuracy_K)
    else:
        plan = like.info.plan
        resolution, allocation = Resolution.from_dict(plan), Allocation.from_dict(plan)
        result = solve(problem, resolution, allocation, unstated=UNSTATED)
    from_paper = _against_paper(problem, result) if like is None else None
    rays = result.traces.rays
    return Run(
        scene=scene,
        weights=result.traces.weights,
        reference=result.reference,
        maps=result.maps,
        info=run_info(problem, result, from_paper),
        quadrature=result.quadrature,
        spectral=result.traces.spectral,
        error_maps=result.error_maps,
        emissivity_error_maps=result.emissivity_error_maps,
        rays=None if rays is None else (rays**2).astype(np.float32),
        folder=folder,
    )


def _against_paper(problem: Problem, result: Result) -> Difference | None:
    """Difference from the paper's optical properties; None where it is not wanted."""
    paper, scene = result.medium.paper, problem.scene
    if paper is None:
        return None
    with problem.stages.stage("the paper's properties"):
        phase = result.medium.properties.paper_phase
        grey = settings_for(scene, phase, tolerance_K=result.resolution.ordinates_K)
        rays = result.traces.rays
        paper_weights = blur_of(scene)(trace(paper, scene, problem.device, grey, rays=rays).weights)
        chosen = result.quadrature
        single_node = Quadrature.grey(chosen.filter_um, reference_K=chosen.reference_K)
        maps = evaluated(scene, single_node, (paper_weights,), result.reference, result.sensor)
        return Difference.of(result.maps, maps)


def reevaluated(run: Run, scene: Scene) -> Run:
    """The same trace for other backgrounds, walls and sensors; nothing is traced.

    Args:
        scene: may differ from the run's in the keys that `cldit.run.content.trace_content` ignores.

    Returns:
        A run of the other scene, with the same weights.

    Raises:
        EvaluationError: the trace is not this scene's.
    """
    if trace_content(run.scene) != trace_content(scene):
        raise EvaluationError(
            f"{scene.name}: is not served by the trace of {run.scene.name}; only temperatures of "
            "background and walls, the sensor and the plan may differ"
        )
    at_K = reference_temperature_K(scene.background.temperatures_K)
    quadrature = replace(run.quadrature, reference_K=at_K)
    sensor = sensor_of(scene, quadrature, (run.spectral, run.reference))
    return replace(
        run,
        scene=scene,
        weights=effective_weights(
            run.spectral,
            quadrature.nodes,
            background_K=at_K,
            wall_K=scene.walls.temperature_K,
            patches_K={patch.name: patch.temperature_K for patch in scene.patches},
        ),
        maps=evaluated(scene, quadrature, run.spectral, run.reference, sensor),
        info=replace(run.info, integration_time_s=sensor.integration_time_s),
        quadrature=quadrature,
        measured=None,
        ensemble=None,
        folder=None,
    )
