"""Grids of scenes: what the text means, what is refused, and which scenes share a trace."""

from __future__ import annotations

from pathlib import Path

import pytest

from cldit.errors import SceneError, StudyError
from cldit.run.content import trace_content, trace_key
from cldit.scene import Scene, load_scene, parse_scene
from cldit.study.grid import Grid


@pytest.fixture(scope="module")
def gdi() -> Scene:
    return load_scene("gdi-cone")


def test_ranges_and_lists() -> None:
    grid = Grid.parse("walls.temperature_K=300:600:25,fuel.temperature_K=330,350,370")
    walls, fuel = grid.axes
    assert walls.values == tuple(range(300, 601, 25)) and walls.unit == "K"
    assert (fuel.name, fuel.key) == ("fuel.temperature_K", "spray.fuel_temperature_K")
    assert grid.shape == (13, 3)
    words = Grid.parse("spray.evaporation=spalding,dukowicz,transport.order=0,null")
    assert [axis.values for axis in words.axes] == [("spalding", "dukowicz"), (0, None)]
    assert Grid.parse("a=600:500:-50").axes[0].values == (600, 550, 500)
    assert Grid.parse("a=1e-3,2.5").axes[0].values == (1e-3, 2.5)


@pytest.mark.parametrize("step", [0.1, 0.25, 0.3, 1 / 3, 1e-3, 7.0])
def test_stop_is_included(step: float) -> None:
    """A stop that is a whole number of steps away is part of the range, whatever rounding does."""
    for start in (-50, -7, 0, 1, 13, 50):
        for count in (*range(1, 12), 31, 100, 200):
            stop = start + (count - 1) * step
            values = Grid.parse(f"a={start}:{stop!r}:{step!r}").axes[0].values
            assert len(values) == count
            last = values[-1]
            assert isinstance(last, (int, float)) and last == pytest.approx(stop, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("330,350", "has no key"),
        ("walls.temperature_K=", "lacks a value"),
        ("walls.temperature_K=1:2", "is no range"),
        ("walls.temperature_K=1:nan:2", "is no range"),
        ("walls.temperature_K=2:1:1", "has no value"),
        ("walls.temperature_K=1:2:0", "has no value"),
        ("walls.temperature_K=0:1:1e-9", "values; allowed: 100000"),
        ("a=1:1000:1,b=1:1000:1", "1000000 scenes"),
        ("a=1,1", "has a value twice"),
        ("fuel.temperature_K=330,spray.fuel_temperature_K=350", "is given twice"),
        ("a b=1", "is no key of a scene"),
    ],
)
def test_text_that_cannot_be_read(text: str, says: str) -> None:
    with pytest.raises(StudyError, match=says):
        Grid.parse(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("wals.temperature_K=3", "wals: unknown key; did you mean walls"),
        ("walls.temperature_K.x=3", r"walls\.temperature_K"),
        ("walls.temperature_K=300,9000", r"walls\.temperature_K: 9000 is outside 0\.\.5000"),
        ("spray.plumes[9].azimuth_deg=3", r"item \[9\] of 8"),
        ("optics.preset=grey", "grey"),
    ],
)
def test_scenes_that_are_not_allowed(gdi: Scene, text: str, says: str) -> None:
    with pytest.raises(SceneError, match=says):
        list(Grid.parse(text).points(gdi))


def test_points(gdi: Scene) -> None:
    points = list(
        Grid.parse("spray.plumes[1].azimuth_deg=10,20,walls.temperature_K=300").points(gdi)
    )
    assert [point.place for point in points] == [(0, 0), (1, 0)]
    assert points[1].scene.spray.plumes[1].azimuth_deg == 20.0  # type: ignore[union-attr]
    assert points[1].scene.walls.temperature_K == 300.0


@pytest.mark.parametrize(
    ("key", "value", "same"),
    [
        ("walls.temperature_K", 0.0, True),
        ("background.temperatures_K", [300.0, 400.0], True),
        ("background.emissivity", 0.9, True),
        ("camera.sensor.read_noise_electrons", 5.0, True),
        ("plan.shots", 50, True),
        ("name", "another", True),
        ("background.radius_m", 0.07, False),
        ("background.shape", "enclosure", False),
        ("camera.pixels", [999, 1000], False),
        ("optics.k", 0.05, False),
        ("transport.order", 1, False),
        ("spray.fuel_temperature_K", 360.0, False),
        ("spray.seed", 2, False),
    ],
)
def test_what_a_trace_depends_on(gdi: Scene, key: str, value: object, same: bool) -> None:
    assert (trace_key(gdi.with_(**{key: value})) == trace_key(gdi)) == same


@pytest.mark.parametrize(
    "values",
    [
        {"optics.preset": "spectral"},
        {"transport.method": "path"},
    ],
    ids=str,
)
def test_bound_to_its_light(gdi: Scene, values: dict[str, object]) -> None:
    """Nodes are chosen for the scene's light, and `path` stops at an error in it."""
    bound = gdi.with_(**values)
    hot = bound.with_(**{"walls.temperature_K": 500.0})
    assert trace_content(hot) != trace_content(bound)
    assert trace_content(bound.with_(**{"plan.shots": 50})) == trace_content(bound)


def test_files_count_by_content(tmp_path: Path) -> None:
    file = tmp_path / "block.npz"
    file.write_bytes(b"one")
    scene = parse_scene({"name": "block", "spray": {"model": "grid", "file": str(file)}})
    before = trace_key(scene)
    assert trace_key(scene) == before
    file.write_bytes(b"two")
    assert trace_key(scene) != before
