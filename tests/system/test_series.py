"""A series through the command line: made, gone on with, checked; bad times; progress."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

import cldit
from cldit.cli.console import ProgressBar
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from tests.command_line import command
from tests.unit.cfd.seriescases import write_times

TIMES = {"0": 0.0, "0.00004": 3e-5, "0.00008": 6e-5, "0.0001": -1.0}
SMALL = ("--pixels", "24", "--set", "transport.audit=false", "--set", "domain.leaf_edge_m=0.001")


def run(*arguments: object, fails: bool = False) -> Result:
    return command("run", *arguments, status=int(fails))


@pytest.fixture(scope="module", autouse=True)
def _gif_alone() -> Iterator[None]:
    """Packing an MP4 takes seconds; tests/unit/report/test_film.py does it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cldit.show.figures.film.mp4_possible", lambda: False)
        yield


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_times(tmp_path_factory.mktemp("series") / "jet", TIMES)


@pytest.fixture(scope="module")
def scene(case: Path) -> Path:
    path = case.parent / "jet.yaml"
    command("import", case, "--time", "0.08ms", "--fit", path)
    return path


@pytest.fixture(scope="module")
def made(scene: Path) -> Path:
    out = scene.parent / "out"
    run(scene, "--times", "all", "--trace-only", "--out", out, *SMALL)
    return out


def rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "series.csv").read_text().splitlines()))


def test_a_series(made: Path) -> None:
    """Before the injection there is no spray; when the cloud is empty there is gas alone."""
    table = rows(made)
    assert [row["time_s"] for row in table] == ["0", "4e-05", "8e-05", "0.0001"]
    assert [row["state"] for row in table] == ["no spray", "done", "done", "done"]
    assert "time_0ms" not in {path.name for path in made.iterdir()}
    for row in table[1:]:
        one = cldit.open_run(made / row["folder"])
        assert getattr(one.scene.spray, "time_s", None) == float(row["time_s"])
        assert one.info.spray["vapour_mass_kg"] == pytest.approx(float(row["vapour_mass_kg"]))
    early, late = (float(row["liquid_penetration_95_m"]) for row in table[1:3])
    assert 0.0 < early < late < 6e-3
    assert table[3]["liquid_mass_kg"] == ""
    with Image.open(made / "film.gif") as film:
        assert film.n_frames == 3  # type: ignore[attr-defined]
        shown = film.size
    for path in (made / "pictures").glob("*.png"):
        with Image.open(path) as picture:
            # 300 dpi on paper, 150 dpi in the film
            assert picture.size == pytest.approx([2 * side for side in shown], abs=2)
    assert (made / "time_0.1ms_gas_alone").is_dir()
    assert (made / "series.png").stat().st_size > 10_000


def test_show_names_the_film(made: Path, tmp_path: Path) -> None:
    assert command("show", made).output.split()[-1].endswith("film.gif")
    (tmp_path / "series.yaml").touch()
    assert "has no film" in command("show", tmp_path, status=1).output


def test_it_goes_on_where_it_was(scene: Path, made: Path, tmp_path: Path) -> None:
    """One that lacks its last time makes that alone; the others are kept as they are."""
    out = tmp_path / "out"
    shutil.copytree(made, out)
    (out / "time_0.08ms" / "run.json").unlink()
    before = (out / "time_0.04ms" / "run.json").stat().st_mtime_ns
    done = run(scene, "--times", "all", "--trace-only", "--out", out, *SMALL)
    text = done.output.replace("\n", "")
    assert "time_0.04ms holds this scene already" in text
    assert "time_0.08ms holds this scene already" not in text
    assert (out / "time_0.04ms" / "run.json").stat().st_mtime_ns == before
    again, first = (Maps.load(each / "time_0.08ms" / "maps") for each in (out, made))
    np.testing.assert_array_equal(again.emissivity, first.emissivity)


def test_a_series_names_its_times(made: Path) -> None:
    with pytest.raises(RunFolderError, match=r"runs of a series; .*time_0\.04ms, .*time_0\.08ms"):
        cldit.open_run(made)


