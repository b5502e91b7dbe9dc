"""Sweeps over local workers: every scene lands, also when a worker is killed, and only once."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.api.series import run_series
from cldit.errors import SceneError, StudyError
from cldit.run import RunCache, reevaluated
from cldit.scene import Scene, parse_scene
from cldit.study.dataset import done, open_folder
from cldit.study.grid import Grid
from cldit.study.side_by_side import trace_members, trace_scenes
from cldit.study.sweep import Progress, client_of, run_sweep
from tests.extras import needs

pytestmark = needs("distributed", "zarr", extra="studies")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Vapour and droplets in a small cone spray, 12 x 10 pixels."""
    return parse_scene(
        {
            "name": "swept",
            "domain": {"centre_m": [0.0, 0.0, -0.05], "leaf_edge_m": 0.01},
            "spray": {"model": "cone", "spacing_m": 0.004, "size_classes": 1},
            "camera": {"pixels": [12, 10], "field_m": [0.06, 0.05], "target_m": [0, 0, -0.02]},
            "background": {"temperatures_K": [440.0, 480.0], "radius_m": 0.08},
            "transport": {"directions": 8, "audit": False},
        }
    )


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers, as a user's cluster would be: only its address is given to the sweep."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        scheduler_kwargs={"dashboard": False, "dashboard_address": "localhost:0"},
    ) as started:
        yield started


@pytest.mark.slow
def test_killed_worker_loses_nothing(scene: Scene, cluster: Any, tmp_path: Path) -> None:
    """One of two workers is killed after the first results; every scene is in the data set, equal
    to what the same scene gives on its own, and the folder is found whole by a second call."""
    grid = Grid.parse("spray.fuel_temperature_K=340:370:10,walls.temperature_K=300,450")
    killed: list[int] = []

    def watch(progress: Progress) -> None:
        if not killed:
            pid = next(iter(cluster.workers.values())).process.pid
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)
        assert progress.total == 8 and 0 < progress.done <= 8

    sweep = tmp_path / "sweep"
    record = run_sweep(
        scene,
        grid,
        sweep,
        scheduler=cluster.scheduler_address,
        cache=tmp_path / "cache",
        watch=watch,
    )
    assert killed
    assert (record.scenes, record.stored, record.traces, record.failed) == (8, 0, 4, ())
    data = cldit.open_study(sweep)
    assert data.sizes == {
        "spray.fuel_temperature_K": 4,
        "walls.temperature_K": 2,
        "z": 10,
        "x": 12,
    }
    assert data["walls.temperature_K"].attrs["units"] == "K"
    assert data.x.attrs["units"] == "mm" and float(data.z[0]) > float(data.z[-1])
    assert bool(np.isfinite(data.emissivity).all())
    last = list(grid.points(scene))[-1].scene
    alone = cldit.simulate(last, cache=tmp_path / "cache")
    found = data.sel({"spray.fuel_temperature_K": 370.0, "walls.temperature_K": 450.0})
    # The same code on the same data; other work-group orders leave rounding only.
    np.testing.assert_allclose(found.emissivity, alone.maps.emissivity, atol=1e-6)
    assert found.error_K.attrs["units"] == "K" and np.isnan(float(found.error_K))  # no audit
    again = run_sweep(scene, grid, sweep, scheduler="tcp://127.0.0.1:9")  # nobody is asked
    assert (again.stored, again.traces) == (8, 0)
    with pytest.raises(StudyError, match="another grid or scene"):
        run_sweep(scene, Grid.parse("walls.temperature_K=300"), sweep)


