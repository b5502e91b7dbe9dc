"""Where an OpenFOAM case injects: `position` and `direction` entries of its cloud dictionary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cldit.cfd.case import Injector
from cldit.errors import FileError, SprayError
from cldit.files import read_text

_SKIP = re.compile(r"/\*.*?\*/|//[^\n]*|^\s*#[^\n]*", re.DOTALL | re.MULTILINE)
_TOKEN = re.compile(r'"[^"]*"|[{}();]|[^\s{}();"]+')


def read_injectors(path: Path) -> tuple[Injector, ...]:
    """Every injector of the dictionary that states a fixed position and direction.

    Understood are `position (x y z); direction (x y z);`, also with the word `constant` before
    the vector, and `positionAxis ( ((x y z) (x y z)) .. );`. Directives and macros are not
    expanded: an injector that needs them is passed over.

    Raises:
        SprayError: the file cannot be read, or its brackets do not match.
    """
    try:
        text = read_text(path, encoding="latin-1")
    except FileError as error:
        raise SprayError(str(error)) from error
    tokens = _TOKEN.findall(_SKIP.sub(" ", text))
    try:
        content, end = _entries(tokens, 0)
        if end != len(tokens):
            raise IndexError
    except IndexError as error:
        raise SprayError(
            f"{path}: its brackets do not match; set spray.nozzle_m and spray.axis instead"
        ) from error
    models = content.get("subModels", content)
    return tuple(
        Injector(str(path), np.array(position), np.array(direction))
        for position, direction in _found(models)
    )


def _entries(tokens: list[str], at: int) -> tuple[dict[str, object], int]:
    """Entries up to a closing brace or the end, and the offset of that."""
    content: dict[str, object] = {}
    while at < len(tokens) and tokens[at] != "}":
        key = tokens[at]
        at += 1
        if tokens[at] == "{":
            content[key], at = _entries(tokens, at + 1)
            if tokens[at] != "}":
                raise IndexError
            at += 1
            continue
        content[key], at = _values(tokens, at, ";")
    return content, at


def _values(tokens: list[str], at: int, stop: str) -> tuple[list[object], int]:
    """Words and lists up to `stop`, and the offset behind it."""
    values: list[object] = []
    while tokens[at] != stop:
        token = tokens[at]
        at += 1
        if token == "(":
            inner, at = _values(tokens, at, ")")
            values.append(inner)
        elif token == "{":
            block, at = _entries(tokens, at)
            values.append(block)
            at += 1
        elif token in ")};":
            raise IndexError
        else:
            values.append(token)
    return values, at + 1


def _vector(value: object) -> tuple[float, float, float] | None:
    """Three numbers, alone, in a list of one, or behind the word `constant`."""
    if isinstance(value, list) and value and value[0] in ("constant", "uniform"):
        value = value[1:]
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if not isinstance(value, list) or len(value) != 3:
        return None
    try:
        x, y, z = (float(part) for part in value)
    except (TypeError, ValueError):
        return None
    return (x, y, z)


def _found(
    block: object,
) -> Iterator[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Pairs of position and direction, in this block and those inside it."""
    if not isinstance(block, dict):
        return
    pairs = [(block.get("position"), block.get("direction"))]
    axes = block.get("positionAxis")
    if isinstance(axes, list) and len(axes) == 1 and isinstance(axes[0], list):
        pairs += [tuple(pair) for pair in axes[0] if isinstance(pair, list) and len(pair) == 2]
    for position, direction in pairs:
        there, along = _vector(position), _vector(direction)
        if there is not None and along is not None and any(along):
            yield there, along
    for inner in block.values():
        yield from _found(inner)
