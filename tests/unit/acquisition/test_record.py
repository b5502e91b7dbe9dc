"""Acquisition folders as the evaluation meets them: times of shots, half done, damaged, foreign."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.acquisition.journal import Entry, shot_times
from cldit.acquisition.plan import Group
from cldit.api.folder_evaluation import evaluate_folder
from cldit.camera.calibration import Calibration
from cldit.dit.drift_axis import drift_axis
from cldit.errors import ClditError, EvaluationError, RunFolderError
from cldit.io.images import read_image, write_image
from cldit.rig.load import open_rig
from tests.bit_flips import flipped_bits
from tests.wrapped import pulses


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


def test_a_retake_without_journal_line_is_adopted(
    folder: Path, tiny_rig: dict[str, Any], tiny_plan: Plan
) -> None:
    """An image is removed and taken again, and a kill comes between it and the journal: it is not
    compared with the digest of the removed one."""
    (folder / "shots" / "b00_inj_01.tif").unlink()
    assert acquire(open_rig(tiny_rig), tiny_plan, folder).complete
    journal = folder / "journal.jsonl"
    lines = journal.read_text().splitlines()
    last = max(n for n, line in enumerate(lines) if '"saved"' in line)
    journal.write_text("\n".join(lines[:last]) + "\n")
    opened = open_acquisition(folder)
    assert opened.complete and opened.whole().damage == ()
    assert acquire(open_rig(tiny_rig), tiny_plan, folder).lost_injections == 0


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
        (lambda f: _configuration(f, lambda d: d.pop("plan_hash")), "belongs to another plan"),
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


def test_times_of_a_journal_and_waits_for_the_black_body(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """From the hottest background down, as a rig goes that is hot: the shots of the first
    background of the plan are the last."""
    temperatures = tuple(sorted(tiny_plan.backgrounds_K, reverse=True))
    plan = tiny_plan.model_copy(update={"backgrounds_K": temperatures})
    acquire(open_rig(tiny_rig), plan, tmp_path / "a")
    shots = open_acquisition(tmp_path / "a").shots
    first, last = (
        [shot.time_s for shot in shots if shot.background == number]
        for number in (0, len(temperatures) - 1)
    )
    assert min(one or 0.0 for one in first) > max(one or 0.0 for one in last)
    assert all((shot.stable_s or 0.0) < (shot.time_s or 0.0) for shot in shots)
    axis = drift_axis(shots)
    at = [place.at for place in axis.places]
    assert not axis.breaks_s and at[0] > at[-1]
    assert np.ptp(at) > 2 * len(shots)  # waits for the black body are most of the time
    found = evaluate_folder(tmp_path / "a")
    assert found.drift_axis.startswith("drift fitted against time; ")
    assert found.drift_axis in found.lines
    assert found.to_dict()["drift_axis"] == found.drift_axis


def test_each_delay_has_its_own_times(
    rig_of_three: dict[str, Any], plan_of_three: Plan, tmp_path: Path
) -> None:
    """The black body was stable before the first delay, and drifts for longer before the last."""
    acquire(open_rig(rig_of_three), plan_of_three, tmp_path / "a")
    opened = open_acquisition(tmp_path / "a")
    since = []
    for delay in range(3):
        shots = opened.of_group(Group(delay=delay)).shots
        axis = drift_axis(shots)
        assert "drift fitted against time" in axis.text
        here = [
            place for shot, place in zip(shots, axis.places, strict=True) if not shot.background
        ]
        since.append(here[0].since)
        assert np.all(np.diff([place.at for place in here]) > 0.0)
    assert 0.0 < since[0] < since[1] < since[2]


def _entry(event: str, minute: int, shot: str = "") -> Entry:
    return {"event": event, "time": f"2026-01-01T00:{minute:02d}:00+00:00", "shot": shot}


def test_a_clock_that_was_set_back_gives_no_times() -> None:
    entries = [_entry("stable", 1), _entry("saved", 2, "a"), _entry("saved", 4, "b")]
    times = shot_times(entries)
    assert list(times) == ["a", "b"]
    assert times["b"][0] - times["a"][0] == 120.0
    assert times["a"][0] - (times["a"][1] or 0.0) == 60.0
    assert shot_times([*entries, _entry("saved", 3, "c")]) == {}
    assert shot_times([_entry("saved", 2, "a")])["a"][1] is None


LINES = 12  # of the journal, from where on it is spoiled: five images are saved by then


def spoil(folder: Path, change: Callable[[dict[str, Any]], Any] | bytes) -> None:
    """Changes the first `saved` entry after LINES, or puts bytes in the place of that line."""
    path = folder / "journal.jsonl"
    lines = path.read_bytes().splitlines()
    at = next(n for n, line in enumerate(lines) if n > LINES and b'"saved"' in line)
    if isinstance(change, bytes):
        lines[at] = change
    else:
        entry = json.loads(lines[at])
        change(entry)
        lines[at] = json.dumps(entry).encode()
    path.write_bytes(b"\n".join([*lines, b""]))


DAMAGES: list[tuple[Any, str]] = [
    (lambda e: e.update(attempt="x"), "holds attempt: 'x', which is of another type"),
    (lambda e: e.update(background_before_K=None), "holds background_before_K: None"),
    (lambda e: e.pop("background_after_K"), "has no background_after_K"),
    (lambda e: e.update(shot=3), "holds shot: 3"),
    (lambda e: e.update(seq=99), "does not carry the sequence number"),
    (bytes(40), "is not JSON"),
    (b'{"seq": 1, "seq": 1}', "duplicate key 'seq'"),
    (b"[" * 100_000, "is not JSON"),
]


def test_a_damaged_journal(folder: Path, tiny_rig: dict[str, Any], tiny_plan: Plan) -> None:
    """Images carry their own data and checksum, so all are evaluated; an acquisition refuses."""
    journal, whole = folder / "journal.jsonl", evaluate_folder(folder).maps
    sound, fired = journal.read_bytes(), len(pulses(tiny_rig))
    for change, message in DAMAGES:
        journal.write_bytes(sound)
        spoil(folder, change)
        opened = open_acquisition(folder)
        assert len(opened.shots) == len(tiny_plan.steps())
        assert message in opened.damage[0] and "journal.jsonl: line" in opened.damage[0]
        with pytest.raises(RunFolderError, match=r"journal\.jsonl: line \d+ "):
            acquire(open_rig(tiny_rig), tiny_plan, folder)
        assert len(pulses(tiny_rig)) == fired
    evaluation = evaluate_folder(folder)
    assert np.array_equal(evaluation.maps.emissivity, whole.emissivity, equal_nan=True)
    assert message in evaluation.remarks[0]


def test_damaged_and_missing_pictures_are_left_out(folder: Path) -> None:
    shots = folder / "shots"
    data = (shots / "b00_inj_01.tif").read_bytes()
    (shots / "b00_inj_01.tif").write_bytes(data[: len(data) // 2])
    (shots / "b01_ref_00.tif").unlink()
    found = evaluate_folder(folder)
    assert np.isfinite(found.maps.emissivity).sum() > 10
    remarks = "\n".join(found.remarks)
    assert "b00_inj_01.tif: " in remarks and "1 shots of the plan are missing" in remarks
    assert "b01_ref_00.tif: the journal has it, but the file is missing" in remarks
    assert len(open_acquisition(folder).whole().shots) == 8


def test_too_few_are_left(folder: Path) -> None:
    for path in (folder / "shots").glob("b01_inj_*.tif"):
        path.write_bytes(b"")
    with pytest.raises(EvaluationError, match=r"(?s)b01_inj_00\.tif: .*cannot be read.*480"):
        evaluate_folder(folder)


@pytest.mark.parametrize("mutations", [40, pytest.param(400, marks=pytest.mark.long)])
def test_no_mutation_of_several_bits_is_silent(folder: Path, mutations: int) -> None:
    """Up to five bits of up to two files: an error, a line, or the same maps."""

    def read() -> tuple[Any, ...]:
        found = open_acquisition(folder)
        shots = tuple(replace(shot, time_s=None, stable_s=None) for shot in found.shots)
        images = b"".join(found.load(shot).tobytes() for shot in found.shots)
        return shots, images, found.surroundings, found.calibration, found.pixel_m, found.centre_m

    before = read()
    files = sorted(file for file in folder.rglob("*") if file.is_file() and file.name != "lock")
    rng = np.random.default_rng(3)
    silent = []
    for number in range(mutations):
        with flipped_bits(files, rng) as chosen, suppress(ClditError):
            if open_acquisition(folder).damage == () and read() != before:
                silent.append((number, [file.name for file in chosen]))
    assert silent == [] and read() == before
