"""Injections of an ensemble, and times of a series, traced side by side with dask.distributed.

Each is a run in a folder of its own, where `cldit.simulate` finds it; what is finished is not
traced again. Workers on other machines must see the folders.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from cldit.errors import ClditError, StudyError
from cldit.gpu.device import Device
from cldit.io.exclusive import exclusive
from cldit.run import Say, open_run, simulate
from cldit.run.ensemble import NOMINAL, begin, member_folder
from cldit.run.folder import stored_run
from cldit.scene import Scene
from cldit.scene.scatter import member, members_of, nominal
from cldit.study.sweep import Progress, Watch, as_finished, client_of, worker_device

T = TypeVar("T")


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
        remaining = [
            number
            for number in range(1, members_of(scene) + 1)
            if stored_run(member_folder(folder, number), member(scene, number)) is None
        ]
        if not remaining:
            return 0
        problems = _side_by_side(
            {
                number: (member(scene, number), member_folder(folder, number), folder / NOMINAL)
                for number in remaining
            },
            scheduler=scheduler,
            workers=workers,
            cache=cache,
            watch=watch,
        )
        if problems:
            raise StudyError(
                "\n".join(f"injection {at}: {problem}" for at, problem in problems.items())
            )
        return len(remaining)


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
    remaining = {
        folder.resolve(): scene
        for folder, scene in scenes.items()
        if stored_run(folder, scene) is None
    }
    traced = len(remaining)
    while remaining:
        folder, scene = remaining.popitem()
        with suppress(ClditError):
            simulate(scene, folder, device=device, cache=cache, progress=progress)
            break
    if remaining:
        _side_by_side(
            {folder: (scene, folder, None) for folder, scene in remaining.items()},
            scheduler=scheduler,
            workers=workers,
            cache=cache,
            watch=watch,
        )
    return traced


def _side_by_side(
    tasks: Mapping[T, tuple[Scene, Path, Path | None]],
    *,
    scheduler: str | None,
    workers: int | None,
    cache: Path | None,
    watch: Watch | None,
) -> dict[T, str]:
    """Traces each scene into its folder, with the numerics of a run if one is named; returns the
    problems."""
    problems: dict[T, str] = {}
    start = time.perf_counter()
    with client_of(scheduler, len(tasks), workers) as client:
        futures = {
            client.submit(_traced, *task, cache, pure=False): at for at, task in tasks.items()
        }
        for done, (at, refused, broken) in enumerate(as_finished(client, futures), start=1):
            if problem := refused or broken:
                problems[at] = problem
            rate = (time.perf_counter() - start) / done
            if watch is not None:
                watch(Progress(done, len(tasks), rate * len(futures)))
    return problems


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
