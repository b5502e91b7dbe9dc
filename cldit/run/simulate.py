"""One scene through spray, optics, octree, trace and noise-free evaluation.

run = cldit.simulate("gdi", out="runs/gdi")
run.maps.apparent_temperature_K
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cldit.accuracy.attempt import Attempts
from cldit.accuracy.evaluation import evaluated, sensor_of
from cldit.errors import EvaluationError
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.io.progress import Watch, silent
from cldit.optics.spectral import reference_temperature_K
from cldit.prepare.stages import Say, Stages
from cldit.radiance.effective import effective_weights
from cldit.run.content import trace_content
from cldit.run.folder import save_run, stored_run
from cldit.run.record import run_info
from cldit.run.result import Run
from cldit.scene import Scene, load_scene
from cldit.spray.result import Spray


def simulate(
    scene: Scene | str | Path,
    out: str | Path | None = None,
    *,
    device: Device | None = None,
    cache: Path | None = None,
    spray: Spray | None = None,
    progress: Say | None = None,
    watch: Watch = silent,
) -> Run:
    """Traces a scene and evaluates it without noise.

    Args:
        scene: or the name of a shipped one (`gdi`), or the path of a YAML file.
        out: folder to store the run in; None keeps it in memory. A folder that holds the same
            scene, finished, is read instead of traced again.
        device: OpenCL device; None lets `open_device` choose (the run says which and why).
        cache: folder for tables and computed sprays; None is `default_cache()`.
        spray: the scene's spray, where it is there already; None makes it.
        progress: called with a line of text as things happen.
        watch: told how far the reading of a CFD case is.

    Raises:
        ClditError: a subclass that says what is wrong and what to do.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    folder = None if out is None else Path(out)
    if folder is not None:
        stored = stored_run(folder, scene)
        if stored is not None:
            if progress is not None:
                progress(f"{folder} holds this scene already: read, not traced again")
            return stored
    device = device or open_device()
    stages = Stages(progress, watch)
    attempts = Attempts(scene, device, stages, cache or default_cache(), spray)
    last = attempts.best()
    from_paper = attempts.against_paper(last)
    run = Run(
        scene=scene,
        weights=last.result.weights,
        reference=last.reference,
        maps=last.maps,
        info=run_info(
            device,
            last.result,
            stages,
            stated=last.stated,
            notes=last.medium.notes,
            files=last.medium.files,
            integrals=last.medium.integrals,
            phase=last.medium.properties.phase,
            integration_time_s=last.sensor.integration_time_s,
            spectral=last.spectral(from_paper),
            errors=last.with_model(from_paper),
            plan=last.plan,
            scene=scene,
        ),
        quadrature=last.quadrature,
        spectral=last.result.spectral,
        error_maps=last.error_maps,
        folder=folder,
    )
    if folder is not None:
        save_run(run, folder)
    return run


def reevaluated(run: Run, scene: Scene) -> Run:
    """The same trace before other backgrounds, walls and sensors: nothing is traced.

    Args:
        scene: may differ from the run's in what `cldit.run.content.trace_content` leaves out.

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
        folder=None,
    )
