"""Rig files: what is refused, with which words, and what the rig does with broken devices."""

from __future__ import annotations

import copy
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from cldit.errors import SceneError
from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.drivers import installed_drivers
from cldit.rig.errors import NotConnected, RigError
from cldit.rig.load import open_rig


def test_shipped_drivers() -> None:
    names = {"simulated_scene", "simulated_camera", "simulated_blackbody", "simulated_injector"}
    assert names <= set(installed_drivers())


def test_from_a_file_with_relative_paths(
    tiny_rig: dict[str, Any], tiny_run: Path, tmp_path: Path
) -> None:
    (tmp_path / "here").symlink_to(tiny_run)
    tiny_rig["bench"]["settings"]["run"] = "here"
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(tiny_rig))
    with open_rig(tmp_path / "rig.yaml") as rig:
        rig.connect()
        assert rig.camera.capabilities.sensor_pixels == (16, 12)
        assert isinstance(rig.clock, SimulatedClock)


def test_clock(tiny_rig: dict[str, Any]) -> None:
    own_clock = SimulatedClock()
    assert open_rig(tiny_rig, clock=own_clock).clock is own_clock
    tiny_rig["clock"] = {"model": "system"}
    assert type(open_rig(tiny_rig).clock) is Clock


def _set(*path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("camera"), "camera: is missing"),
        (lambda d: d.pop("bench"), "camera.settings.bench: is missing; simulated devices need"),
        (
            _set("cammera", value={}),
            "cammera: unknown key; did you mean camera?",
        ),
        (_set("camera", "driver", value="simulated_camra"), "did you mean simulated_camera?"),
        (_set("trigger", "driver", value="zzz"), "trigger.driver: 'zzz' is not installed"),
        (
            _set("background", "settings", "time_constant_s", value=-1),
            "background.settings.time_constant_s: -1 is outside 0..100000",
        ),
        (_set("camera", "settings", "gain", value=2), "camera.settings.gain: unknown key"),
        (_set("bench", "settings", value={}), "bench.settings.run: is missing"),
        (_set("setup", "pixel_m", value=[0.0, 1e-3]), "setup.pixel_m: 0 is outside"),
        (_set("clock", "model", value="sundial"), "clock.model: 'sundial'"),
    ],
)
def test_refused(
    change: Callable[[dict[str, Any]], None], message: str, tiny_rig: dict[str, Any]
) -> None:
    data = copy.deepcopy(tiny_rig)
    change(data)
    with pytest.raises(SceneError) as caught:
        open_rig(data)
    assert message in str(caught.value)


def test_all_bad_settings_at_once(tiny_rig: dict[str, Any]) -> None:
    tiny_rig["camera"]["driver"] = "zzz"
    tiny_rig["background"]["settings"]["noise_K"] = "cold"
    tiny_rig["trigger"]["settings"]["nozzle"] = 8
    with pytest.raises(SceneError) as caught:
        open_rig(tiny_rig)
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines[1:]] == [
        "camera.driver",
        "background.settings.noise_K",
        "trigger.settings.nozzle",
    ]


@pytest.mark.parametrize("content", ["", "- a\n", "a: [\n", "\x00"])
def test_bad_file(content: str, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(content)
    with pytest.raises(SceneError, match=r"rig\.yaml"):
        open_rig(tmp_path / "rig.yaml")


def test_driver_that_cannot_be_imported(
    tiny_rig: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from importlib.metadata import EntryPoint

    gone = EntryPoint("gone", "a_maker.sdk:open_camera", "cldit.drivers")
    monkeypatch.setattr("cldit.rig.drivers.entry_points", lambda group: [gone])
    tiny_rig["bench"]["driver"] = "gone"
    with pytest.raises(SceneError, match=r"bench\.driver: 'gone'.*cannot be loaded.*install"):
        open_rig(tiny_rig)


class Broken:
    """A device of which nothing works."""

    def __getattr__(self, name: str) -> Any:
        def fail(*args: Any, **kwargs: Any) -> None:
            raise OSError(f"{name} failed")

        return fail


def test_every_device_is_tried(tiny_rig: dict[str, Any]) -> None:
    """Two of three are broken: both are named, and the third is made safe all the same."""
    rig = open_rig(tiny_rig)
    broken: dict[str, Any] = {"camera": Broken(), "trigger": Broken()}
    rig = replace(rig, **broken)
    with pytest.raises(NotConnected, match=r"camera: connect failed\ntrigger: connect failed"):
        rig.connect()
    rig.background.set_setpoint(500.0)
    with pytest.raises(RigError, match=r"(?s)trigger: make_safe failed;.*camera: make_safe failed"):
        with rig:
            pass
    rig.background.connect()
    assert rig.background.read_configuration()["setpoint_K"] == 295.0


def test_an_error_inside_keeps_its_place(tiny_rig: dict[str, Any]) -> None:
    broken: dict[str, Any] = {"camera": Broken()}
    with pytest.raises(ZeroDivisionError) as caught, replace(open_rig(tiny_rig), **broken):
        raise ZeroDivisionError
    assert "camera: make_safe failed" in "".join(caught.value.__notes__)


def test_what_a_driver_needs_is_imported_with_it() -> None:
    """By the thread that loads the rig: the threads that connect its instruments would import
    modules that import each other, and wait for each other."""
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")
    code = """
import sys
from cldit.rig.drivers import load_driver
load_driver("line_blackbody")
print({"pyvisa", "pyvisa.constants", "pyvisa_py", "serial"} - sys.modules.keys())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def test_what_a_driver_needs_is_named(
    tiny_rig: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is connected, with what to install."""
    monkeypatch.setitem(sys.modules, "viva_genicam", None)
    tiny_rig["camera"] = {"driver": "gige_camera", "settings": {}}
    with pytest.raises(
        SceneError, match=r'camera\.driver: .* needs viva_genicam.*pip install .*"viva-genicam'
    ):
        open_rig(tiny_rig)
