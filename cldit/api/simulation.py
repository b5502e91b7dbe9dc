"""`cldit.simulate`: a scene traced, and recorded by the simulated rig if that is asked for."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cldit.api.experiment import Watch, of_reading, run_experiment
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.run import Run, Say
from cldit.run import simulate as simulate_traces
from cldit.scene import Scene
from cldit.spray.result import Spray


def simulate(
    scene: Scene | str | Path,
    out: str | Path | None = None,
    *,
    record: bool = False,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
    device: Device | None = None,
    cache: Path | None = None,
    spray: Spray | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
    like: Run | None = None,
) -> Run:
    """Traces a scene and evaluates it without noise; with `record`, also by the simulated rig.

    With several injections (`spray.scatter.members`), the run is that of their mean light. After an
    interruption of any kind, the same call with a folder continues.

    Args:
        scene: a scene, the name of a shipped one (`gdi`), or the path of a YAML file.
        out: folder to store the run in; None keeps it in memory. A folder that holds the same
            scene, finished, is read instead of traced again.
        record: True records the traces with the simulated rig into `acquisition`, evaluates the
            shots (`measured` of the run) and writes the report; `out` is then needed.
        quick: True for a preview: 128 pixels along the longer side and a tolerance of 4 K.
        pixels: columns and rows, or one number for both; None: those of the scene.
        device: OpenCL device; None chooses (the run says which and why).
        cache: folder for tables and computed sprays; None: cldit's own.
        spray: the scene's spray, if it was made already; None makes it.
        progress: called with a line of text as things happen.
        watch: called with the progress of reading a CFD case, and of the rig.
        like: run whose resolution is taken; the error is then not estimated.

    Returns:
        Weights and maps (H, W), stated errors, and `measured` with `record`.

    Raises:
        RunFolderError: the folder has another scene, or another process writes to it.
        SprayError: `spray` is given for several injections.
        EvaluationError: `record` without `out`, with cache, spray or like, or for one background.
        Stopped: the recording was interrupted; the same call resumes it.
        ClditError: a subclass, with the problem and a remedy.
    """
    shared: dict[str, Any] = {
        "quick": quick, "pixels": pixels, "device": device, "progress": progress
    }  # fmt: skip
    of_trace: dict[str, Any] = {"cache": cache, "spray": spray, "like": like}
    if not record:
        return simulate_traces(scene, out, **shared, **of_trace, watch=of_reading(watch))
    if out is None or any(value is not None for value in of_trace.values()):
        raise EvaluationError("record=True: allowed: with `out`, and without cache, spray and like")
    return run_experiment(scene, out, **shared, watch=watch)
