"""Sweep over many scenes with dask.distributed, on the cores of this machine or on a cluster.

Scenes that share a trace are one task; tasks that share a computed spray wait for it. The caller
writes each result as it arrives: after the death of a worker only its present task is repeated,
after that of the caller only what had not arrived.
"""

from __future__ import annotations

import getpass
import logging
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from filelock import FileLock, Timeout

from cldit.errors import ClditError, StudyError
from cldit.gpu.checks import failed_devices
from cldit.gpu.device import Device, list_devices
from cldit.io.content import digest
from cldit.io.exclusive import exclusive
from cldit.io.terminal import warn
from cldit.prepare.spray_factory import make_spray
from cldit.run import RunCache, default_cache
from cldit.run.content import trace_key
from cldit.run.trusted import open_device
from cldit.scene import Scene
from cldit.scene.load import chosen_scene
from cldit.scene.spray import LagrangianSpray
from cldit.spray.result import Spray
from cldit.study.dataset import (
    check_folder,
    done,
    extra,
    open_folder,
    open_study,
    results_of,
    write,
)
from cldit.study.grid import Grid, Point

if TYPE_CHECKING:
    import xarray

_DEATHS = 10  # workers that may die at one task before it is abandoned
_THREADS = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
_NUMPY_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_MOST_WORKERS = 1024  # of a machine
_RANKS: list[FileLock] = []  # held as long as the process lives


@dataclass(frozen=True)
class Progress:
    """Scenes done of all, and estimate of the remaining seconds, None before the first."""

    done: int
    total: int
    remaining_s: float | None


@dataclass(frozen=True)
class SweepRecord:
    """Result of a sweep. stored: scenes from an earlier call; failed: scene number and message."""

    folder: Path
    scenes: int
    stored: int
    traces: int
    seconds: float
    failed: tuple[tuple[int, str], ...] = ()

    def to_xarray(self) -> xarray.Dataset:
        """The scenes as one data set; raises as `cldit.open_study`."""
        return open_study(self.folder)


Watch = Callable[[Progress], None]
# Scenes with their results or a message, worker and seconds.
Finished = list[tuple[Point, dict[str, Any] | str, str, float]]
T = TypeVar("T")


def run_sweep(
    scene: Scene | str | Path,
    grid: Grid | str,
    out: str | Path | None = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    cache: Path | None = None,
    watch: Watch | None = None,
) -> SweepRecord:
    """Traces and evaluates every scene of a grid; the same call resumes a sweep.

    Args:
        scene: a scene, a shipped name, or a YAML file, whose values are changed.
        grid: of the changes, as `"walls.temperature_K=300:600:25,spray.seed=1,2"`.
        out: folder of the results; None: sweeps/SCENE.
        scheduler: address of a running dask scheduler; None starts workers on this machine.
        workers: on this machine; None: one for each GPU, or for each core without one.
        cache: folder of tables, sprays and traces of the workers; None: their default.
        watch: called after each trace.

    Returns:
        The record; its `to_xarray()` opens all scenes as one data set, NaN where a scene failed.

    Raises:
        StudyError: the grid is not allowed, the folder has another sweep, or no scheduler answers.
        SceneError: a value of the grid is not allowed.
    """
    scene = chosen_scene(scene)
    grid = Grid.parse(grid) if isinstance(grid, str) else grid
    out = Path("sweeps") / scene.name if out is None else Path(out)
    for name in ("xarray", "zarr", "dask.array", "distributed"):
        extra(name)  # before anything is written
    points = list(grid.points(scene))
    _check_images(points)
    check_folder(out)
    with exclusive(out, "sweep"):
        open_folder(out, points[0].scene, grid)
        stored = done(out)
        groups = _by_trace(point for point in points if point.number not in stored)
        failed: list[tuple[int, str]] = []
        start, come = time.perf_counter(), 0
        if groups:
            with client_of(scheduler, len(groups), workers) as client:
                for finished in _results(client, list(groups.values()), cache):
                    failed += _written(out, finished)
                    come += len(finished)
                    rate, ready = (time.perf_counter() - start) / come, len(stored) + come
                    if watch is not None:
                        watch(Progress(ready, len(points), (len(points) - ready) * rate))
        return SweepRecord(
            folder=out,
            scenes=len(points),
            stored=len(stored),
            traces=len(groups),
            seconds=time.perf_counter() - start,
            failed=tuple(sorted(failed)),
        )


def _by_trace(points: Iterable[Point]) -> dict[str, list[Point]]:
    groups: dict[str, list[Point]] = defaultdict(list)
    for point in points:
        groups[trace_key(point.scene)].append(point)
    return groups


def _written(folder: Path, finished: Finished) -> list[tuple[int, str]]:
    """Writes the results of scenes; returns numbers and messages of those that failed."""
    failed = []
    for point, results, worker, seconds in finished:
        if isinstance(results, str):
            failed.append((point.number, results))
        else:
            write(folder, point, results, worker=worker, seconds=seconds)
    return failed


def _check_images(points: Sequence[Point]) -> None:
    """Raises StudyError if the images of the scenes differ in pixels, size or place."""

    def image_of(scene: Scene) -> dict[str, Any]:
        camera = scene.camera
        return {"pixels": camera.pixels, "field_m": camera.field_m, "target_m": scene.target_m}

    expected = image_of(points[0].scene)
    for point in points:
        for key, value in image_of(point.scene).items():
            if value != expected[key]:
                raise StudyError(
                    f"--grid: camera.{key} changes from scene to scene ({value}), and such images "
                    "do not fit into one data set; make a sweep for each"
                )


