"""Tolerances of both results: in a scene, by short options, and on the command line."""

from __future__ import annotations

from typing import Any

import click
import pytest

from cldit.cli.options import Tolerances
from cldit.errors import SceneError
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.load import short_changes


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
