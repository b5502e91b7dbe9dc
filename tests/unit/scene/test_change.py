"""Keys by path and short options, tolerances, scenes on a base, commented scenes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from cldit.cli.options import Tolerances
from cldit.errors import SceneError
from cldit.scene import Scene, load_scene, parse_scene, shipped_scenes
from cldit.scene.change import changed, merged, parse_change
from cldit.scene.commented import commented
from cldit.scene.load import chosen_scene, short_changes

COMMENTED_KEY = re.compile(r"^# (?=\s*(?:[A-Za-z_0-9]+:|- ))", re.MULTILINE)


def test_a_path_changes_one_value_and_leaves_the_scene() -> None:
    scene = load_scene("gdi-cone")
    other = scene.with_(**{"walls.temperature_K": 500, "spray.plumes[2].mass_fraction": 2.0})
    assert other.walls.temperature_K == 500.0
    assert other.spray.plumes[2].mass_fraction == 2.0  # type: ignore[union-attr]
    assert other.spray.plumes[1] == scene.spray.plumes[1]  # type: ignore[union-attr]
    assert scene.walls.temperature_K == 450.0


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("walls.temperature_K=500", "walls.temperature_K", 500),
        ("camera.pixels=[200,200]", "camera.pixels", [200, 200]),
        ("domain.leaf_edge_m=null", "domain.leaf_edge_m", None),
    ],
)
def test_values_of_the_command_line_are_yaml(text: str, path: str, value: object) -> None:
    assert parse_change(text) == (path, value)


@pytest.mark.parametrize("text", ["walls.temperature_K", "=3", "a=[1"])
def test_what_is_no_change_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match=re.escape(text)):
        parse_change(text)


def test_sections_are_made_and_lists_counted() -> None:
    data = {"name": "x", "list": [{"a": 1}]}
    assert changed(data, {"walls.temperature_K": 3})["walls"] == {"temperature_K": 3}
    assert changed(data, {"list[-1].a": 2})["list"] == [{"a": 2}]
    assert data == {"name": "x", "list": [{"a": 1}]}
    for path, words in (
        ("list[1].a", "item [1] of 1; allowed: 0..0"),
        ("name.a", "has no keys"),
        ("name[0]", "is no list"),
        ("a..b", "is no key"),
    ):
        with pytest.raises(SceneError, match=re.escape(words)):
            changed(data, {path: 1})


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("walls.temprature_K", "did you mean temperature_K?"),
        ("wals.temperature_K", "did you mean walls?"),
        ("camera.f_number", "did you mean camera.sensor.f_number?"),
        ("accuracy", "did you mean transport.accuracy_K"),
    ],
)
def test_a_wrong_key_names_the_nearest(path: str, words: str) -> None:
    with pytest.raises(SceneError, match=re.escape(words)):
        load_scene("gdi-cone").with_(**{path: 1.0})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("camera.pixels", [1, 2, 3]),
        ("camera.field_m", 3),
        ("camera.model", "fisheye"),
        ("name", ""),
        ("transport.audit", "perhaps"),
        ("background.temperatures_K", "x"),
        ("optics.liquid", {"a": 1}),
    ],
)
def test_messages_are_in_words_of_cldit(path: str, value: object) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene("gdi-cone").with_(**{path: value})
    text = str(caught.value)
    assert path.split(".")[-1] in text
    for word in ("Input", "valid", "pydantic", "tuple", "dictionary", "instance"):
        assert word not in text


def test_a_file_on_a_base(tmp_path: Path) -> None:
    (tmp_path / "hot.yaml").write_text(
        "base: gdi-cone\nwalls: {temperature_K: 600}\n", encoding="utf-8"
    )
    (tmp_path / "two.yaml").write_text(
        "base: hot.yaml\ncamera: {pixels: 64}\ndescription: mine\n", encoding="utf-8"
    )
    scene, gdi = load_scene(tmp_path / "two.yaml"), load_scene("gdi-cone")
    assert (scene.name, scene.description) == ("two", "mine")
    assert scene.walls.temperature_K == 600.0
    assert scene.camera.pixels == (64, 64)
    assert scene.spray == gdi.spray
    assert scene.background == gdi.background


def test_another_model_replaces_the_section() -> None:
    base = {"spray": {"model": "cone", "fuel": "methane"}, "walls": {"a": 1, "b": 2}}
    over = {"spray": {"model": "none"}, "walls": {"b": 3}}
    assert merged(base, over) == {"spray": {"model": "none"}, "walls": {"a": 1, "b": 3}}


def test_a_base_that_leads_back_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("base: b.yaml\n", encoding="utf-8")
    (tmp_path / "b.yaml").write_text("base: a.yaml\n", encoding="utf-8")
    with pytest.raises(SceneError, match="leads back to itself"):
        load_scene(tmp_path / "a.yaml")
    (tmp_path / "c.yaml").write_text("base: 3\n", encoding="utf-8")
    with pytest.raises(SceneError, match="3 is no scene"):
        load_scene(tmp_path / "c.yaml")


@pytest.mark.parametrize("name", list(shipped_scenes()))
def test_a_commented_scene_reads_as_the_same(name: str) -> None:
    scene = load_scene(name)
    text = commented(scene)
    assert parse_scene(yaml.safe_load(text)) == scene
    every = parse_scene(yaml.safe_load(COMMENTED_KEY.sub("", text)))  # all defaults taken in
    assert every.model_dump_json() == scene.model_dump_json()
    assert all(line == line.rstrip() for line in text.splitlines())


@pytest.mark.parametrize(
    ("section", "name", "key"),
    [("", "name", "name"), ("walls", "temperature_K", "walls.temperature_K"),
     ("camera.sensor", "bits", "camera.sensor.bits"),
     ("spray.plumes.0", "cone_angle_deg", r"spray.plumes\[0\].cone_angle_deg")],
)  # fmt: skip
def test_assignment_is_refused_with_the_call_that_works(section: str, name: str, key: str) -> None:
    here: Any = load_scene("gdi-cone")
    for part in section.split(".") if section else ():
        here = here[int(part)] if part.isdigit() else getattr(here, part)
    before = getattr(here, name)
    with pytest.raises(SceneError, match=rf'^{name}: .*scene\.with_\(\*\*{{"{key}": 12}}\)$'):
        setattr(here, name, 12)
    with pytest.raises(SceneError, match=f"^{name}: "):
        delattr(here, name)
    assert getattr(here, name) == before


def test_tab_shows_keys_and_the_repr_is_short() -> None:
    scene = load_scene("gdi-cone")
    assert {"walls", "camera", "with_", "target_m"} <= set(dir(scene))
    assert not [name for name in dir(scene) if name.startswith(("model_", "_"))]
    assert "json" not in dir(scene) and dir(scene.walls) == ["temperature_K"]
    assert repr(scene.walls) == "Walls(temperature_K=450.0)" and repr(scene.plan) == "PlanSize()"
    assert "'gdi-cone': spray cone, 500 x 400 pixels" in repr(scene) and len(str(scene)) < 150


def test_short_options_are_those_of_the_command_line() -> None:
    quick = chosen_scene("gdi-cone", quick=True, pixels=64)
    assert quick.camera.pixels == (64, 51) and quick.transport.accuracy_K == 4.0
    assert chosen_scene("gdi-cone", quick=True).camera.pixels == (128, 102)
    square = load_scene("gdi-cone").with_(**{"camera.field_m": [0.1, 0.1]})
    assert chosen_scene(square, quick=True).camera.pixels == (128, 128)
    upright = load_scene("gdi-cone").with_(**{"camera.field_m": [0.001, 0.5]})
    assert chosen_scene(upright, quick=True).camera.pixels == (1, 128)
    assert chosen_scene(quick, pixels=(30, 20)).camera.pixels == (30, 20)
    with pytest.raises(SceneError, match=r"camera\.pixels: 0 is outside"):
        chosen_scene("gdi-cone", pixels=0)


def with_transport(**transport: Any) -> Scene:
    return parse_scene({**load_scene("gdi").model_dump(mode="json"), "transport": transport})


def both(scene: Scene) -> tuple[float, float | None]:
    return scene.transport.accuracy_K, scene.transport.accuracy_emissivity


def test_one_mapping_sets_both() -> None:
    assert both(with_transport(accuracy={"temperature_K": 2, "emissivity": 0.01})) == (2.0, 0.01)
    assert both(with_transport(accuracy={"emissivity": 0.02})) == (1.0, 0.02)
    assert both(with_transport(accuracy_K=3)) == (3.0, None)


@pytest.mark.parametrize(
    ("transport", "text"),
    [
        ({"accuracy": {"kelvin": 1}}, "transport.accuracy.kelvin: unknown key"),
        ({"accuracy": {"emissivity": 2}}, "transport.accuracy_emissivity: 2 is outside 1e-06..1"),
        ({"accuracy": {"emissivity": 0.1}, "accuracy_emissivity": 0.2}, "allowed: one of them"),
        ({"accuracy": 1.0}, "transport.accuracy: unknown key"),
    ],
)
def test_what_is_no_tolerance(transport: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        with_transport(**transport)


def test_one_tolerance_chooses_the_other_again() -> None:
    """A new tolerance of T_app does not keep that of emissivity of the scene."""
    given = with_transport(accuracy={"temperature_K": 1, "emissivity": 0.01})
    assert both(given.with_(**short_changes(given, accuracy=(2.0, None)))) == (2.0, None)
    assert both(given.with_(**short_changes(given, accuracy=(2.0, 0.03)))) == (2.0, 0.03)
    assert both(given.with_(**short_changes(given, quick=True))) == (4.0, None)
    assert both(given.with_(**short_changes(given, pixels=8))) == (1.0, 0.01)


def test_on_the_command_line() -> None:
    kind = Tolerances()
    assert kind.convert("1K", None, None) == (1.0, None)
    assert kind.convert("0.5,0.01", None, None) == (0.5, 0.01)
    for text in ("1K,", "1K,x", "x"):
        with pytest.raises(click.BadParameter, match="allowed: e"):
            kind.convert(text, None, None)