def test_other_settings_or_other_files_are_no_series_to_go_on_with(
    scene: Path, made: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(made, out)
    other = ("--set", "walls.temperature_K=400")
    done = run(scene, "--times", "all", "--trace-only", "--out", out, *SMALL, *other, fails=True)
    assert "contains a series of another scene" in done.output.replace("\n", " ")
    with pytest.raises(RunFolderError, match="contains no series"):
        cldit.run_series(cldit.load_scene(scene), made / "pictures", trace_only=True)


def test_a_case_that_was_computed_again_is_read_again(
    case: Path, scene: Path, made: Path, tmp_path: Path
) -> None:
    """The times whose files changed, and those alone."""
    out = tmp_path / "out"
    shutil.copytree(made, out)
    field = case / "0.00004" / "C7H16"
    text = field.read_text()
    try:
        field.write_text(text.replace("0.05", "0.06"))
        arguments = (scene, "--times", "0.04ms,0.08ms", "--trace-only", "--out", out, *SMALL)
        said = run(*arguments).output.replace("\n", "")
    finally:
        field.write_text(text)
    assert "time_0.08ms holds this scene already" in said
    assert "time_0.04ms holds this scene already" not in said
    new, old = (float(rows(each)[at]["vapour_mass_kg"]) for each, at in ((out, 0), (made, 1)))
    assert new == pytest.approx(1.2 * old, rel=1e-6)


def test_a_bad_time_is_named_and_the_others_run(scene: Path, tmp_path: Path) -> None:
    data = cldit.load_scene(scene)
    case = tmp_path / "jet"
    shutil.copytree(Path(getattr(data.spray, "file")), case)  # noqa: B009
    (case / "0.00004" / "T").write_text("cut off")
    (tmp_path / "bad.yaml").write_text(
        data.with_(**{"spray.file": str(case)}).to_yaml(), encoding="utf-8"
    )
    out = tmp_path / "out"
    arguments = (tmp_path / "bad.yaml", "--times", "0.04ms,0.08ms", "--trace-only", "--out", out)
    done = run(*arguments, *SMALL, fails=True)
    assert "error: 0.04 ms: " in done.output
    assert "0.00004/T" in done.output.replace("\n", "")
    assert [row["state"] for row in rows(out)] == ["failed", "done"]
    assert (out / "film.gif").is_file()


def test_times_that_cannot_be(scene: Path, tmp_path: Path) -> None:
    out = ("--trace-only", "--out", tmp_path / "out")
    done = run(scene, "--times", "0.05ms", *out, fails=True)
    assert "no time 5e-05 s" in done.output and "4e-05" in done.output
    assert not (tmp_path / "out").exists()
    done = run(scene, "--times", "all", "--time", "0.00004", *out, fails=True)
    assert "allowed: one of them" in done.output.replace("\n", " ")


def test_a_delay_that_the_case_lacks_is_refused_before_anything_is_traced(
    scene: Path, tmp_path: Path
) -> None:
    delays = ("--set", "plan.delays_s=[0.00004, 0.00005]")
    done = run(scene, *delays, "--out", tmp_path / "out", *SMALL, fails=True)
    words = " ".join(done.output.split())
    assert "plan.delays_s: 0.05 ms:" in words and "no time 5e-05 s" in words
    assert not (tmp_path / "out").exists()


def test_a_run_of_a_case_shows_how_far_its_reading_is(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And says what of the scene does not fit it."""
    seen: list[str] = []

    def count(self: ProgressBar, what: str, done: int, total: int) -> None:
        seen.append(what)

    monkeypatch.setattr(ProgressBar, "count", count)
    out: tuple[Any, ...] = ("--trace-only", "--out", tmp_path / "out", *SMALL)
    done = run("gdi", "--cfd", case, "--time", "0.08ms", *out, "--set", "domain.leaf_edge_m=0.002")
    assert "reading the mesh" in seen and "reading T" in seen
    (line,) = [each for each in done.output.splitlines() if "does not fit the case" in each]
    assert "walls.temperature_K is 450 K" in line
    assert "160 mm x 128 mm" in line
    assert "--fit" in line


def test_a_fit_does_not_overwrite(scene: Path, case: Path) -> None:
    before = scene.read_text()
    assert "exists; --fit" in command("import", case, "--fit", scene, status=1).output
    assert scene.read_text() == before


@pytest.mark.slow
def test_a_series_of_acquisitions_keeps_what_is_done(scene: Path, tmp_path: Path) -> None:
    """With the rig; the whole of a time is kept, its report too."""
    one = cldit.load_scene(scene).with_(
        **{
            "camera.pixels": [24, 30],
            "camera.sensor.pixels": [16, 20],
            "camera.sensor.bad_pixels": 0,
            "transport.audit": False,
            "domain.leaf_edge_m": 2e-3,
            "background.temperatures_K": [400.0, 500.0],
            "plan.shots": 2,
            "plan.references": 2,
        }
    )
    series = cldit.run_series(one, tmp_path / "out", times=[8e-5])
    assert not series.failed
    report = tmp_path / "out" / "time_0.08ms" / "report.html"
    written = report.stat().st_mtime_ns
    said: list[str] = []
    again = cldit.run_series(one, tmp_path / "out", times=[8e-5], progress=said.append)
    assert any("finished before, kept" in each for each in said)
    assert report.stat().st_mtime_ns == written
    assert again.times == series.times
