"""Plain data (mappings, lists, numbers, texts) from YAML and JSON: the one loader of each.

What YAML allows and a user of cldit never means is refused with its line: a key that stands there
twice, tags, numbers in octal or in sixties, aliases that grow without bound or hold themselves.
A date is text.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml

from cldit.errors import ClditError, FileError, RunFolderError, SceneError
from cldit.io.files import read_text

try:  # the same in C, ten times as fast, where PyYAML has it
    from yaml import CSafeLoader as SafeLoader
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]

_MOST_DEPTH = 100  # of lists and mappings in each other; no file of cldit's needs ten
_MOST_ALIASED = 100_000  # values that aliases repeat, all in all
_TAGS = frozenset(
    f"tag:yaml.org,2002:{name}"
    for name in ("str", "int", "float", "bool", "null", "seq", "map", "merge")
)
_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
_MERGE, _TIMESTAMP = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:timestamp"
_OCTAL = re.compile(r"[-+]?0[0-9_]+")


class _Loader(SafeLoader):
    """Builds nothing but plain data, and no key twice."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if node.tag not in _TAGS:
            raise _refused(node.start_mark, f"the tag {node.tag!r} is not allowed")
        text = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
        if node.tag in (_INT, _FLOAT) and ":" in text:
            raise _refused(node.start_mark, f"{text} is a number in sixties to YAML; quote a text")
        if node.tag == _INT and _OCTAL.fullmatch(text):
            raise _refused(
                node.start_mark, f"{text} is octal to YAML; write it without the leading 0"
            )
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, KeyError, AttributeError, OverflowError) as error:
            kind = node.tag.rpartition(":")[2]
            raise _refused(node.start_mark, f"{_short(text)} is no {kind}") from error

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[Any, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # refused further on: it cannot be a key
            name = _MERGE if key.tag == _MERGE else self.construct_object(key)
            if name in lines:
                raise _refused(
                    key.start_mark,
                    f"the key {key.value!r} stands there twice, first in line {lines[name]}",
                )
            lines[name] = key.start_mark.line + 1
        return super().construct_mapping(node, deep=deep)


# A date would become an object that no key of ours takes, or an error: it is text.
_Loader.yaml_implicit_resolvers = {
    first: [each for each in resolvers if each[0] != _TIMESTAMP]
    for first, resolvers in SafeLoader.yaml_implicit_resolvers.items()
}


def parse_yaml(text: str, *, source: str, error: type[ClditError] = SceneError) -> Any:
    """What a YAML text holds.

    Args:
        text: one document.
        source: what messages call it.
        error: class of the errors.

    Raises:
        ClditError: of class `error`; names source, line, and what is wrong.
    """
    try:
        _check_events(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as found:
        mark = found.problem_mark or found.context_mark
        where = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        what = found.problem or found.context
        raise error(f"{source}: is not valid YAML ({where}{what})") from found
    except yaml.YAMLError as found:
        what = str(found).replace("\n", " ")
        raise error(f"{source}: is not valid YAML ({what})") from found


def dump_yaml(data: Any) -> str:
    """Plain data as YAML, keys in their order; `parse_yaml` reads it back."""
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def yaml_line(data: Any) -> str:
    """Plain data as YAML on one line, however long."""
    return yaml.safe_dump(
        data, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6
    ).strip()


def read_yaml(path: Path, *, error: type[ClditError] = SceneError) -> Any:
    """What a YAML file holds; raises `error` as `parse_yaml`, and for a file that cannot be read.

    Args:
        path: a regular file in UTF-8.
        error: class of the errors.
    """
    try:
        text = read_text(path)
    except FileError as found:
        raise error(str(found)) from found
    return parse_yaml(text, source=str(path), error=error)


def read_mapping(path: Path, *, error: type[ClditError] = SceneError) -> dict[str, Any]:
    """The mapping in a YAML file.

    Args:
        path, error: as in `read_yaml`.

    Returns:
        Keys and values.

    Raises:
        ClditError: of class `error`: the file is missing, unreadable, not YAML, or not a mapping.
    """
    data = read_yaml(path, error=error)
    if not isinstance(data, dict):
        raise error(f"{path}: holds {type(data).__name__}, expected keys and values")
    return data


def read_json(path: Path, *, error: type[ClditError] = RunFolderError) -> dict[str, Any]:
    """The object in a JSON file.

    Args:
        path: a regular file in UTF-8.
        error: class of the errors.

    Returns:
        Keys and values.

    Raises:
        ClditError: of class `error`: missing, unreadable, no JSON, a key twice, or no object.
    """
    try:
        text = read_text(path)
    except FileError as found:
        raise error(str(found)) from found
    try:
        data = parse_json(text)
    except ValueError as found:
        raise error(f"{path}: is damaged ({found})") from found
    if not isinstance(data, dict):
        raise error(f"{path}: is damaged (holds {type(data).__name__}, expected an object)")
    return data


def parse_json(text: str | bytes) -> Any:
    """What a JSON text holds; raises ValueError, also for a key that stands there twice."""
    try:
        return json.loads(text, object_pairs_hook=_once)
    except RecursionError as error:
        raise ValueError("lists or objects lie too deep in each other") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r} stands there twice")
    return data


def _refused(mark: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _check_events(text: str) -> None:
    """Refuses what would take the reader's stack or memory, before anything is built.

    Sizes are counted in values, those behind an alias as often as they are repeated.
    """
    sizes: dict[str | None, int] = {}
    within: list[tuple[str | None, int]] = [(None, 0)]  # anchor and size of what is open
    aliased = 0
    for event in yaml.parse(text, Loader=SafeLoader):
        anchor = getattr(event, "anchor", None)
        size = 1
        match event:
            case yaml.AliasEvent():
                if any(anchor == name for name, _ in within):
                    raise _refused(event.start_mark, f"*{anchor} stands within itself")
                size = sizes.get(anchor, 1)  # an unknown one is refused as it is composed
                aliased += size
                if aliased > _MOST_ALIASED:
                    raise _refused(
                        event.start_mark, f"aliases repeat more than {_MOST_ALIASED} values"
                    )
            case yaml.ScalarEvent():
                if "\0" in event.value:
                    raise _refused(event.start_mark, "a text holds a NUL byte")
                if anchor is not None:
                    sizes[anchor] = size
            case yaml.CollectionStartEvent():
                within.append((anchor, 0))
                if len(within) > _MOST_DEPTH:
                    raise _refused(
                        event.start_mark, f"values lie deeper than {_MOST_DEPTH} in each other"
                    )
                continue
            case yaml.CollectionEndEvent():
                name, inside = within.pop()
                size = inside + 1
                if name is not None:
                    sizes[name] = size
            case _:
                continue
        within[-1] = (within[-1][0], within[-1][1] + size)
