"""One scene through spray, optics, octree, trace and noise-free evaluation.

scene = cldit.load_scene("gdi")
run = cldit.simulate(scene, out="runs/gdi")
run.maps.apparent_temperature_K
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import platformdirs

from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.errors import EvaluationError
from cldit.gpu.device import Device, open_device
from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, build_octree
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.radiance.boundary import Boundary, Surroundings, picture
from cldit.radiance.effective import effective_weights
from cldit.radiance.weights import Weights
from cldit.run.accuracy import StatedError
from cldit.run.budget import Budget
from cldit.run.content import trace_content
from cldit.run.errors import Cause, Errors
from cldit.run.folder import save_run, stored_run
from cldit.run.medium import Medium, make_medium
from cldit.run.result import Run, RunInfo, Stage
from cldit.run.spectral import (
    Difference,
    NodeTraces,
    SpectralInfo,
    node_settings,
    trace_nodes,
)
from cldit.run.stages import Say, Stages
from cldit.scene import Scene
from cldit.spray.result import Spray
from cldit.transport.trace import Settings, settings_for, trace

_VERSIONS = ("cldit", "numpy", "scipy", "pyopencl")


def default_cache() -> Path:
    """Folder in which tables are kept from run to run."""
    return Path(platformdirs.user_cache_dir("cldit", appauthor=False))


def simulate(
    scene: Scene,
    out: str | Path | None = None,
    *,
    device: Device | None = None,
    cache: Path | None = None,
    spray: Spray | None = None,
    progress: Say | None = None,
) -> Run:
    """Traces a scene and evaluates it without noise.

    Args:
        out: folder to store the run in; None keeps it in memory. A folder that holds the same
            scene, finished, is read instead of traced again.
        device: OpenCL device; None lets `open_device` choose (the run says which and why).
        cache: folder for tables and computed sprays; None is `default_cache()`.
        spray: the scene's spray, where it is there already; None makes it.
        progress: called with a line of text as things happen.

    Raises:
        ClditError: a subclass that says what is wrong and what to do.
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        stored = stored_run(folder, scene)
        if stored is not None:
            if progress is not None:
                progress(f"{folder} holds this scene already: read, not traced again")
            return stored
    device = device or open_device()
    stages = Stages(progress)
    medium = make_medium(scene, stages, cache or default_cache(), spray)
    frame, chosen = medium.trees[0].frame, medium.properties.chosen
    grey = settings_for(scene, medium.properties.paper_phase)
    settings = node_settings(scene, chosen.quadrature, medium.properties.phases)
    result = trace_nodes(medium.trees, chosen.quadrature, scene, device, settings, report=progress)
    reference = trace(_nothing(frame), scene, device, grey).weights
    stages.done += _traced(result, scene.transport.order)
    with stages.stage("evaluation"):
        sensor = _sensor(scene, chosen.quadrature, (result.spectral, reference))
        maps = _evaluate(scene, chosen.quadrature, result.spectral, reference, sensor)
    stated = StatedError.of(scene, result, maps)
    stages.remark(result.short)
    if stated is not None:
        stages.remark(stated.remarks(scene.transport))
    with stages.stage("errors"):
        errors = _errors(scene, device, medium, result, settings, stated, progress)
    from_paper = None
    if medium.paper is not None:
        with stages.stage("the paper's properties"):
            other = trace(medium.paper, scene, device, grey).weights
            one = Quadrature.grey(
                chosen.quadrature.filter_um, reference_K=chosen.quadrature.reference_K
            )
            from_paper = Difference.of(maps, _evaluate(scene, one, (other,), reference, sensor))
    run = Run(
        scene=scene,
        weights=result.weights,
        reference=reference,
        maps=maps,
        info=_info(
            device,
            result,
            stated,
            stages,
            medium,
            sensor.integration_time_s,
            SpectralInfo.of(chosen.quadrature, chosen.errors_K, from_paper),
            errors,
        ),
        quadrature=chosen.quadrature,
        spectral=result.spectral,
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
    sensor = _sensor(scene, quadrature, (run.spectral, run.reference))
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
        maps=_evaluate(scene, quadrature, run.spectral, run.reference, sensor),
        info=replace(run.info, integration_time_s=sensor.integration_time_s),
        quadrature=quadrature,
        measured=None,
        folder=None,
    )


def _nothing(frame: Frame) -> Octree:
    """The same cube without a spray."""
    return build_octree(frame, None, [], optical_depth_split=1.0)


