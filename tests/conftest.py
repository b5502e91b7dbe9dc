"""What many tests share: one OpenCL device, and a traced run small enough for the rig's tests."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock

from cldit.acquisition import Plan, plan_from_scene
from cldit.gpu.device import Device, open_device
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.radiance.weights import Weights
from cldit.rig import locks
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene, dump_scene, parse_scene
from cldit.scene.delays import delay_folder
from cldit.scene.spray import ConeSpray
from tests.wrapped import Mission

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(autouse=True)
def one_camera_at_a_time(request: pytest.FixtureRequest) -> Iterator[None]:
    """Clients of GigE Vision search at 127.0.0.1, where the newest camera of all processes is
    found: tests with one wait for each other."""
    with ExitStack() as stack:
        if request.node.get_closest_marker("gige"):
            stack.enter_context(FileLock(Path(tempfile.gettempdir(), "cldit-tests-gige.lock")))
        yield


@pytest.fixture
def without_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """`cldit evaluate` draws no page, of which four figures take a second: others test it."""
    monkeypatch.setattr("cldit.cli.evaluate.write_pages", lambda folder: ())


@pytest.fixture(autouse=True, scope="module")
def instruments_are_freed() -> Iterator[None]:
    """A test that leaves an instrument locked would keep another process from a reused address."""
    yield
    assert not locks._HELD, f"not closed: {', '.join(locks._HELD)}"


@pytest.fixture(scope="session")
def device() -> Device:
    """The one that CLDIT_TEST_DEVICE names, or the one that cldit chooses."""
    return open_device(os.environ.get("CLDIT_TEST_DEVICE"))


@pytest.fixture(scope="session")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of tables and computed sprays: what one test has made, none makes again.

    All workers of a session share it (what is kept there appears whole or not at all), and no two
    sessions. A test of what is kept, and when, has a folder of its own.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    folder = folder / "tables"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def tiny_scene() -> Scene:
    """16 x 12 pixels on the sensor, two backgrounds, a hot wall so that every pixel sees light."""
    return parse_scene(
        {
            "name": "tiny",
            "spray": {
                "model": "none",
                "scatter": {"optical_depth": 0.05, "length_m": 0.02},
            },
            "camera": {
                "pixels": [32, 24],
                "field_m": [0.16, 0.12],
                "sensor": {"pixels": [16, 12], "bad_pixels": 2},
            },
            "background": {"temperatures_K": [440.0, 480.0], "radius_m": 0.05},
            "walls": {"temperature_K": 420.0},
            "plan": {"shots": 3, "references": 2},
        }
    )


def tiny_weights(scene: Scene, *, depth: float) -> Weights:
    """An absorbing blob at 370 K of this optical depth before a disc."""
    columns, rows = scene.camera.pixels
    width, height = scene.camera.field_m
    x = (np.arange(columns) + 0.5) / columns * width - width / 2
    z = (np.arange(rows) + 0.5) / rows * height - height / 2
    r2 = x[None, :] ** 2 + z[:, None] ** 2
    disc = (r2 < scene.background.radius_m**2).astype(np.float64)
    through = np.exp(-depth * np.exp(-r2 / 0.03**2))
    glow = (1.0 - through) * float(band_radiance(370.0, filter_um=scene_filter(scene)))
    images = (through * disc, through * (1.0 - disc), 0.25 * glow, 0.75 * glow)
    return Weights(*(image.astype(np.float32) for image in images))


@pytest.fixture(scope="session")
def tiny_run(tiny_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder as a trace leaves it."""
    folder = tmp_path_factory.mktemp("a traced run")
    (folder / "scene.yaml").write_text(dump_scene(tiny_scene), encoding="utf-8")
    for name, depth in (("weights", 2.0), ("weights_reference", 0.0)):
        tiny_weights(tiny_scene, depth=depth).save(folder / name, pixel_m=(5e-3, 5e-3))
    return folder


@pytest.fixture
def tiny_rig(tiny_scene: Scene, tiny_run: Path, tmp_path: Path) -> dict[str, Any]:
    """The rig file before that run; the injector counts into pulses.jsonl."""
    data = simulated_rig_data(tiny_scene, tiny_run)
    data["trigger"]["settings"]["pulse_log"] = str(tmp_path / "pulses.jsonl")
    return data


@pytest.fixture(scope="session")
def tiny_runs(tiny_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """Three runs of one spray, thicker the later it is: at 0.5, 0.95 and 1.5 ms."""
    folder = tmp_path_factory.mktemp("runs of three times")
    for time_s, depth in ((0.5e-3, 0.5), (0.95e-3, 1.0), (1.5e-3, 2.0)):
        run = folder / delay_folder(time_s)
        spray = ConeSpray(time_s=time_s)
        run.mkdir()
        text = dump_scene(tiny_scene.model_copy(update={"spray": spray}))
        (run / "scene.yaml").write_text(text, encoding="utf-8")
        for name, part in (("weights", depth), ("weights_reference", 0.0)):
            tiny_weights(tiny_scene, depth=part).save(run / name, pixel_m=(5e-3, 5e-3))
    return tuple(sorted(folder.iterdir()))


@pytest.fixture
def rig_of_three(tiny_scene: Scene, tiny_runs: tuple[Path, ...], tmp_path: Path) -> dict[str, Any]:
    """The rig file before those runs; the injector counts into pulses.jsonl."""
    data = simulated_rig_data(tiny_scene, tiny_runs[0], further_runs=tiny_runs[1:])
    data["trigger"]["settings"]["pulse_log"] = str(tmp_path / "pulses.jsonl")
    return data


@pytest.fixture
def plan_of_three(tiny_scene: Scene) -> Plan:
    """Three backgrounds and three delays."""
    return plan_from_scene(tiny_scene).model_copy(
        update={"backgrounds_K": (440.0, 460.0, 480.0), "delays_s": (0.5e-3, 0.95e-3, 1.5e-3)}
    )


@pytest.fixture
def tiny_plan(tiny_scene: Scene) -> Plan:
    """References first, so that tests of faults know which shot is the nth."""
    return plan_from_scene(tiny_scene).model_copy(update={"interleave": False})


@pytest.fixture
def mission(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> Mission:
    """The rig, the plan, and a folder for the acquisition."""
    return Mission(tiny_rig, tiny_plan, tmp_path / "a")
