"""List of every key of every file that users write, from the schemas, as Markdown.

python -m tests.bench scene_reference

The site appends it to docs/scene-reference.md (docs/site/hooks.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

from pydantic import BaseModel

from cldit.acquisition.measured import MeasuredFile
from cldit.acquisition.plan import Plan
from cldit.rig.load import RigFile
from cldit.scene import Scene
from cldit.scene.checks import Section as Keys
from cldit.show.page import Bullets, Section, markdown_of

# Heading, prefix of the keys at the top, and model that reads the file.
FILES: tuple[tuple[str, str, type[Keys]], ...] = (
    ("Scenes", "", Scene),
    ("Rig files", "rig.yaml ", RigFile),
    ("Plans", "plan.yaml ", Plan),
    ("Measured data", "measured.yaml ", MeasuredFile),
)
Schema = dict[str, Any]
UNLISTED = "No effect"  # keys of older versions, which are still read, with a remark


def reference() -> str:
    """Sections of all keys in Markdown."""
    shown: list[_Place] = []
    sections = [
        sections_of(model, title=title, file=file, shown=shown) for title, file, model in FILES
    ]
    return markdown_of(list(chain.from_iterable(sections)))


@dataclass(frozen=True)
class _Place:
    """A section: its path in the file, which of several kinds it is, and its schema."""

    path: str
    kind: str
    schema: Schema
    sibling: Schema | None = None  # the first of several kinds

    @property
    def heading(self) -> str:
        return f"{self.path} ({self.kind})" if self.kind else self.path

    @property
    def anchor(self) -> str:
        """Anchor that GitHub and mkdocs make from the heading."""
        letters = "".join(c for c in self.heading.lower() if c.isalnum() or c in "_- ")
        return "-".join(letters.split())


def sections_of(
    model: type[BaseModel], *, title: str, file: str, shown: list[_Place]
) -> list[Section]:
    """All sections of a file that `model` reads, without those `shown` for an earlier file.

    `file` prefixes their names.
    """
    schema = model.model_json_schema()
    places: dict[str, _Place] = {}
    for name, place in _walk(schema, schema, path="", prefix=file):
        same = (earlier for earlier in shown if earlier.schema == place.schema)
        places.setdefault(name, next(same, place))
    new = [place for place in places.values() if place not in shown]
    shown += new
    inner = [Section(place.heading, _content(place, places), level=3) for place in new]
    return [Section(title, [_text(schema), _keys(schema, places)]), *inner]


def _content(place: _Place, places: dict[str, _Place]) -> list[str | Bullets]:
    """Description and keys; keys of the first kind are named alone."""
    given = place.schema["properties"]
    first = place.sibling["properties"] if place.sibling is not None else {}
    same = [key for key, value in given.items() if first.get(key) == value]
    rest = {key: value for key, value in given.items() if key not in same and "const" not in value}
    content: list[str | Bullets] = [_text(place.schema)]
    if same:
        names = ", ".join(f"`{key}`" for key in same)
        content.append(f"As in {_first(place, places)}: {names}.")
    return [*content, _keys(place.schema | {"properties": rest}, places)] if rest else content


def _first(place: _Place, places: dict[str, _Place]) -> str:
    first = next(each for each in places.values() if each.schema is place.sibling)
    return f"[{first.kind}](#{first.anchor})"


def _text(schema: Schema) -> str:
    return " ".join(str(schema.get("description", "")).split())


def _walk(
    whole: Schema, section: Schema, *, path: str, prefix: str
) -> Iterator[tuple[str, _Place]]:
    """Name and place of each section in another, in the order of their keys."""
    for key, value in section.get("properties", {}).items():
        names = list(_references(value))
        for name in names:
            inner = whole["$defs"][name]
            here = f"{path}.{key}" if path else f"{prefix}{key}"
            many = "[]" if any("items" in part for part in _parts(value)) else ""
            kind = ""
            if len(names) > 1:
                model = inner["properties"].get("model", {}).get("const")
                kind = f"model: {model}" if model else ", ".join(inner["properties"])
            first = whole["$defs"][names[0]] if name != names[0] else None
            yield name, _Place(here + many, kind, inner, first)
            yield from _walk(whole, inner, path=here + many, prefix=prefix)


def _parts(schema: Schema) -> Iterator[Schema]:
    """The schema, or its alternatives."""
    choices = schema.get("anyOf", schema.get("oneOf"))
    if choices is None:
        yield schema
    else:
        for choice in choices:
            yield from _parts(choice)


def _references(schema: Schema) -> Iterator[str]:
    for part in _parts(schema):
        if "$ref" in part:
            yield part["$ref"].rpartition("/")[2]
        elif "items" in part:
            yield from _references(part["items"])


def _keys(section: Schema, places: dict[str, _Place]) -> Bullets:
    lines = []
    needed = section.get("required", [])
    for key, value in section.get("properties", {}).items():
        if _text(value).startswith(UNLISTED):
            continue
        default = "required" if key in needed else _default(value)
        kinds = dict.fromkeys(_type(part, places) for part in _parts(value))
        ranges = dict.fromkeys(text for part in _parts(value) for text in _ranges(part))
        if default == "null":
            del kinds["null"]
        if ranges and list(kinds) == ["number"]:
            kinds = {}
        about = _text(value) or " ".join(_text(places[n].schema) for n in _references(value))
        named = [" or ".join(kinds)] if kinds else []
        allowed = ", ".join([f"`{key}`", *named, *ranges])
        shown = f" ({default})" if default not in ("", "null", "[]") else ""
        lines.append(f"{allowed}{shown}: {about}")
    return Bullets(lines)


def _type(part: Schema, places: dict[str, _Place]) -> str:
    if "$ref" in part:
        place = places[part["$ref"].rpartition("/")[2]]
        return f"[{place.kind or 'section'}](#{place.anchor})"
    if "+z" in part.get("enum", ()):
        return "`-x` to `+z`"
    if "enum" in part:
        return ", ".join(f"`{value}`" for value in part["enum"])
    if "const" in part:
        return f"`{part['const']}`"
    if "prefixItems" in part:
        return f"{len(part['prefixItems'])} numbers"
    if part.get("type") == "array":
        inner = " or ".join(dict.fromkeys(_type(each, places) for each in _parts(part["items"])))
        return f"list of {inner}"
    if part.get("format") == "path":
        return "path"
    names = {"string": "text", "boolean": "true, false", "object": "keys and values"}
    return names.get(part["type"], str(part["type"]))


def _ranges(part: Schema) -> Iterator[str]:
    inner = [*part.get("prefixItems", []), *([part["items"]] if "items" in part else [])]
    for each in inner:
        for choice in _parts(each):
            yield from _ranges(choice)
    if "minimum" in part:
        yield f"{_plain(part['minimum'])}..{_plain(part['maximum'])}"
    elif "minLength" in part or "maxLength" in part:
        yield f"{part.get('minLength', 0)}..{part.get('maxLength', '')} characters"
    elif "pattern" in part:
        yield f"`{part['pattern']}`"


def _default(value: Schema) -> str:
    default = value.get("default")
    if isinstance(default, dict) and len(list(_references(value))) > 1:
        return "{" + ", ".join(f"{key}: {_plain(each)}" for key, each in default.items()) + "}"
    if isinstance(default, dict) or "default" not in value:
        return ""
    if default is None:
        return "null"
    if isinstance(default, list) and default and isinstance(default[0], dict):
        return f"{len(default)} of them"
    if isinstance(default, list):
        return "[" + ", ".join(_plain(each) for each in default) + "]"
    return _plain(default) if default != "" else "empty"


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def main() -> None:
    """Prints the list."""
    print(reference())