def _results(client: Any, groups: list[list[Point]], cache: Path | None) -> Iterator[Finished]:
    """Results of the tasks in the order in which they finish."""
    sprays: dict[str, Any] = {}
    futures: dict[Any, list[Point]] = {}
    for group in groups:
        spec = group[0].scene.spray
        spray = None
        if isinstance(spec, LagrangianSpray):
            key = digest(spec.model_dump(mode="json", exclude={"scatter"}))
            if key not in sprays:
                sprays[key] = client.submit(_spray, spec, cache, pure=False)
            spray = sprays[key]
        futures[client.submit(_group, group, spray, cache, pure=False)] = group
    sprays.clear()  # each exists while a task waits for it
    for group, finished, problem in as_finished(client, futures):
        yield [(point, problem, "", 0.0) for point in group] if problem else finished


def as_finished(client: Any, futures: dict[Any, T]) -> Iterator[tuple[T, Any, str]]:
    """Key of each future, its result, and its problem if it failed, in the order of completion."""
    for future in extra("distributed").as_completed(list(futures), loop=client.loop):
        key, error = futures.pop(future), future.exception()
        if error is None:
            yield key, future.result(), ""
        else:
            yield key, None, f"{type(error).__name__}: {error}"
        future.release()


def _spray(spec: LagrangianSpray, cache: Path | None) -> Spray:
    """Computes a spray on a worker."""
    return make_spray(spec, worker_device(), cache=cache or default_cache())


def _group(group: list[Point], spray: Spray | None, cache: Path | None) -> Finished:
    """Makes one trace on a worker and evaluates it for all scenes of the group.

    An error of cldit is a result, so the other scenes are evaluated; dask reports all others.
    """
    runs = RunCache(cache or default_cache())
    worker = f"{os.uname().nodename}:{os.getpid()}"
    finished: Finished = []
    # Noise in front of the brightest walls needs most paths of the final gather.
    for point in sorted(group, key=lambda variant: -variant.scene.walls.temperature_K):
        start = time.perf_counter()
        try:
            run = runs.run(
                point.scene, device=worker_device(), spray=None if spray is None else lambda: spray
            )
            results: dict[str, Any] | str = results_of(run)
        except ClditError as error:
            results = str(error)
        finished.append((point, results, worker, time.perf_counter() - start))
    return finished


def _gpus() -> list[str]:
    """Indices of the GPUs that have not failed their check."""
    failed = failed_devices()
    gpus = [info.index for info in list_devices() if info.kind == "gpu"]
    return [index for index in gpus if index not in failed]


@cache
def worker_device() -> Device:
    """Device of this worker: workers of a machine take its GPUs in turn, whatever their names.

    On a CPU it has as many threads as the worker. GPUs that CUDA_VISIBLE_DEVICES hides are none.
    """
    threads = str(extra("distributed").get_worker().state.nthreads)
    for name in _THREADS:  # before the platform is asked; LocalCluster has set its own
        os.environ.setdefault(name, threads)
    gpus = _gpus()
    return open_device(gpus[worker_rank(gpus) % len(gpus)] if gpus else None)


def worker_rank(gpus: Sequence[str]) -> int:
    """Number of this process among the workers of this machine and user, from 0, until it ends.

    It is the first whose file no other worker has locked.
    """
    visible = os.environ.get("CUDA_VISIBLE_DEVICES", "")
    name = digest([getpass.getuser(), visible, *gpus])[:16]
    for rank in range(_MOST_WORKERS):
        lock = FileLock(Path(tempfile.gettempdir()) / f"cldit-worker-{name}-{rank}.lock")
        with suppress(Timeout):
            lock.acquire(timeout=0.0)
            _RANKS.append(lock)
            return rank
    raise StudyError(f"more than {_MOST_WORKERS} workers on one machine")


def local_workers(groups: int) -> tuple[int, int]:
    """Workers on this machine and threads of each: one worker for each GPU, else for each core."""
    cores = len(os.sched_getaffinity(0))
    gpus = len(_gpus())
    count = max(1, min(gpus or cores, groups))
    return count, max(1, cores // count)


@contextmanager
def client_of(scheduler: str | None, groups: int, workers: int | None) -> Iterator[Any]:
    """Client of a running scheduler, or of workers on this machine for so many groups."""
    distributed, dask = extra("distributed"), extra("dask")
    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.comm.timeouts.connect": "10s",
    }
    with dask.config.set(settings):
        if scheduler is not None:
            try:
                client = distributed.Client(scheduler, timeout="10s", set_as_default=False)
            except (OSError, ValueError, TimeoutError) as error:
                raise StudyError(
                    f"--scheduler {scheduler}: no dask scheduler answers there ({error}); start "
                    "one with `dask scheduler`, and workers with `dask worker ADDRESS`"
                ) from error
            with client:
                if not client.scheduler_info()["workers"]:
                    warn(f"--scheduler {scheduler}: it has no worker yet; the sweep waits for one")
                yield client
            return
        count, threads = local_workers(min(workers or groups, groups))
        count = workers or count
        # One thread for each worker; the libraries in it share the remaining cores.
        with (
            distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                # No page; the port of its measurements is any free one, for several sweeps.
                scheduler_kwargs={"dashboard": False, "dashboard_address": "localhost:0"},
                silence_logs=logging.ERROR,  # a busy machine ends workers late, and warns
                env={name: str(threads) for name in (*_THREADS, *_NUMPY_THREADS)},
                # Others on this machine could send code to an open scheduler.
                security=distributed.Security.temporary(),
            ) as cluster,
            distributed.Client(cluster, set_as_default=False) as client,
        ):
            yield client
