"""Plain data (mappings, lists, numbers, texts) from YAML and JSON.

YAML that a user of cldit never means is refused with its line: duplicate keys, tags, octal or
sexagesimal numbers, aliases that grow without bound or contain themselves. A date is text.
"""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from cldit.errors import ClditError, FileError, RunFolderError, SceneError
from cldit.io.files import read_text

try:  # the same in C, ten times as fast, if PyYAML has it
    from yaml import CSafeLoader as SafeLoader
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]

_MOST_DEPTH = 100  # of nested lists and mappings; no file of cldit needs ten
_MOST_ALIASED = 100_000  # values that aliases repeat: some 10 MB, at 100 bytes of Python each
_TAGS = frozenset(
    f"tag:yaml.org,2002:{name}"
    for name in ("str", "int", "float", "bool", "null", "seq", "map", "merge")
)
_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
_MERGE, _TIMESTAMP = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:timestamp"
_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
_OCTAL = re.compile(r"[-+]?0[0-9_]+")


class _Loader(SafeLoader):
    """Loader of plain data without duplicate keys."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if node.tag not in _TAGS:
            raise _refused(node.start_mark, f"the tag {node.tag!r} is not allowed")
        scalar = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
        if node.tag in (_INT, _FLOAT) and ":" in scalar:
            raise _refused(
                node.start_mark, f"{scalar} is a sexagesimal number in YAML; quote a text"
            )
        if node.tag == _INT and _OCTAL.fullmatch(scalar):
            raise _refused(
                node.start_mark, f"{scalar} is octal in YAML; write it without the leading 0"
            )
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, KeyError, AttributeError, OverflowError) as error:
            kind = node.tag.rpartition(":")[2]
            short = scalar if len(scalar) <= 40 else f"{scalar[:37]}..."
            raise _refused(node.start_mark, f"{short} is no {kind}") from error

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[Any, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # refused later: it cannot be a key
            name = _MERGE if key.tag == _MERGE else self.construct_object(key)
            if name in lines:
                raise _refused(
                    key.start_mark,
                    f"duplicate key {key.value!r}, first in line {lines[name]}",
                )
            lines[name] = key.start_mark.line + 1
        return super().construct_mapping(node, deep=deep)


class _Dumper(yaml.SafeDumper):
    """Writer that quotes texts which the loader would read as numbers."""


# A date would become an object that no key accepts, or an error: it is text.
_Loader.yaml_implicit_resolvers = {
    letter: [resolver for resolver in resolvers if resolver[0] != _TIMESTAMP]
    for letter, resolvers in SafeLoader.yaml_implicit_resolvers.items()
}
for _kind in (_Loader, _Dumper):  # numbers as in YAML 1.2: 4e-3 and 1.0e6 are text in 1.1
    _kind.add_implicit_resolver(_FLOAT, _EXPONENT, list("-+.0123456789"))


def parse_yaml(document: str, *, source: str, error: type[ClditError] = SceneError) -> Any:
    """Data of a YAML text; an `error` names the `source`, the line and the fault."""
    try:
        _check_events(document)
        return yaml.load(document, Loader=_Loader)
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        where = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        problem = fault.problem or fault.context
        raise error(f"{source}: is not valid YAML ({where}{problem})") from fault
    except yaml.YAMLError as fault:
        problem = str(fault).replace("\n", " ")
        raise error(f"{source}: is not valid YAML ({problem})") from fault


def dump_yaml(data: Any) -> str:
    """Plain data as YAML, keys in their order; `parse_yaml` reads it."""
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True))


def yaml_line(data: Any) -> str:
    """Plain data as YAML on one line of any length."""
    style: dict[str, Any] = {"default_flow_style": True, "sort_keys": False, "width": 10**6}
    return str(yaml.dump(data, Dumper=_Dumper, allow_unicode=True, **style)).strip()


def yaml_value(value: Any) -> str:
    """Plain data as YAML on one line, as it may follow a key."""
    return yaml_line([value])[1:-1]


def read_yaml(path: Path, *, error: type[ClditError] = SceneError) -> Any:
    """Data of a YAML file; raises `error` as `parse_yaml`, or if it cannot be read."""
    try:
        document = read_text(path)
    except FileError as fault:
        raise error(str(fault)) from fault
    return parse_yaml(document, source=str(path), error=error)


def read_mapping(path: Path, *, error: type[ClditError] = SceneError) -> dict[str, Any]:
    """Mapping of a YAML file; raises `error` as `read_yaml`, or if it is not a mapping."""
    data = read_yaml(path, error=error)
    if not isinstance(data, dict):
        raise error(f"{path}: contains {type(data).__name__}, expected keys and values")
    return data


def read_json(path: Path, *, error: type[ClditError] = RunFolderError) -> dict[str, Any]:
    """Object of a JSON file; raises `error` if it is unreadable, invalid, or not an object."""
    try:
        document = read_text(path)
    except FileError as fault:
        raise error(str(fault)) from fault
    try:
        data = parse_json(document)
    except ValueError as fault:
        raise error(f"{path}: is damaged ({fault})") from fault
    if not isinstance(data, dict):
        raise error(f"{path}: is damaged (contains {type(data).__name__}, expected an object)")
    return data


def parse_json(document: str | bytes) -> Any:
    """Data of a JSON text; ValueError if it is invalid or has a duplicate key."""
    try:
        return json.loads(document, object_pairs_hook=_once)
    except RecursionError as error:
        raise ValueError("lists or objects are nested too deep") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"duplicate key {twice!r}")
    return data


def _refused(mark: Any, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _check_events(document: str) -> None:
    """Refuses texts that would exhaust stack or memory, before anything is built.

    Sizes are counted in values, those of an alias as often as they are repeated.
    """
    sizes: dict[str | None, int] = {}
    within: list[tuple[str | None, int]] = [(None, 0)]  # anchor and size of what is open
    aliased = 0
    for event in yaml.parse(document, Loader=SafeLoader):
        anchor = getattr(event, "anchor", None)
        size = 1
        match event:
            case yaml.AliasEvent():
                if any(anchor == name for name, _ in within):
                    raise _refused(event.start_mark, f"*{anchor} contains itself")
                size = sizes.get(anchor, 1)  # an unknown one is refused by the composer
                aliased += size
                if aliased > _MOST_ALIASED:
                    raise _refused(
                        event.start_mark, f"aliases repeat more than {_MOST_ALIASED} values"
                    )
            case yaml.ScalarEvent():
                if "\0" in event.value:
                    raise _refused(event.start_mark, "a text contains a NUL byte")
                if anchor is not None:
                    sizes[anchor] = size
            case yaml.CollectionStartEvent():
                within.append((anchor, 0))
                if len(within) > _MOST_DEPTH:
                    raise _refused(event.start_mark, f"values are nested deeper than {_MOST_DEPTH}")
                continue
            case yaml.CollectionEndEvent():
                name, inside = within.pop()
                size = inside + 1
                if name is not None:
                    sizes[name] = size
            case _:
                continue
        within[-1] = (within[-1][0], within[-1][1] + size)