def test_sources_are_not_traced_again(scene: Scene, tmp_path: Path) -> None:
    """Walls and backgrounds: one trace serves all scenes, and a repeated one costs nothing."""
    kept = RunCache(tmp_path)
    grid = Grid.parse("walls.temperature_K=0:600:300,background.emissivity=0.9,1")
    runs = [kept.run(point.scene) for point in grid.points(scene)]
    assert kept.computed == ["swept"]
    first, cold, hot = runs[0], runs[1], runs[-1]
    alone = cldit.simulate(first.scene, cache=tmp_path)
    for one in (first, reevaluated(hot, first.scene)):
        np.testing.assert_array_equal(
            one.maps.apparent_temperature_K, alone.maps.apparent_temperature_K
        )
    np.testing.assert_array_equal(
        hot.maps.apparent_temperature_K,
        reevaluated(alone, hot.scene).maps.apparent_temperature_K,
    )
    np.testing.assert_array_equal(hot.weights.wall, cold.weights.wall)
    kept.run(runs[0].scene.model_copy(update={"transport": runs[0].scene.transport}))
    assert kept.computed == ["swept"]


def test_refused(scene: Scene, tmp_path: Path) -> None:
    """What cannot be swept is refused before anything is computed."""
    with pytest.raises(StudyError, match=r"camera\.pixels changes"):
        run_sweep(scene, Grid.parse("camera.pixels=8,16"), tmp_path / "a")
    with pytest.raises(SceneError, match=r"walls\.temperature_K: 9000 is outside"):
        run_sweep(scene, Grid.parse("walls.temperature_K=300,9000"), tmp_path / "a")
    assert not (tmp_path / "a").exists()
    with pytest.raises(StudyError, match="no dask scheduler answers"):
        run_sweep(
            scene, Grid.parse("walls.temperature_K=300"), tmp_path / "b", scheduler="no://where"
        )
    with pytest.raises(ValueError, match="No clients found"):  # arrays are not computed there
        pytest.importorskip("distributed").default_client()
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "thesis.tex").write_text("precious")
    with pytest.raises(StudyError, match="not empty"):
        run_sweep(scene, Grid.parse("walls.temperature_K=300"), tmp_path / "c")
    with pytest.raises(StudyError, match="has no sweep"):
        cldit.open_study(tmp_path / "c")


@pytest.mark.parametrize("left", ["points", "study.json", "half a store"])
def test_a_sweep_killed_in_its_first_seconds_goes_on(
    scene: Scene, tmp_path: Path, left: str
) -> None:
    """A sweep killed at any moment is completed; the folder then has an empty store."""
    pytest.importorskip("dask.array", reason="the extra studies is not installed")
    out, grid = tmp_path / "a", Grid.parse("walls.temperature_K=300,320")
    if left == "points":  # as version 0.2.0 began
        (out / "points").mkdir(parents=True)
    else:
        open_folder(out, scene, grid)
        if left == "study.json":
            shutil.rmtree(out / "study.zarr")
            shutil.rmtree(out / "points")
        else:
            (out / "study.zarr" / ".zmetadata").unlink()
    open_folder(out, scene, grid)
    assert done(out) == set()
    study = cldit.open_study(out)
    assert study.sizes["walls.temperature_K"] == 2 and bool(np.isnan(study.emissivity).all())


@pytest.mark.slow
def test_injections_side_by_side(scene: Scene, cluster: Any, tmp_path: Path) -> None:
    """Traced by two workers, an ensemble is the one that is traced in sequence; a second call
    traces what is missing alone."""
    keys = {"spray.scatter.members": 4, "spray.scatter.mass": 0.1}
    several = scene.with_(**keys)
    seen: list[Progress] = []
    out = tmp_path / "out"
    count = trace_members(
        several, out, scheduler=cluster.scheduler_address, cache=tmp_path, watch=seen.append
    )
    assert count == 4 and (seen[-1].done, seen[-1].total) == (4, 4)
    (out / "members" / "0002" / "run.json").unlink()
    again = trace_members(several, out, scheduler=cluster.scheduler_address, cache=tmp_path)
    assert again == 1
    run = cldit.simulate(several, out, cache=tmp_path)
    alone = cldit.simulate(several, tmp_path / "alone", cache=tmp_path)
    assert run.ensemble is not None and alone.ensemble is not None
    for name, image in alone.ensemble.maps.items():
        assert run.ensemble[name] == pytest.approx(image, nan_ok=True, abs=1e-2, rel=1e-3)
    assert trace_members(several, out, cache=tmp_path) == 0


