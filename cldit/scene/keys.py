"""Values of scenes by their keys, keys whose values differ, and wider cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cldit.errors import SceneError
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray


@dataclass(frozen=True)
class KeyDifference:
    """A key of the scene and its two values; None if a scene does not have the key."""

    key: str
    baseline: Any
    compared: Any

    @property
    def text(self) -> str:
        """`walls.temperature_K: 450 and 500`."""
        return f"{self.key}: {_value(self.baseline)} and {_value(self.compared)}"


def key_differences(baseline: Scene, compared: Scene) -> tuple[KeyDifference, ...]:
    """Keys whose values differ between two scenes, in the order of the scene file."""
    baseline_values, compared_values = (
        dict(_leaves(scene.model_dump(mode="json"))) for scene in (baseline, compared)
    )
    return tuple(
        KeyDifference(key, baseline_values.get(key), compared_values.get(key))
        for key in dict.fromkeys((*baseline_values, *compared_values))
        if baseline_values.get(key) != compared_values.get(key)
    )


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values by their paths; a list of numbers or texts is a value."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _leaves(part, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(part, Mapping) for part in value):
        for number, part in enumerate(value):
            yield from _leaves(part, f"{path}[{number}]")
    else:
        yield path, value


def _value(value: Any) -> str:
    if value is None:
        return "nothing"
    string = f"{value:g}" if isinstance(value, float) else str(value)
    return string if len(string) <= 60 else f"{string[:57]}..."


def value_at(scene: Scene, key: str) -> Any:
    """Value of a scene at a path such as `spray.plumes[2].mass_fraction`."""
    value: Any = scene.model_dump(mode="json")
    for part in key.replace("[", ".").replace("]", "").split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise SceneError(f"{key}: the scene has no such key") from error
    return value


def coarsened(scene: Scene, factor: float) -> Scene:
    """The scene with octree, gas cells and lattice `factor` times as wide."""
    if factor == 1.0:
        return scene
    widths = {"domain.leaf_edge_m": scene.domain.leaf_edge_m}
    if isinstance(scene.spray, LagrangianSpray):
        widths["spray.box.spacing_m"] = scene.spray.box.cell_m
    elif isinstance(scene.spray, ConeSpray):
        widths["spray.spacing_m"] = scene.spray.lattice_m
    return scene.with_(
        **{key: factor * width for key, width in widths.items() if width is not None}
    )
