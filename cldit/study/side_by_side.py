"""Injections of an ensemble, traced side by side with dask.distributed.

Each injection is a run in the folder of the ensemble, where `cldit.simulate` finds it; an injection
that is finished is not traced again. Workers on other machines must see the folder.
"""

from __future__ import annotations

import time
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
        left = [
            number
            for number in range(1, members_of(scene) + 1)
            if stored_run(member_folder(folder, number), member(scene, number)) is None
        ]
        if not left:
            return 0
        failed: list[str] = []
        start = time.perf_counter()
        with client_of(scheduler, min(workers or len(left), len(left)), workers) as client:
            futures = {
                client.submit(_traced, scene, number, folder, cache, pure=False): number
                for number in left
            }
            done = members_of(scene) - len(left)
            for number, refused, broken in as_finished(client, futures):
                if problem := refused or broken:
                    failed.append(f"injection {number}: {problem}")
                done += 1
                rate = (time.perf_counter() - start) / (len(left) - len(futures))
                if watch is not None:
                    watch(Progress(done, members_of(scene), rate * len(futures)))
        if failed:
            raise StudyError("\n".join(failed))
        return len(left)


def _traced(scene: Scene, number: int, folder: Path, cache: Path | None) -> str:
    """Traces one injection on a worker; returns the problem, empty if there is none."""
    try:
        simulate(
            member(scene, number),
            member_folder(folder, number),
            device=worker_device(),
            cache=cache,
            like=open_run(folder / NOMINAL),
        )
    except ClditError as error:
        return str(error)
    return ""
