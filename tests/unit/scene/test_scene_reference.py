"""The reference of all keys: whole and described; its schema takes what cldit takes."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib import resources

import jsonschema
import pytest
import yaml
from pydantic import BaseModel

from cldit.scene import dump_scene, load_scene, shipped_scenes
from cldit.scene.checks import descriptions
from tests.bench.scene_reference import FILES, UNLISTED, reference
from tests.command_line import command


def _sections(model: type[BaseModel]) -> set[type[BaseModel]]:
    found = {model}

    def into(annotation: object) -> None:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            if annotation not in found:
                found.update(_sections(annotation) | {annotation})
        for argument in getattr(annotation, "__args__", ()):
            into(argument)

    for field in model.model_fields.values():
        into(field.annotation)
    return found


EVERY = sorted({s for _, _, m in FILES for s in _sections(m)}, key=lambda section: section.__name__)


@pytest.mark.parametrize("section", EVERY, ids=lambda section: section.__name__)
def test_every_key_says_what_it_means(section: type[BaseModel]) -> None:
    texts = descriptions(section)
    assert texts.keys() == section.model_fields.keys()
    # A string that is not a description of one line or two has swallowed code.
    assert all(5 <= len(text) <= 200 for text in texts.values())


def test_page_holds_every_key_and_no_dead_link() -> None:
    page = reference()
    for section in EVERY:
        for key, text in descriptions(section).items():
            listed = not text.startswith(UNLISTED)
            assert not listed or f"\n- `{key}`" in page
    assert "parcels_per_cell" not in page
    headings = re.findall(r"^#+ (.*)$", page, re.MULTILINE)
    anchors = [re.sub(r"[^\w\s-]", "", text).lower().replace(" ", "-") for text in headings]
    assert len(set(anchors)) == len(anchors)
    assert set(re.findall(r"\]\(#(.*?)\)", page)) <= set(anchors)


@cache
def _schema() -> dict[str, object]:
    schema = json.loads(command("scenes", "--schema").output)
    assert isinstance(schema, dict)
    return schema


@pytest.mark.parametrize("name", shipped_scenes())
def test_schema_takes_shipped_scenes(name: str) -> None:
    text = resources.files("cldit.scene.library").joinpath(f"{name}.yaml").read_text("utf-8")
    jsonschema.validate(yaml.safe_load(text), _schema())
    jsonschema.validate(yaml.safe_load(dump_scene(load_scene(name))), _schema())


SHORT = {
    "name": "x",
    "spray": {"model": "cfd", "file": "case", "axis": "-y"},
    "camera": {"pixels": 64, "sensor": {"quantum_efficiency": "curve.csv"}},
    "optics": {"filter_um": "filter.csv"},
    "transport": {"phase": 0.5},
}


def test_schema_takes_short_forms() -> None:
    jsonschema.validate(SHORT, _schema())


@pytest.mark.parametrize(
    "wrong",
    [{"camera": {"sensor": {"bits": 17}}}, {"colour": 1}, {"spray": {"model": "cfd"}}],
    ids=str,
)
def test_schema_refuses(wrong: dict[str, object]) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(SHORT | wrong, _schema())
