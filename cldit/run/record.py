"""Metadata stored with a run: stage timings, resolution, errors, provenance."""

from __future__ import annotations

import hashlib
from dataclasses import replace

from cldit.accuracy.converge import Result
from cldit.accuracy.problem import Problem
from cldit.io.origin import Origin, versions
from cldit.io.provenance import FileRead, files_read
from cldit.run.content import named_files
from cldit.run.model_spread import model_spread
from cldit.run.result import RunInfo
from cldit.run.spectral import Difference, SpectralInfo
from cldit.scene import Scene, dump_scene


def run_info(problem: Problem, result: Result, from_paper: Difference | None) -> RunInfo:
    """Metadata of a run; `from_paper` is the difference from the paper's optical properties."""
    device, stages, scene, medium = problem.device, problem.stages, problem.scene, result.medium
    last = result.traces.traces[-1]  # all are compiled alike
    errors = result.errors
    if errors is not None:
        errors = replace(errors, model=model_spread(scene, from_paper))
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
        defines={program.name: dict(program.defines) for program in last.programs},
        precision=last.precision,
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
    """Where the results of a scene come from.

    Args:
        scene: as the user wrote it.
        files: that its spray was read from. Those that cldit's own file (.npz) names were read by
            an import; here the .npz itself is the input.
    """
    named = [path for path in named_files(scene) if path.is_file()]
    own = any(path.suffix == ".npz" for path in named)
    known = () if own else files
    before = {one.path for one in known}
    more = files_read(path for path in named if str(path.resolve()) not in before)
    return Origin.now(
        inputs=(*known, *more),
        scene=scene.model_dump(mode="json"),
        scene_sha256=hashlib.sha256(dump_scene(scene).encode()).hexdigest(),
    )
