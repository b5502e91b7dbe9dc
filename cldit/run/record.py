"""What is put down of a run: its stages, and how it came about."""

from __future__ import annotations

import hashlib

from cldit.accuracy.errors import Errors
from cldit.accuracy.plan import Plan
from cldit.accuracy.spectral import NodeTraces, SpectralInfo
from cldit.accuracy.trace_error import StatedError
from cldit.gpu.device import Device
from cldit.io.origin import Origin, versions
from cldit.io.provenance import FileRead, files_read
from cldit.prepare.stages import Stages
from cldit.run.content import named_files
from cldit.run.result import RunInfo
from cldit.scene import Scene, dump_scene


def run_info(
    device: Device,
    result: NodeTraces,
    stages: Stages,
    *,
    stated: StatedError | None,
    notes: dict[str, float],
    files: tuple[FileRead, ...],
    integrals: tuple[dict[str, float], ...],
    phase: str,
    integration_time_s: float,
    spectral: SpectralInfo,
    errors: Errors | None,
    plan: Plan,
    scene: Scene,
) -> RunInfo:
    """How a run came about.

    Args:
        device, result, stages: that traced, what it traced, and what was done.
        stated: error of the trace.
        notes: figures of the spray.
        files: what the spray was read from.
        integrals: of each node's medium.
        phase: how droplets scatter, in words.
        integration_time_s: of the sensor.
        spectral: how the filter was resolved.
        errors: of the picture, by cause.
        plan: what was chosen.
        scene: as the user wrote it.
    """
    last = result.traces[-1]  # all are compiled alike
    return RunInfo(
        device=f"{device.info.index} {device.info.name} ({device.info.platform})",
        device_reason=device.reason,
        stages=tuple(stages.done),
        accuracy_K=None if stated is None else stated.whole_K,
        spray=notes,
        files=files,
        integrals=integrals,
        phase=phase,
        counts=result.counts,
        defines={program.name: dict(program.defines) for program in last.programs},
        precision=last.precision,
        closure=result.closure,
        remarks=tuple(stages.remarks),
        integration_time_s=integration_time_s,
        spectral=spectral,
        versions={
            **versions(),
            "opencl": f"{device.info.version}, driver {device.info.driver}",
        },
        errors=errors,
        plan=plan.to_dict(),
        origin=origin_of(scene, files),
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
