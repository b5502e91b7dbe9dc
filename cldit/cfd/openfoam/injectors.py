"""Injectors of an OpenFOAM case: `position` and `direction` entries of its cloud dictionary."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cldit.cfd.case import Injector
from cldit.cfd.inputs import content
from cldit.cfd.openfoam.file import find_foam, open_foam
from cldit.errors import SprayError
from cldit.io.files import MOST_TEXT_BYTES

# a comment that is not closed ends with the text, so that each place is read once
_SKIP = re.compile(r"/\*(?>.*?\*/|.*)|//[^\n]*+|^[^\S\n]*+#[^\n]*+", re.DOTALL | re.MULTILINE)
_TOKEN = re.compile(r'"[^"]*"|[{}();]|[^\s{}();"]+')


def read_injectors(path: Path) -> tuple[Injector, ...]:
    """Injectors of the dictionary that state a fixed position and direction.

    Supported: `position (x y z); direction (x y z);`, also with the word `constant` before the
    vector, and `positionAxis ( ((x y z) (x y z)) .. );`. Directives and macros are not expanded: an
    injector that needs them is ignored.
    """
    text = _file_content(path).decode("latin-1")
    try:
        entries = dictionary(text)
    except IndexError as error:
        way = "set spray.nozzle_m and spray.axis instead"
        raise SprayError(f"{path}: brackets do not match; {way}") from error
    pairs = _positions_and_directions(entries.get("subModels", entries))
    return tuple(Injector(str(path), np.array(place), np.array(along)) for place, along in pairs)


def case_injectors(
    case: Path, cloud: str | None, region: str = ""
) -> tuple[tuple[Injector, ...], tuple[Path, ...]]:
    """Injectors from the cloud's dictionary, else from the only one with any; and its file."""
    if cloud is None:
        return (), ()
    folder = case / "constant" / region
    if region and not any(folder.glob("*[pP]roperties*")):
        folder = case / "constant"
    properties = folder / f"{cloud}Properties"
    candidates = [properties] if find_foam(properties) else sorted(folder.glob("*[pP]roperties*"))
    files = [existing for file in candidates if (existing := find_foam(file)) is not None]
    by_file = {
        file: read_injectors(file) for file in files if b"injectionModel" in _file_content(file)
    }
    return (next(iter(by_file.values())), tuple(by_file)) if len(by_file) == 1 else ((), ())


def _file_content(path: Path) -> bytes:
    with open_foam(path) as stream:
        data = content(stream, path, MOST_TEXT_BYTES + 1)
    if len(data) > MOST_TEXT_BYTES:
        raise SprayError(f"{path}: is larger than {MOST_TEXT_BYTES / 1e6:g} MB: no dictionary")
    return data


def dictionary_blocks(path: Path, body: bytes) -> dict[str, dict[str, str]]:
    """Dictionaries in a list by name, `2 ( walls { type wall; } .. )`: entries of one word."""
    _, _, inside = _SKIP.sub(" ", body.decode("latin-1")).partition("(")
    try:
        blocks = dictionary(inside[: inside.rindex(")")])
    except (IndexError, ValueError) as error:
        raise SprayError(f"{path}: brackets do not match") from error
    return {
        name: {k: str(v[0]) for k, v in block.items() if isinstance(v, list) and len(v) == 1}
        for name, block in blocks.items()
        if isinstance(block, dict)
    }


_CLOSED = {"(": ")", "{": "}"}


def dictionary(text: str) -> dict[str, object]:
    """Entries of a dictionary without its own braces, words in lists, inner ones as mappings.

    An `IndexError` means that brackets do not match.
    """
    stack: list[tuple[str, list[object]]] = [("", [])]
    for token in _TOKEN.findall(_SKIP.sub(" ", text)):
        if token in _CLOSED:
            stack.append((token, []))
        elif token in "({)}" or (token == ";" and stack[-1][0] == "("):
            opened, inside = stack.pop()
            if _CLOSED.get(opened) != token:
                raise IndexError
            stack[-1][1].append(_entries(inside) if token == "}" else inside)
        else:
            stack[-1][1].append(token)
    if len(stack) > 1:
        raise IndexError
    return _entries(stack[0][1])


def _entries(items: list[object]) -> dict[str, object]:
    """Mapping of `key value .. ;` and `key { .. }`."""
    mapping: dict[str, object] = {}
    words: list[object] = []
    for item in items:
        if item == ";" or (isinstance(item, dict) and len(words) == 1):
            if words:
                mapping[str(words[0])] = item if item != ";" else words[1:]
            words = []
        else:
            words.append(item)
    if words:
        raise IndexError
    return mapping


def _vector(value: object) -> tuple[float, float, float] | None:
    """Three numbers, alone, in a list of one, or after the word `constant`."""
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


def _positions_and_directions(
    block: object,
) -> Iterator[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Pairs of position and direction, in this block and those inside it, in order."""
    blocks = [block]
    while blocks:
        if not isinstance(inner := blocks.pop(), dict):
            continue
        pairs = [(inner.get("position"), inner.get("direction"))]
        axes = inner.get("positionAxis")
        if isinstance(axes, list) and len(axes) == 1 and isinstance(axes[0], list):
            pairs += [tuple(pair) for pair in axes[0] if isinstance(pair, list) and len(pair) == 2]
        for position, direction in pairs:
            place, along = _vector(position), _vector(direction)
            if place is not None and along is not None and any(along):
                yield place, along
        blocks += reversed(inner.values())
