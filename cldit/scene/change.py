"""Changes of single keys of a scene by path, such as `spray.plumes[2].mass_fraction`."""

import copy
import re
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from cldit.errors import SceneError
from cldit.io.plain_data import parse_yaml

if TYPE_CHECKING:
    from cldit.scene.schema import Scene

_PART = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[-?[0-9]+\])*)")


def parse_change(text: str) -> tuple[str, Any]:
    """Path and value of a command-line change such as `camera.pixels=[200, 200]`."""
    path, sign, value = text.partition("=")
    if not sign or not path.strip():
        raise SceneError(
            f"{text}: is no change; allowed: KEY=VALUE, such as walls.temperature_K=500"
        )
    return path.strip(), parse_yaml(value, source=text)


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scene's plain data with other values at some paths, not checked yet.

    A mapping replaces a whole section; missing sections are created.

    data: as read from YAML. changes: value of each path; names are joined with dots, `[i]` counts
    in lists from 0.
    """
    made = copy.deepcopy(dict(data))
    for path, value in changes.items():
        steps = _steps(path)
        here: Any = made
        for step, following in pairwise(steps):
            here = _entered(here, step, path, make=isinstance(following, str))
        _check(here, steps[-1], path)
        here[steps[-1]] = value
    return made


def value_at(scene: "Scene", key: str) -> Any:
    """Value of a scene at a path such as `spray.plumes[2].mass_fraction`."""
    here: Any = scene.model_dump(mode="json")
    for part in key.replace("[", ".").replace("]", "").split("."):
        try:
            here = here[int(part)] if isinstance(here, list) else here[part]
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise SceneError(f"{key}: the scene has no such key") from error
    return here


def _steps(path: str) -> list[str | int]:
    steps: list[str | int] = []
    for part in path.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise SceneError(
                f"{path}: is no key; allowed: names joined with dots, and [i] for items of lists"
            )
        steps.append(match[1])
        steps += [int(number) for number in re.findall(r"-?[0-9]+", match[2])]
    return steps


def _entered(here: Any, step: str | int, path: str, *, make: bool) -> Any:
    _check(here, step, path)
    if isinstance(step, str) and here.get(step) is None and make:
        here[step] = {}
    found = here.get(step) if isinstance(step, str) else here[step]
    if isinstance(found, tuple):
        found = here[step] = list(found)
    return found


def _check(here: Any, step: str | int, path: str) -> None:
    if isinstance(step, str):
        if not isinstance(here, dict):
            raise SceneError(f"{path}: no {step} in {here!r}, which has no keys")
        return
    if not isinstance(here, list):
        raise SceneError(f"{path}: no item [{step}] in {here!r}, which is no list")
    if not -len(here) <= step < len(here):
        raise SceneError(f"{path}: item [{step}] of {len(here)}; allowed: 0..{len(here) - 1}")


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` updated by `over`: sections key by key, lists and values as a whole.

    A section with another `model` replaces the whole section, as its keys differ.
    """
    made = copy.deepcopy(dict(base))
    for key, value in over.items():
        before = made.get(key)
        if isinstance(value, Mapping) and isinstance(before, dict):
            other = "model" in value and value["model"] != before.get("model")
            made[key] = dict(value) if other else merged(before, value)
        else:
            made[key] = copy.deepcopy(value)
    return made
