"""Exports, read back with programs that are not ours: h5py, nexusformat."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition import Acquisition, Plan, acquire, open_acquisition
from cldit.acquisition.export import ExportError, export
from cldit.acquisition.frames import open_stack
from cldit.acquisition.pictures.source import Source
from cldit.cli import main
from cldit.errors import DiskFull, EvaluationError, RunFolderError
from cldit.rig.load import open_rig
from tests.full_disk import full_disk


@pytest.fixture(params=[1, 3], ids=["one frame", "three frames"])
def recorded(
    request: pytest.FixtureRequest, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> Acquisition:
    plan = tiny_plan.model_copy(update={"frames": request.param})
    acquire(open_rig(tiny_rig), plan, tmp_path / "a run")
    return open_acquisition(tmp_path / "a run")


def test_nexus(recorded: Acquisition) -> None:
    """nexusformat finds the default plot with its axes and units; h5py the pixels."""
    nexusformat = pytest.importorskip("nexusformat.nexus", reason="nexusformat is missing")
    h5py = pytest.importorskip("h5py", reason="h5py is missing")
    path = export(recorded, "nexus")
    stack = np.concatenate([recorded.load_frames(shot)[0] for shot in recorded.shots])
    with h5py.File(path, "r") as file:
        data = file["entry/data/data"]
        assert np.array_equal(data[:], stack)
        assert data.attrs["units"] == "counts"
        key = file["entry/instrument/detector/image_key"][:]
        injections = file["entry/instrument/black_body/setpoint"][:][key == 0]
        assert set(injections) == {440.0, 480.0}
        plan = json.loads(file["entry/plan/data"][()])
        assert plan["backgrounds_K"] == [440.0, 480.0]
    root = nexusformat.nxload(str(path))
    plot = root.get_default()
    assert plot.nxsignal.shape == stack.shape
    assert [axis.nxname for axis in plot.nxaxes] == ["picture", "z", "x"]
    assert plot["x"].attrs["units"] == "m" and plot["z"].nxdata[0] > plot["z"].nxdata[-1]
    assert np.diff(plot["x"].nxdata) == pytest.approx(np.full(15, 0.01))
    assert root.entry.instrument.detector.count_time.attrs["units"] == "s"


def test_export_says_what_is_wrong(
    folder: Path, tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """A damaged image leaves no file; and what is missing is said."""
    acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "none", should_stop=lambda: True)
    with pytest.raises(ExportError, match="no images yet"):
        export(open_acquisition(tmp_path / "none"), "nexus")
    with pytest.raises(ExportError, match="allowed: nexus"):
        export(open_acquisition(tmp_path / "none"), "png")
    acquisition = open_acquisition(folder)
    for shot in acquisition.shots[-1:]:
        data = bytearray(shot.path.read_bytes())
        data[-20] ^= 1
        shot.path.write_bytes(data)
    with pytest.raises(RunFolderError, match="not those that were recorded"):
        export(acquisition, "nexus", tmp_path / "out")
    assert not list(tmp_path.glob("out*"))
    acquisition.shots[-1].path.unlink()
    arguments = ["export", str(folder), "--to", "nexus", "--out", str(tmp_path / "x")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0 and "1 shots are still missing" in result.output
    assert (tmp_path / "x").is_file()


def film(path: Path, **changes: Any) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """Five frames of a Telops camera, by fasthcc's writer."""
    fasthcc = pytest.importorskip("fasthcc", reason="fasthcc is missing")
    frames = np.random.default_rng(1).integers(0, 2**14, (5, 12, 64), dtype=np.uint16)
    headers = [
        {"FrameID": 100 + n, "POSIXTime": 1_700_000_000, "SubSecondTime": 10_000 * n}
        for n in range(5)
    ]
    options = {"calibration_mode": 0, "exposure_time": 25.0, "frame_rate": 1000.0, **changes}
    fasthcc.write_hcc(path, frames, metadata=options.pop("metadata", headers), **options)
    return frames


def test_hcc(tmp_path: Path) -> None:
    frames = film(tmp_path / "a.hcc")
    found = open_stack(Source(tmp_path / "a.hcc"))
    read = np.stack([found.read(number) for number in range(len(found))])
    assert np.array_equal(read, frames) and read.dtype == np.uint16
    told = found.metadata
    assert [one.integration_time_s for one in told] == pytest.approx([25e-6] * 5)
    assert [one.time_s for one in told] == pytest.approx(
        [1_700_000_000 + 1e-3 * n for n in range(5)], abs=1e-6
    )
    found.close()


def test_hcc_that_is_no_use(tmp_path: Path) -> None:
    film(tmp_path / "kelvin.hcc", calibration_mode=2)
    with pytest.raises(EvaluationError, match="calibration mode 2"):
        open_stack(Source(tmp_path / "kelvin.hcc"))
    film(tmp_path / "gap.hcc", metadata=[{"FrameID": n} for n in (1, 2, 4, 5, 6)])
    with pytest.raises(EvaluationError, match="frame 3 is missing"):
        open_stack(Source(tmp_path / "gap.hcc"))
    film(tmp_path / "cut.hcc")
    (tmp_path / "cut.hcc").write_bytes((tmp_path / "cut.hcc").read_bytes()[:-100])
    with pytest.raises(EvaluationError, match="cannot be read"):
        open_stack(Source(tmp_path / "cut.hcc"))
    (tmp_path / "text.hcc").write_text("no film" * 100)
    for name in ("text.hcc", "missing.hcc"):
        with pytest.raises(EvaluationError, match=name):
            open_stack(Source(tmp_path / name))


def test_full_disk(recorded: Acquisition, tmp_path: Path) -> None:
    """HDF5 that cannot write its last bytes would end the process; nothing is left of the file."""
    target = tmp_path / "out" / "run"
    for most_bytes in (0, 100, 3000, 5000):
        with full_disk(most_bytes=most_bytes), pytest.raises(DiskFull, match="run: the disk is"):
            export(recorded, "nexus", target)
        assert list(target.parent.iterdir()) == []
    assert export(recorded, "nexus", target) == target
