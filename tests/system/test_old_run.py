"""A run's folder that version 0.1.0 wrote is read, evaluated and acquired again."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.io.images import read_image
from tests.command_line import command

WRITTEN = Path(__file__).parents[1] / "data" / "run-0.1.0"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy, in which paths are those of this machine."""
    copy = tmp_path / "run"
    shutil.copytree(WRITTEN, copy)
    for rig in (copy / "rig.yaml", copy / "acquisition" / "rig.yaml"):
        text = rig.read_text(encoding="utf-8")
        rig.write_text(text.replace("FOLDER", str(copy)).replace("PARENT", str(tmp_path)), "utf-8")
    return copy


def test_the_run_is_read(folder: Path) -> None:
    """Weights sum to 1 with the emission of their medium; the balance of light is there."""
    run = cldit.open_run(folder)
    assert run.weights.background.shape == (10, 12)
    assert run.info.closure is not None and abs(run.info.closure.largest) < 1e-3
    saved = read_image(folder / "maps" / "emissivity.tif")[0]
    np.testing.assert_allclose(run.maps.emissivity, saved)
    emissivity = 1.0 - run.weights.background
    seen = np.isfinite(run.maps.emissivity)
    np.testing.assert_allclose(run.maps.emissivity[seen], emissivity[seen], atol=1e-4)


@pytest.mark.usefixtures("without_pages")
def test_the_acquisition_is_evaluated(folder: Path) -> None:
    """As 0.1.0 did, to a quarter of the stated error; errors are other estimates of the shots'
    scatter, so that a pixel near three errors of its emissivity may have a temperature or not."""
    maps = folder / "acquisition" / "maps"
    before = read_image(maps / "apparent_temperature_K.tif")[0]
    shutil.rmtree(maps)
    command("evaluate", folder)
    names = ("apparent_temperature", "apparent_temperature_standard_error")
    after, error = (read_image(maps / f"{name}_K.tif")[0] for name in names)
    names = ("emissivity", "emissivity_standard_error")
    emissivity, its_error = (read_image(maps / f"{name}.tif")[0] for name in names)
    near = np.abs(emissivity / its_error - 3.0) < 1.5
    assert np.all((np.isfinite(after) == np.isfinite(before)) | near)
    known = np.isfinite(after) & np.isfinite(before)
    assert known.sum() > 15
    assert np.all(np.abs(after - before)[known] < 0.25 * error[known])


def test_the_rig_is_driven(folder: Path, tmp_path: Path) -> None:
    """Its driver `simulated_bench` is called `simulated_scene` now."""
    command("acquire", folder / "rig.yaml", folder / "plan.yaml", "--out", tmp_path / "again")
    assert len(list((tmp_path / "again" / "shots").glob("*.tif"))) == 12
