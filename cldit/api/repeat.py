"""A run computed again from its record, and the difference."""

import hashlib
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cldit.api.experiment import run_experiment
from cldit.comparison.difference import Difference, difference
from cldit.comparison.shown import open_shown
from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.io.exclusive import is_empty
from cldit.io.files import read_text
from cldit.run import Run, Say, open_run, simulate
from cldit.run.stored_files import SCENE_FILE
from cldit.scene import dump_scene


@dataclass(frozen=True, kw_only=True)
class Repeated:
    """Result of a repetition.

    trace: difference of the traces, the repetition minus the run. recorded: difference of the
    recordings; None if the run has no acquisition. inputs: a line for each input that has changed
    since the run. changed: versions and device that differ, then and now.
    """

    trace: Difference
    recorded: Difference | None
    inputs: tuple[str, ...]
    changed: Mapping[str, tuple[str, str]]

    @property
    def within(self) -> bool:
        """True if the stated errors explain all differences."""
        return self.trace.within and (self.recorded is None or self.recorded.within)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "within": self.within,
            "trace": self.trace.to_dict(),
            "recorded": None if self.recorded is None else self.recorded.to_dict(),
            "inputs": list(self.inputs),
            "changed": {name: list(pair) for name, pair in self.changed.items()},
        }


def inputs_that_changed(run: Run) -> tuple[str, ...]:
    """Lines about inputs of a run that are missing or have changed since.

    The scene in the run's own folder counts as an input.
    """
    lines = []
    origin = run.info.origin
    if origin is not None and origin.scene_sha256:
        texts = [dump_scene(run.scene)]
        if run.folder is not None:  # another version has other keys, and wrote other text
            texts.append(read_text(run.folder / SCENE_FILE))
        if origin.scene_sha256 not in (
            hashlib.sha256(document.encode()).hexdigest() for document in texts
        ):
            lines.append(f"{run.folder or run.scene.name}/scene.yaml: has changed since the run")
    inputs = run.info.files if origin is None else origin.inputs
    lines += [f"{read.path}: {read.change}" for read in inputs if read.change]
    return tuple(lines)


def repeat(
    folder: str | Path,
    *,
    out: str | Path | None = None,
    device: Device | None = None,
    changed_inputs: bool = False,
    within_K: float | None = None,
    progress: Say | None = None,
) -> Repeated:
    """Computes a stored run again and compares.

    A recording by the run's rig is recorded and evaluated again too. Tables and sprays are taken
    from the cache if they are there: their names contain a digest of all that they depend on.

    Args:
        folder: folder of the run.
        out: empty folder to keep the repetition in; None keeps nothing.
        device: OpenCL device; None chooses.
        changed_inputs: continue although inputs are missing or have changed.
        within_K: RMS allowed in T_app; None: explained by the stated errors.
        progress: called with a line of text as things happen.

    Returns:
        Differences of traces and recordings; inputs and versions that have changed.

    Raises:
        RunFolderError: the folder contains no run, inputs are missing or changed, or `out` is not
            empty.
        ClditError: as `cldit.simulate`.
    """
    run = open_run(folder)
    inputs = inputs_that_changed(run)
    if inputs and not changed_inputs:
        raise RunFolderError(
            "\n".join(
                [
                    f"{folder}: cannot be repeated, its inputs have changed; "
                    "--changed-inputs (changed_inputs=True) continues all the same",
                    *inputs,
                ]
            )
        )
    recorded = run.measured is not None
    with _place(out) as place:
        if recorded:
            repeated = run_experiment(run.scene, place, device=device, progress=progress)
        else:
            repeated = simulate(run.scene, place, device=device, progress=progress)
        return Repeated(
            trace=_compared(run, repeated, acquired=False, within_K=within_K),
            recorded=_compared(run, repeated, acquired=True, within_K=within_K)
            if recorded
            else None,
            inputs=inputs,
            changed=_changed(run, repeated),
        )


def _compared(run: Run, repeated: Run, *, acquired: bool, within_K: float | None) -> Difference:
    original, repetition = (open_shown(result, acquired=acquired) for result in (run, repeated))
    return difference(
        replace(original, name=str(run.folder)),
        replace(repetition, name="the repetition"),
        within_K=within_K,
    )


@contextmanager
def _place(out: str | Path | None) -> Iterator[Path]:
    if out is None:
        with tempfile.TemporaryDirectory(prefix="cldit-repeat-") as folder:
            yield Path(folder)
        return
    place = Path(out)
    if not is_empty(place):
        raise RunFolderError(f"{place}: is not empty; allowed: an empty folder, or a new one")
    yield place


def _changed(run: Run, repeated: Run) -> dict[str, tuple[str, str]]:
    """Versions, commit and device that are not the same."""
    recorded, current = (
        {
            **result.info.versions,
            "device": result.info.device,
            "commit": (result.info.origin and result.info.origin.commit) or "",
        }
        for result in (run, repeated)
    )
    return {
        name: (recorded.get(name, ""), current.get(name, ""))
        for name in dict.fromkeys((*recorded, *current))
        if recorded.get(name) != current.get(name)
    }
