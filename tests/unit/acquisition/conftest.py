"""A complete acquisition, recorded once, of which each test has a copy."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from cldit.acquisition import acquire, plan_from_scene
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene


@pytest.fixture(scope="session")
def tiny_acquisition(
    tiny_scene: Scene, tiny_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Every shot of `tiny_plan`."""
    folder = tmp_path_factory.mktemp("acquisitions") / "a"
    plan = plan_from_scene(tiny_scene).model_copy(update={"interleave": False})
    acquire(open_rig(simulated_rig_data(tiny_scene, tiny_run)), plan, folder)
    return folder


@pytest.fixture
def folder(tiny_acquisition: Path, tmp_path: Path) -> Path:
    """A copy, which a test may damage and resume with `tiny_rig` and `tiny_plan`."""
    return Path(shutil.copytree(tiny_acquisition, tmp_path / "a"))
