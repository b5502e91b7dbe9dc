"""Acquisition folders as the evaluation meets them: half done, damaged, foreign."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.api.folder_evaluation import evaluate_folder
from cldit.camera.calibration import Calibration
from cldit.errors import RunFolderError
from cldit.io.images import read_image, write_image
from cldit.rig.load import open_rig


def test_each_frame_of_a_shot_can_be_evaluated(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """Three frames of each shot: any of them gives maps of its own; a fourth there is not."""
    plan = tiny_plan.model_copy(update={"frames": 3, "expect_fuel": True})
    acquire(open_rig(tiny_rig), plan, tmp_path / "a")
    with tifffile.TiffFile(tmp_path / "a" / "shots" / "b00_inj_00.tif") as tiff:
        assert tiff.is_imagej and len(tiff.pages) == 3 and tiff.series[0].axes == "TYX"
    maps = [evaluate_folder(tmp_path / "a", frame=frame).maps for frame in (0, 2)]
    first, last = (found.emissivity for found in maps)
    assert not np.array_equal(first, last, equal_nan=True)
    assert abs(float(np.nanmax(first)) - float(np.nanmax(last))) < 0.1
    with pytest.raises(RunFolderError, match=r"frame 3: allowed: 0\.\.2"):
        evaluate_folder(tmp_path / "a", frame=3)


def test_what_is_stored(folder: Path, tiny_plan: Plan) -> None:
    acquisition = open_acquisition(folder)
    assert acquisition.plan == tiny_plan
    calibration = Calibration.from_dict(acquisition.calibration)
    assert calibration.saturation_counts == 2**14 - 1
    shot = acquisition.shots[0]
    image, meta = read_image(shot.path)
    assert image.dtype == np.uint16 and image.shape == acquisition.shape == (12, 16)
    assert meta["integration_time_s"] == tiny_plan.integration_time_s
    assert meta["background_setpoint_K"] == 440.0 and meta["saturation_counts"] == 2**14 - 1
    # 2 of 192 pixels are stuck, at zero or at full scale.
    assert shot.saturated_percent == 100.0 * np.count_nonzero(image == 2**14 - 1) / image.size
    assert sorted(path.name for path in folder.iterdir() if path.name != ".lock") == [
        "configuration.json",
        "journal.jsonl",
        "plan.yaml",
        "rig.yaml",
        "shots",
    ]
    assert open_rig(folder / "rig.yaml").file.name == "simulated rig before tiny"


def test_whole_picture_without_journal_line_is_adopted(
    folder: Path, tiny_rig: dict[str, Any], tiny_plan: Plan
) -> None:
    """As left by a kill between rename and journal."""
    journal = folder / "journal.jsonl"
    lines = journal.read_text().splitlines()
    last = max(n for n, line in enumerate(lines) if '"saved"' in line)
    journal.write_text("\n".join(lines[:last]) + "\n")
    assert open_acquisition(folder).complete
    record = acquire(open_rig(tiny_rig), tiny_plan, folder)
    assert record.complete and record.lost_injections == 0
    entry = json.loads(journal.read_text().splitlines()[-1])
    assert (entry["event"], entry["shot"], entry["adopted"]) == ("saved", "b01_inj_02", True)


def test_half_written_picture_is_nothing(
    folder: Path, tiny_rig: dict[str, Any], tiny_plan: Plan
) -> None:
    path = folder / "shots" / "b00_inj_01.tif"
    path.rename(path.with_name(path.name + ".part"))
    assert open_acquisition(folder).missing == ("b00_inj_01",)
    acquire(open_rig(tiny_rig), tiny_plan, folder)
    assert not list((folder / "shots").glob("*.part"))


def _pixels(folder: Path) -> None:
    path = folder / "shots" / "b00_ref_00.tif"
    image, meta = read_image(path)
    image = image.copy()
    image[3, 3] += 1
    meta = {k: v for k, v in meta.items() if k not in ("name", "unit", "pixel_m")}
    write_image(path, image, name="b00_ref_00", unit="counts", meta=meta)


def _swap(folder: Path) -> None:
    shots = folder / "shots"
    (shots / "b00_ref_00.tif").write_bytes((shots / "b00_ref_01.tif").read_bytes())


def _float(folder: Path) -> None:
    path = folder / "shots" / "b00_ref_00.tif"
    write_image(path, np.zeros((12, 16), np.float32), name="x", unit="K")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_pixels, "pixels are not those that were recorded"),
        (_swap, "is no shot b00_ref_00 of this plan"),
        (_float, "is no raw image"),
        (lambda f: (f / "shots" / "b00_ref_00.tif").write_bytes(b"II*\0"), "cannot be read"),
        (lambda f: (f / "shots" / "b00_ref_00.tif").write_bytes(b""), "cannot be read as TIFF"),
    ],
)
def test_damaged_picture(folder: Path, damage: Callable[[Path], Any], message: str) -> None:
    damage(folder)
    acquisition = open_acquisition(folder)
    with pytest.raises(RunFolderError, match=message):
        acquisition.load(acquisition.shots[0])


def _configuration(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    path = folder / "configuration.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: (f / "plan.yaml").unlink(), "holds no plan.yaml"),
        (lambda f: (f / "configuration.json").unlink(), "configuration.json: cannot be read"),
        (lambda f: (f / "configuration.json").write_text("[]"), "contains list"),
        (lambda f: (f / "configuration.json").write_text("{"), "is damaged"),
        (lambda f: _configuration(f, lambda d: d.pop("plan_hash")), "belongs to another plan"),
        (lambda f: _configuration(f, lambda d: d.pop("setup")), "damaged .'setup'"),
        (lambda f: _configuration(f, lambda d: d["setup"].pop("pixel_m")), "pixel_m: is missing"),
        (lambda f: _configuration(f, lambda d: d["devices"].pop("camera")), "damaged .'camera'"),
        (lambda f: _configuration(f, lambda d: d.update(shape=[12])), "damaged"),
        (lambda f: (f / "shots" / "holiday.tif").write_bytes(b""), "holiday.tif: is no shot"),
    ],
)
def test_damaged_folder(folder: Path, damage: Callable[[Path], Any], message: str) -> None:
    damage(folder)
    with pytest.raises(RunFolderError, match=message):
        open_acquisition(folder)


def test_folder_of_something_else(
    tmp_path: Path, tiny_rig: dict[str, Any], tiny_plan: Plan
) -> None:
    with pytest.raises(RunFolderError, match=r"holds no plan\.yaml"):
        open_acquisition(tmp_path / "nowhere")
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / "old.tif").write_bytes(b"")
    with pytest.raises(RunFolderError, match=r"holds images but no plan\.yaml"):
        acquire(open_rig(tiny_rig), tiny_plan, tmp_path)
