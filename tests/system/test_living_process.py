"""A process that lives: many runs, threads that share a device, and forks."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import cldit
from cldit.errors import DeviceError
from cldit.gpu.device import Device, open_device, split
from cldit.prepare.medium import prepare
from cldit.prepare.stages import Stages
from cldit.transport.trace import settings_for, trace
from tests.patience import HANG_s, until
from tests.small_scenes import block_scene, deep_block

PHASES = ("isotropic", "mie")
# Of 30 runs, the last 27 add 16 MB each where each opens the device anew. What the allocator moves
# up and down was 2 MB; a tenth of what a single run in three would leave is allowed.
GROWTH_MB = 14.0
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


def block(phase: str, pixels: int = 12) -> cldit.Scene:
    transport = {"audit": False, "accuracy_K": 1.0, "phase": phase}
    return block_scene(pixels, transport=transport)


@pytest.mark.parametrize(
    ("rounds", "phases"),
    [(3, PHASES[:1]), pytest.param(20, PHASES, marks=pytest.mark.slow)],
)
def test_pictures_of_threads_equal_those_of_one(
    device: Device, tmp_path: Path, rounds: int, phases: tuple[str, ...]
) -> None:
    """To the last bit, of one medium, and of two at once."""
    made = {}
    for phase in phases:
        scene = block(phase)
        stages = Stages(None)
        medium = prepare(scene, device, stages, tmp_path, deep_block()).grown()
        table = (*medium.properties.phases, None)[0]
        made[phase] = (medium.trees[0], scene, settings_for(scene, table))

    def picture(phase: str) -> NDArray[np.float32]:
        tree, scene, settings = made[phase]
        images = trace(tree, scene, device, settings).weights.images
        return np.stack(list(images.values()))

    alone = {phase: picture(phase) for phase in phases}
    jobs = [*phases, *phases] * rounds
    with ThreadPoolExecutor(4) as pool:
        for phase, found in zip(jobs, pool.map(picture, jobs), strict=True):
            np.testing.assert_array_equal(found, alone[phase], err_msg=phase)


def test_runs_share_one_opening_until_all_is_closed() -> None:
    """However the device is named; and a closed one says so, while others stay good."""
    first = open_device()
    with open_device(first.info.index) as second:
        assert second.opened is first.opened
        assert second.info.version == first.info.version
    with pytest.raises(DeviceError, match=r"was closed; open it again: cldit\.opencl_device\(\)"):
        _ = second.queue
    assert open_device().opened is first.opened  # which still uses it
    if first.is_cpu and first.info.compute_units > 1:
        assert split(first, (1,)).opened is not first.opened


def test_each_thread_has_a_queue(device: Device) -> None:
    queues = [device.queue]
    thread = threading.Thread(target=lambda: queues.append(device.queue))
    thread.start()
    thread.join()
    assert queues[0] == device.queue != queues[1]


def _runs() -> None:
    """30 runs without `device=`; prints what memory the third and later ones leave, in MB."""
    spray, cache = deep_block(), Path(sys.argv[1])
    scene = block(PHASES[0], pixels=8)
    for run in range(30):
        cldit.simulate(scene, spray=spray, cache=cache)
        if run >= 2:
            with open("/proc/self/statm", encoding="ascii") as file:
                pages = int(file.read().split()[1])
            print(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="resident memory is read from /proc")
def test_memory_is_flat_from_the_third_run_on(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, __file__, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=HANG_s,
    )
    resident = np.array([float(line) for line in done.stdout.split()])
    assert len(resident) == 28
    assert np.max(resident) - resident[0] < GROWTH_MB


def _said(use: str) -> str:
    """What a forked child is told: of a device of its own, and of its parent's."""
    try:
        _ = open_device() if use == "new" else _PARENTS[0].queue
    except DeviceError as error:
        return str(error)
    return "opened"


_PARENTS: list[Device] = []


@needs_fork
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize("use", ["new", "parent's"])
def test_a_fork_is_told_to_spawn(use: str, device: Device) -> None:
    _PARENTS[:] = [device]
    _ = device.queue
    with multiprocessing.get_context("fork").Pool(1) as pool:
        said = pool.map_async(_said, [use]).get(timeout=HANG_s)[0]
    assert "multiprocessing.get_context('spawn').Pool()" in said


@needs_fork
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_fork_ends_without_its_parents_threads(device: Device) -> None:
    """And releases nothing of the parent's, for which it would wait for these."""
    _ = device.queue
    child = os.fork()
    if child == 0:
        device.close()
        os._exit(0)
    try:
        until(lambda: os.waitpid(child, os.WNOHANG)[0] == child)
    except AssertionError:
        os.kill(child, 9)
        os.waitpid(child, 0)
        raise


if __name__ == "__main__":
    _runs()