def _sensor(
    scene: Scene, quadrature: Quadrature, seen: tuple[tuple[Weights, ...], Weights]
) -> SensorModel:
    """The scene's sensor, set so that its hottest background does not saturate it.

    seen: weights of the nodes with spray, and the one without.
    """
    sensor = SensorModel.from_scene(scene)
    if scene.camera.sensor.integration_time_s is not None:
        return sensor
    around = Surroundings.from_scene(scene)
    bands = [Boundary.of(around, node.radiance, node.pane) for node in quadrature.nodes]
    hottest = max(scene.background.temperatures_K)
    spray, reference = seen
    images = [
        picture(weights, bands, background_K=hottest)
        for weights in (spray, [reference] * len(bands))
    ]
    return sensor.exposed_for(max(float(image.max()) for image in images))


def _evaluate(
    scene: Scene,
    quadrature: Quadrature,
    spectral: tuple[Weights, ...],
    reference: Weights,
    sensor: SensorModel,
) -> Maps:
    if len(set(scene.background.temperatures_K)) < 2:
        # A trace is of use without DIT; the maps say why they are empty.
        return Maps.unevaluated(reference.background.shape, Reason.TOO_FEW_BACKGROUNDS)
    return evaluate_radiance(
        spectral,
        reference,
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=Surroundings.from_scene(scene),
        filter_um=quadrature.filter_um,
        nodes=quadrature.nodes if len(spectral) > 1 else None,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )


def _errors(
    scene: Scene,
    device: Device,
    medium: Medium,
    result: NodeTraces,
    settings: Sequence[Settings],
    stated: StatedError | None,
    say: Say | None,
) -> Errors | None:
    """What each cause adds to the error of T_app; None where the scene wants no audit."""
    probed = medium.probed
    if probed is None:
        return None
    spectral = medium.properties.chosen
    causes: list[Cause | None] = []
    if stated is not None:
        causes += stated.causes
    if spectral.errors_K:
        how = f"{len(spectral.nodes)} nodes against more, on lines of sight through the spray"
        causes.append(Cause("wavelengths", spectral.error_K, how))
    one = replace(settings[probed.number], method="source", audit=False)
    budget = Budget(scene, device, one, probed)
    base = result.traces[probed.number].weights
    if scene.transport.method != "source":
        base = budget.traced()
    return Errors.of([*causes, *budget.causes(base, say)])


def _traced(result: NodeTraces, order: int | None) -> list[Stage]:
    """What the traces did, step by step, and how long it took."""
    counts = result.counts
    iterations = [one.solution.iterations for one in result.traces if one.solution is not None]
    samples = f"{counts['samples']} samples a pixel" if "samples" in counts else ""
    notes = {"audit": "of some pixels, by path tracing", "gather": samples}
    scattering = []
    if order is not None:
        scattering.append(f"up to order {order}, beyond it the wall is seen")
    if iterations:
        scattering.append(f"{counts['sweeps']} sweeps; {sum(iterations)} iterations")
    if "gather" not in result.seconds and samples:
        scattering.append(samples)
    if "scattered_rays" in counts:
        scattering.append(f"{counts['scattered_rays']} rays started by scattering")
    notes["scattering"] = "; ".join(scattering)
    usual = ("compile", "scattering", "image")
    steps = [*usual, *(name for name in ("gather", "audit") if name in result.seconds)]
    return [
        Stage(name, result.seconds[name], notes.get(name, ""))
        if name in result.seconds
        else Stage(name, 0.0, "left out: nothing scatters")
        for name in steps
    ]


def _info(
    device: Device,
    result: NodeTraces,
    stated: StatedError | None,
    stages: Stages,
    medium: Medium,
    integration_time_s: float,
    spectral: SpectralInfo,
    errors: Errors | None,
) -> RunInfo:
    last = result.traces[-1]  # all are compiled alike
    versions = {name: version(name) for name in _VERSIONS}
    versions["python"] = platform.python_version()
    versions["opencl"] = f"{device.info.version}, driver {device.info.driver}"
    return RunInfo(
        device=f"{device.info.index} {device.info.name} ({device.info.platform})",
        device_reason=device.reason,
        stages=tuple(stages.done),
        accuracy_K=None if stated is None else stated.error_K,
        spray=medium.notes,
        files=medium.files,
        phase=medium.properties.phase,
        counts=result.counts,
        defines={program.name: dict(program.defines) for program in last.programs},
        precision=last.precision,
        closure=result.closure,
        remarks=tuple(stages.remarks),
        integration_time_s=integration_time_s,
        spectral=spectral,
        versions=versions,
        errors=errors,
    )
