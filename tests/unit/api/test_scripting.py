"""The rig, evaluations and progress from a script or notebook."""

from __future__ import annotations

import json
import sys
import threading
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import cldit
from cldit.acquisition import Plan, SavedShot, acquire, open_acquisition
from cldit.acquisition.preview import Preview
from cldit.acquisition.progress import Progress
from cldit.api.progress_bars import NotebookBar, progress_bar
from cldit.cli.console import ProgressBar
from cldit.errors import EvaluationError, RunFolderError
from cldit.rig.drivers import describe_drivers
from cldit.rig.load import open_rig
from cldit.rig.protocols import KINDS
from tests.extras import needs
from tests.journals import read_journal
from tests.laboratory import laboratory
from tests.measured_files import write_measured
from tests.patience import HANG_s


def test_ten_lines(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    seen = []
    with cldit.open_rig(tiny_rig) as rig:
        for saved in rig.acquire(tiny_plan, tmp_path / "a"):
            assert (tmp_path / "a" / "shots" / f"{saved.shot.id}.tif").is_file()
            seen.append((saved.shot.id, saved.image))
    acquisition = open_acquisition(tmp_path / "a")
    assert [name for name, _ in seen] == [shot.id for shot in tiny_plan.steps()]
    for shot in acquisition.shots:
        assert np.array_equal(dict(seen)[shot.id], acquisition.load(shot))


def test_leaving_the_loop_stops_safely_and_resumes(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    with cldit.open_rig(tiny_rig) as rig:
        for _, saved in zip(range(3), rig.acquire(tiny_plan, tmp_path / "a"), strict=False):
            assert saved.meta["shot"] == saved.shot.id
    events = [entry["event"] for entry in read_journal(tmp_path / "a" / "journal.jsonl")]
    assert events[-2:] == ["stopped", "made safe"]
    with cldit.open_rig(tiny_rig) as rig:
        rest = list(rig.acquire(tiny_plan, tmp_path / "a"))
    assert open_acquisition(tmp_path / "a").complete and 0 < len(rest) <= 7


def test_preview_drops_rather_than_delays() -> None:
    release = threading.Event()
    shown: list[int] = []

    def slow(item: int) -> None:
        release.wait(HANG_s)
        shown.append(item)

    with Preview(slow) as preview:
        for item in range(1000):
            preview.offer(item)  # one that waited would show more than the first and the last
        release.set()
    assert shown[-1] == 999 and len(shown) <= 2 and preview.dropped == 1000 - len(shown)


def test_broken_preview_costs_nothing(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    calls = []

    def broken(saved: SavedShot) -> None:
        calls.append(saved)
        raise RuntimeError("no window")

    assert acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a", preview=broken).complete
    assert len(calls) == 1


def test_dry_run(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    """Nothing moves, nothing is written."""
    with cldit.open_rig(tiny_rig) as rig:
        found = rig.dry_run(tiny_plan, tmp_path / "a")
        assert rig.background.read_configuration()["setpoint_K"] == 295.0
        assert found.problems == () and found.shots == 10
        # 145 K + 40 K of way at 3 s/K, two settlings of 60 s, ten shots of a second and more.
        assert found.background_s == (185 * 3.0 + 120.0) or abs(found.background_s - 675.0) < 1.0
        assert 10.0 < found.time_s - found.background_s < 11.0
        assert found.disk_bytes > 10 * 2 * 16 * 12
    assert not (tmp_path / "a").exists()


def test_every_driver_says_on_what_it_was_tested() -> None:
    """A user must see that no driver of a real instrument has met the instrument."""
    for name, about in describe_drivers().items():
        assert about.kind in ("bench", *KINDS), name
        simulated = name.startswith("simulated")
        assert about.tested.startswith("simulated" if simulated else "untested on hardware"), name
        assert simulated == (about.needs == ())


@needs("xarray", extra="studies")
def test_an_evaluation_is_drawn_compared_and_stored(tmp_path: Path) -> None:
    folder = tmp_path / "july"
    folder.mkdir()
    write_measured(folder, laboratory(1, shape=(24, 40)))
    data = cldit.evaluate(folder)
    for name in data.apparent_temperature_K.ancillary_variables.split():
        assert name in data
    assert "apparent_temperature_total_error_K" in data.apparent_temperature_K.ancillary_variables
    assert cldit.plot(data).axes[0].get_xlabel() == "x / mm"
    assert len(cldit.plot(data, "errors").axes) == 4  # two pictures, two colour bars
    budget = cldit.plot(data, "budget").axes[0]
    assert "walls" in " ".join(label.get_text() for label in budget.get_yticklabels())

    stored = json.loads((folder / "maps" / "evaluation.json").read_text())
    names = [Path(one["path"]).name for one in stored["origin"]["inputs"]]
    assert "measured.yaml" in names and len(names) > 3
    assert all(len(one["sha256"]) == 64 for one in stored["origin"]["inputs"])
    assert json.loads(data.attrs["evaluation"])["origin"]["inputs"] == []

    found = cldit.compare(folder, folder).differences[0]
    assert found.same and found.stated_K[0] is not None

    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf", reason="the extra studies is not installed")
    path = tmp_path / "july.nc"
    data.to_netcdf(path, engine="h5netcdf")
    back = xarray.open_dataset(path, engine="h5netcdf", mask_and_scale=False)
    assert back.equals(data) and back.attrs["title"] == data.attrs["title"]
    np.testing.assert_allclose(back.x.values, data.x.values)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The outputs of a kernel, in their order."""
    found: list[str] = []
    package: Any = ModuleType("IPython")
    package.get_ipython = lambda: SimpleNamespace(kernel=object())
    display: Any = ModuleType("IPython.display")
    display.HTML = str
    display.display = lambda html, display_id: SimpleNamespace(update=found.append)
    package.display = display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return found


def test_a_notebook_shows_lines_and_a_bar(shown: list[str]) -> None:
    with progress_bar() as bar:
        assert isinstance(bar, NotebookBar)
        bar.say("a < b")
        bar.watch(Progress("shots", 3, 10, None))
    assert shown[0] == "<small>a &lt; b</small>"
    assert '<progress max="10" value="3">' in shown[1] and "shots 3/10" in shown[1]
    assert shown[-1] == ""  # nothing stays


def test_elsewhere_it_is_the_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    with progress_bar() as bar:
        assert isinstance(bar, ProgressBar)


COMMANDS = ("fit", "plan", "sweep", "import_case", "export", "view", "compare", "evaluate")


def test_every_name_is_there() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in cldit.__all__:
            assert getattr(cldit, name) is not None
    assert set(COMMANDS) < set(dir(cldit))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = cldit.simulat


@pytest.mark.parametrize("name", ["parse_scene", "dump_scene", "open_device", "run_experiment"])
def test_old_names_name_their_successor(name: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"cldit\.{name} is cldit\.\w+"):
        assert callable(getattr(cldit, name))


def test_scene_from_a_mapping_and_as_yaml() -> None:
    scene = cldit.load_scene("empty")
    assert cldit.Scene.from_dict(yaml.safe_load(scene.to_yaml())) == scene


def test_recording_needs_a_folder() -> None:
    with pytest.raises(EvaluationError, match=r"record=True: allowed: with `out`"):
        cldit.simulate("empty", record=True)
    with pytest.raises(EvaluationError, match=r"record=True"):
        cldit.simulate("empty", "there", record=True, like=object())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("error_K", "quantile", "text"),
    [(0.0, 0.9, "error_K: 0"), (1.0, 1.5, "quantile: 1.5")],
)
def test_a_plan_is_checked_before_it_traces(error_K: float, quantile: float, text: str) -> None:
    with pytest.raises(EvaluationError, match=text):
        cldit.plan("empty", error_K, quantile=quantile)


def test_a_view_needs_a_folder() -> None:
    with pytest.raises(RunFolderError, match="view: no folder"):
        cldit.view()
