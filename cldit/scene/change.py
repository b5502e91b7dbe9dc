"""Changes of single keys of a scene by path, such as `spray.plumes[2].mass_fraction`."""

import copy
import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from cldit.errors import SceneError
from cldit.io.plain_data import parse_yaml

_PART = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[-?[0-9]+\])*)")


def parse_change(assignment: str) -> tuple[str, Any]:
    """Path and value of a command-line change such as `camera.pixels=[200, 200]`."""
    path, sign, value = assignment.partition("=")
    if not sign or not path.strip():
        raise SceneError(
            f"{assignment}: is no change; allowed: KEY=VALUE, such as walls.temperature_K=500"
        )
    return path.strip(), parse_yaml(value, source=assignment)


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scene's plain data with other values at some paths, not checked yet.

    A mapping replaces a whole section; missing sections are created.

    data: as read from YAML. changes: value of each path; names are joined with dots, `[i]` counts
    in lists from 0.
    """
    result = copy.deepcopy(dict(data))
    for path, value in changes.items():
        steps = _steps(path)
        section: Any = result
        for step, following in pairwise(steps):
            section = _entered(section, step, path, make=isinstance(following, str))
        _check(section, steps[-1], path)
        section[steps[-1]] = value
    return result


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


def _entered(container: Any, step: str | int, path: str, *, make: bool) -> Any:
    _check(container, step, path)
    if isinstance(step, str) and container.get(step) is None and make:
        container[step] = {}
    item = container.get(step) if isinstance(step, str) else container[step]
    if isinstance(item, tuple):
        item = container[step] = list(item)
    return item


def _check(container: Any, step: str | int, path: str) -> None:
    if isinstance(step, str):
        if not isinstance(container, dict):
            raise SceneError(f"{path}: no {step} in {container!r}, which has no keys")
        return
    if not isinstance(container, list):
        raise SceneError(f"{path}: no item [{step}] in {container!r}, which is no list")
    if not -len(container) <= step < len(container):
        raise SceneError(
            f"{path}: item [{step}] of {len(container)}; allowed: 0..{len(container) - 1}"
        )


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` updated by `over`: sections key by key, lists and values as a whole.

    A section with another `model` replaces the whole section, as its keys differ.
    """
    result = copy.deepcopy(dict(base))
    for key, value in over.items():
        base_value = result.get(key)
        if isinstance(value, Mapping) and isinstance(base_value, dict):
            other_model = "model" in value and value["model"] != base_value.get("model")
            result[key] = dict(value) if other_model else merged(base_value, value)
        else:
            result[key] = copy.deepcopy(value)
    return result
