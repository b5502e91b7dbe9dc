"""Metadata stored with a run: stage timings, resolution, errors, provenance."""

import hashlib
from dataclasses import replace

from cldit.accuracy.converge import Result
from cldit.accuracy.errors import Cause
from cldit.accuracy.problem import Problem
from cldit.io.origin import FileRead, Origin, files_read, versions
from cldit.run.content import named_files
from cldit.run.result import RunInfo
from cldit.run.spectral import Difference, SpectralInfo
from cldit.scene import Scene, dump_scene
from cldit.scene.spray import ConeSpray, LagrangianSpray


def run_info(problem: Problem, result: Result, from_paper: Difference | None) -> RunInfo:
    """Metadata of a run; `from_paper` is the difference from the paper's optical properties."""
    device, stages, scene, medium = problem.device, problem.stages, problem.scene, result.medium
    trace = result.traces.traces[-1]  # all are compiled alike
    errors = None
    if scene.transport.audit:
        model = (*model_spread(scene, from_paper), *result.model)
        errors = replace(result.errors, model=model)
    trace_error = result.trace_error
    return RunInfo(
        device=f"{device.info.index} {device.info.name} ({device.info.platform})",
        device_reason=device.reason,
        stages=tuple(stages.done),
        accuracy_K=None if trace_error is None else trace_error.whole_K,
        spray=medium.notes,
        files=medium.files,
        integrals=medium.integrals,
        phase=medium.properties.phase,
        counts=result.traces.counts,
        defines={program.name: dict(program.defines) for program in trace.programs},
        precision=trace.precision,
        closure=result.traces.closure,
        remarks=tuple(stages.remarks),
        integration_time_s=result.sensor.integration_time_s,
        spectral=SpectralInfo.of(result.quadrature, medium.properties.chosen.errors_K, from_paper),
        versions={
            **versions(),
            "opencl": f"{device.info.version}, driver {device.info.driver}",
        },
        errors=errors,
        plan=result.plan,
        origin=origin_of(scene, medium.files),
    )


def origin_of(scene: Scene, files: tuple[FileRead, ...]) -> Origin:
    """Provenance of the results of a scene.

    `files` were read for its spray. The files named in cldit's own file (.npz) were read by an
    import; here the .npz itself is the input.
    """
    named = [path for path in named_files(scene) if path.is_file()]
    from_npz = any(path.suffix == ".npz" for path in named)
    spray_files = () if from_npz else files
    listed = {file.path for file in spray_files}
    other_files = files_read(path for path in named if str(path.resolve()) not in listed)
    return Origin.now(
        inputs=(*spray_files, *other_files),
        scene=scene.model_dump(mode="json"),
        scene_sha256=hashlib.sha256(dump_scene(scene).encode()).hexdigest(),
    )


def model_spread(scene: Scene, from_paper: Difference | None) -> tuple[Cause, ...]:
    """Spread of T_app by the spray model, and by optical data if the paper's were traced as well.

    It is no error of the simulation: it is stated beside the errors, never in their sum.
    """
    if isinstance(scene.spray, ConeSpray | LagrangianSpray):
        if isinstance(scene.spray, ConeSpray):
            basis = "a computed spray (spray.model: lagrangian) differs by 12 to 18 K in gdi"
        elif scene.spray.droplets is None:
            basis = "one jet of gas differs by 5 % from measured ones in its tip (docs/spray.md)"
        else:
            basis = "which spray model: compare with the same scene and spray.model: cone"
        spray = Cause("spray model", None, basis)
    else:
        spray = Cause("spray model", None, "the spray is given; its own model says")
    if from_paper is None:
        basis = "which n, k and vapour: optics.preset: spectral compares them with the paper's"
        return (spray, Cause("optical data", None, basis))
    return (
        spray,
        Cause("optical data", from_paper.rms_K, "RMS against the paper's n, k and vapour"),
    )
