"""Injections of an ensemble, and times of a series, traced side by side with dask.distributed.

Each is a run in a folder of its own, where `cldit.simulate` finds it; what is finished is not
traced again. Workers on other machines must see the folders.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from cldit.errors import ClditError, StudyError
from cldit.gpu.device import Device
from cldit.io.exclusive import exclusive
from cldit.run import Say, open_run, simulate
from cldit.run.ensemble import NOMINAL, begin, member_folder
from cldit.run.folder import stored_run
from cldit.scene import Scene
from cldit.scene.scatter import member, members_of, nominal
from cldit.study.sweep import Progress, Watch, as_finished, client_of, worker_device


def trace_members(
    scene: Scene,
    out: str | Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    device: Device | None = None,
    cache: Path | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
) -> int:
    """Traces the nominal injection, and then the others side by side; returns how many were traced.

    `scheduler` and `workers` are as in `run_sweep`, the rest as in `cldit.simulate`.
    """
    folder = Path(out).resolve()
    if members_of(scene) == 1 or stored_run(folder, scene) is not None:
        return 0
    with exclusive(folder, "run"):
        begin(scene, folder)
        simulate(nominal(scene), folder / NOMINAL, device=device, cache=cache, progress=progress)
        members = {
            member_folder(folder, number): member(scene, number)
            for number in range(1, members_of(scene) + 1)
        }
        count, problems = _side_by_side(
            members,
            like=folder / NOMINAL,
            scheduler=scheduler,
            workers=workers,
            cache=cache,
            watch=watch,
        )
        if problems:
            raise StudyError(
                "\n".join(f"injection {int(at.name)}: {text}" for at, text in problems.items())
            )
        return count


def trace_scenes(
    scenes: Mapping[Path, Scene],
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    device: Device | None = None,
    cache: Path | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
) -> int:
    """Traces scenes into the folders that are their keys, and returns how many were traced.

    The first is traced by this process, which keeps tables and the computed spray of all times.
    What fails is left to the caller, who finds it not traced.
    """
    remaining = _not_traced({folder.resolve(): scene for folder, scene in scenes.items()})
    traced = len(remaining)
    while remaining:
        folder, scene = remaining.popitem()
        with suppress(ClditError):
            simulate(scene, folder, device=device, cache=cache, progress=progress)
            break
    _side_by_side(
        remaining, like=None, scheduler=scheduler, workers=workers, cache=cache, watch=watch
    )
    return traced


def _not_traced(scenes: Mapping[Path, Scene]) -> dict[Path, Scene]:
    return {at: scene for at, scene in scenes.items() if stored_run(at, scene) is None}


def _side_by_side(
    scenes: Mapping[Path, Scene],
    *,
    like: Path | None,
    scheduler: str | None,
    workers: int | None,
    cache: Path | None,
    watch: Watch | None,
) -> tuple[int, dict[Path, str]]:
    """Traces scenes into their folders, with the numerics of the run `like` if one is given;
    returns how many were traced, and the problems by folder."""
    remaining = _not_traced(scenes)
    problems: dict[Path, str] = {}
    if not remaining:
        return 0, problems
    start = time.perf_counter()
    with client_of(scheduler, len(remaining), workers) as client:
        futures = {
            client.submit(_traced, scene, at, like, cache, pure=False): at
            for at, scene in remaining.items()
        }
        for done, (at, refused, broken) in enumerate(as_finished(client, futures), start=1):
            if problem := refused or broken:
                problems[at] = problem
            rate = (time.perf_counter() - start) / done
            if watch is not None:
                watch(Progress(done, len(remaining), rate * len(futures)))
    return len(remaining), problems


def _traced(scene: Scene, folder: Path, like: Path | None, cache: Path | None) -> str:
    """Traces one scene on a worker; returns the problem, empty if there is none."""
    try:
        simulate(
            scene,
            folder,
            device=worker_device(),
            cache=cache,
            like=None if like is None else open_run(like),
        )
    except ClditError as error:
        return str(error)
    return ""
