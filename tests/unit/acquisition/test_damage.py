"""Damaged acquisitions: what is whole is evaluated, the rest is named, and nothing is fired on."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.api.folder_evaluation import evaluate_folder
from cldit.errors import ClditError, EvaluationError, RunFolderError
from cldit.rig.load import open_rig
from tests.bit_flips import flipped_bits
from tests.wrapped import pulses

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
    (lambda e: e.update(attempt=True), "holds attempt: True"),
    (lambda e: e.update(background_before_K=None), "holds background_before_K: None"),
    (lambda e: e.pop("background_after_K"), "has no background_after_K"),
    (lambda e: e.pop("shot"), "has no shot"),
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