@pytest.mark.slow
def test_times_side_by_side(scene: Scene, cluster: Any, tmp_path: Path) -> None:
    """Times that workers have traced are those of a series in sequence, and not traced again."""
    out, counts, traced = tmp_path / "out", [], {}

    def ahead(scenes: Mapping[Path, Scene]) -> None:
        counts.append(trace_scenes(scenes, scheduler=cluster.scheduler_address, cache=tmp_path))
        traced.update({place: (place / "run.json").stat().st_mtime_ns for place in scenes})

    times = "0.3ms,0.5ms,0.7ms"
    series = run_series(scene, out, times=times, trace_only=True, ahead=ahead)
    alone = run_series(scene, tmp_path / "alone", times=times, trace_only=True)
    assert counts == [3]
    for aside, other in zip(series.times, alone.times, strict=True):
        assert aside.state == "done" and aside.folder is not None
        assert (aside.folder / "run.json").stat().st_mtime_ns == traced[aside.folder]
        assert aside.dit == other.dit and aside.spray == other.spray


# Slurm reads a job's script while sbatch runs; its caller removes the file right after.
SBATCH = """#!/bin/sh
cp "$1" "$0.$$"
nohup sh "$0.$$" > "$0.$$.log" 2>&1 &
echo "Submitted batch job $!"
"""


@pytest.mark.slow
def test_slurm_as_documented(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's script, with an `sbatch` that runs the job on this machine."""
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is missing")
    if " " in sys.executable:
        pytest.skip("dask-jobqueue does not quote the path of Python, which has a space here")
    page = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(from dask_jobqueue.*?)```", page, re.DOTALL)
    for name, text in (("sbatch", SBATCH), ("scancel", '#!/bin/sh\nkill "$1"\n')):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    names: dict[str, Any] = {}
    with socket.socket() as other:
        with contextlib.suppress(OSError):  # taken already, which serves as well
            other.bind(("", 8787))  # dask's usual port: another user of the node has it
            other.listen()
        exec(script, names)
    with names["cluster"] as started:
        grid = Grid.parse("walls.temperature_K=300,450")
        address = started.scheduler_address
        record = run_sweep(scene, grid, tmp_path / "sweep", scheduler=address, cache=tmp_path)
    assert record.scenes == 2 and not record.failed


def test_a_sweep_says_that_it_waits_for_workers(capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed", reason="distributed is missing")
    quiet = {"dashboard": False, "dashboard_address": "localhost:0"}
    with (
        distributed.LocalCluster(n_workers=0, processes=False, scheduler_kwargs=quiet) as cluster,
        client_of(cluster.scheduler_address, 1, None),
    ):
        assert "it has no worker yet" in capsys.readouterr().err.replace("\n", " ")


def test_workers_of_a_machine_have_ranks(tmp_path: Path) -> None:
    """Each process its own, whatever started it; that of an ended one is free again."""
    code = (
        "import sys; from cldit.study.sweep import worker_rank; "
        "print(worker_rank(['0:0']), flush=True); sys.stdin.read()"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}

    def start() -> tuple[subprocess.Popen[str], str]:
        worker = subprocess.Popen([sys.executable, "-c", code], env=environment, text=True,
                                  stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip
        assert worker.stdout is not None
        return worker, worker.stdout.readline().strip()

    workers = [start() for _ in range(2)]
    assert [rank for _, rank in workers] == ["0", "1"]
    workers[0][0].kill()
    workers[0][0].communicate()
    workers.append(start())
    assert workers[-1][1] == "0"
    for worker, _ in workers:
        worker.kill()
        worker.communicate()
