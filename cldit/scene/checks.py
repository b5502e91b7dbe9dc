"""Base class and interval type of checked input, and messages that name what is allowed."""

import ast
import difflib
import inspect
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema

from cldit.errors import SceneError

Former = Mapping[str, tuple[Any, str]]


class Section(BaseModel):
    """Base of every section of a scene, rig or plan file: frozen, with unknown keys refused.

    The string below a key is its description in the reference and in editors (`descriptions`), read
    from the source when asked for. _scene_type: the type that contains all sections of a scene,
    which `cldit.scene.schema` sets. _former: keys of older versions, with the value that their runs
    store by themselves, and what to do in place of others.
    """

    _scene_type: ClassVar[type[BaseModel] | None] = None
    _former: ClassVar[Former] = {}

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=False,
        allow_inf_nan=False,
    )

    @model_validator(mode="before")
    @classmethod
    def _without_former(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        for key, (stored, advice) in cls._former.items():
            if data.get(key, stored) != stored:
                raise ValueError(f"{key}: no key of this version; {advice}")
        return {key: value for key, value in data.items() if key not in cls._former}

    def __setattr__(self, name: str, value: Any) -> None:
        raise SceneError(
            f"{name}: {type(self).__name__} does not change; make another: "
            + (self._replacement(name, value) or f'model_copy(update={{"{name}": {value!r}}})')
        )

    def __delattr__(self, name: str) -> None:
        raise SceneError(f"{name}: {type(self).__name__} does not change")

    def _replacement(self, name: str, value: Any) -> str:
        """Expression of another scene with this value; empty if this is no part of a scene."""
        path = None if self._scene_type is None else _path_of(type(self), self._scene_type)
        key = name if path == "" else f"{path}.{name}"
        return "" if path is None else f'scene.with_(**{{"{key}": {value!r}}})'

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """Values that are not the default."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if field.is_required() or value != field.get_default(call_default_factory=True):
                yield name, value

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        json_schema = handler(schema)
        properties = handler.resolve_ref_schema(json_schema)["properties"]
        for key, description in descriptions(cls).items():
            properties[key]["description"] = description
        return json_schema

    def __dir__(self) -> list[str]:
        """Keys and cldit's own methods, without those of pydantic."""
        methods = {name for kind in type(self).__mro__ for name in vars(kind)
               if issubclass(kind, Section) and not name.startswith(("_", "model_"))}  # fmt: skip
        return sorted(methods | set(type(self).model_fields))


@cache
def descriptions(section: type[BaseModel]) -> dict[str, str]:
    """Strings below the keys of a section, by key."""
    texts: dict[str, str] = {}
    for kind in reversed(section.__mro__[: section.__mro__.index(Section)]):
        (parsed,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
        assert isinstance(parsed, ast.ClassDef)
        for key, below in pairwise(parsed.body):
            match key, below:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(value))):
                    texts[name] = inspect.cleandoc(value)
    return texts


def _number(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else shortened(str(value))


def shortened(value: str) -> str:
    """A value for a message, cut to 80 characters."""
    return value if len(value) <= 80 else f"{value[:77]}..."


@dataclass(frozen=True)
class Within:
    """Closed interval; a number outside it is refused with `17 is outside 8..16`."""

    low: float
    high: float

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "minimum": self.low, "maximum": self.high}

    def _check(self, value: Any, inner: Any) -> Any:
        limits = {"low": _number(self.low), "high": _number(self.high)}
        if isinstance(value, (bool, str)):
            raise PydanticCustomError(
                "not_a_number",
                "{value} is not a number; allowed: {low}..{high} without a unit",
                {"value": repr(value), **limits},
            )
        # Other types are left to the inner validator, which names what is expected.
        if isinstance(value, (int, float)) and not self.low <= value <= self.high:
            raise PydanticCustomError(
                "outside", "{value} is outside {low}..{high}", {"value": _number(value), **limits}
            )
        return inner(value)


def length(low: int, high: int, items: str) -> AfterValidator:
    """Bounds of a list's length; another is refused with `0 plumes; allowed: 1..64`."""

    def check(values: tuple[Any, ...]) -> tuple[Any, ...]:
        if not low <= len(values) <= high:
            raise ValueError(f"{len(values)} {items}; allowed: {low}..{high}")
        return values

    return AfterValidator(check)


def _path_of(section: type[BaseModel], container: type[BaseModel]) -> str | None:
    """Path of a kind of section in another, as users write it; None if it is not in it."""
    if section is container:
        return ""
    for name, field in container.model_fields.items():
        for inner in _sections(field.annotation):
            path = _path_of(section, inner)
            if path is not None:
                item = "[0]" if isinstance(field.get_default(), tuple) else ""
                return f"{name}{item}.{path}".removesuffix(".")
    return None


def _walk(model: type[BaseModel], error: ErrorDetails) -> tuple[str, list[type[BaseModel]]]:
    """The error's path as users write it, and the sections in which it ends.

    Examples are `camera.pixels` for a component of a vector and `spray.plumes[2].mass_fraction`
    in a list of sections. The names that pydantic inserts for members of a union are removed.
    """
    parts: list[str] = []
    annotation: Any = model
    loc = [part for part in error["loc"] if not (isinstance(part, str) and "[" in part)]
    for index, part in enumerate(loc):
        sections = _sections(annotation)
        if isinstance(part, int):
            if index < len(loc) - 1:
                parts[-1] += f"[{part}]"
            continue
        field = next((s.model_fields[part] for s in sections if part in s.model_fields), None)
        member = [s for s in sections if part in (s.__name__, _tag(s))]
        last_key = index == len(loc) - 1 and error["type"] == "extra_forbidden"
        if field is None and member and not last_key:
            annotation = member[0]
            continue
        parts.append(part)
        if not last_key and field is not None:
            annotation = field.annotation
    return ".".join(parts), _sections(annotation)


def _tag(section: type[BaseModel]) -> str | None:
    field = section.model_fields.get("model")
    return None if field is None else str(field.default)


def _sections(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    sections: list[type[BaseModel]] = []
    for argument in getattr(annotation, "__args__", ()):
        sections += _sections(argument)
    return sections


_MOST_LINES = 50  # of a message: the suggestions for thousands of keys would take minutes
_KINDS = {
    "int": "is not a whole number",
    "float": "is not a number",
    "bool": "is not true or false",
    "string": "is not text",
    "path": "is not a path",
    "tuple": "is not a list; write [first, second, ..]",
    "list": "is not a list; write [first, second, ..]",
}


def _words(error: ErrorDetails, sections: Sequence[type[BaseModel]]) -> str:
    """The text of a pydantic error in terms of YAML."""
    kind, context = error["type"], error.get("ctx", {})
    shown = _shown(error["input"])
    if kind == "literal_error":
        return f"{shown} is unknown; allowed: {context['expected']}"
    if kind.endswith(("too_short", "too_long")):
        bound = context.get("min_length", context.get("max_length"))
        allowed = f"allowed: {'at least' if kind.endswith('short') else 'at most'} {bound}"
        if kind.startswith("string"):
            return f"{shown}; {allowed} letters"
        return f"has {context['actual_length']} values; {allowed}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        keys = ", ".join(dict.fromkeys(key for s in sections for key in s.model_fields))
        return (
            f"{shown} is no section; allowed: a section with the keys {keys}"
            if keys
            else (f"{shown} is no section of keys and values")
        )
    word = _KINDS.get(kind.partition("_")[0])
    return f"{shown}: {error['msg']}" if word is None else f"{shown} {word}"


def _shown(value: Any) -> str:
    """A value as Python writes it, shortened."""
    try:
        return shortened(repr(value))
    except ValueError:  # Python does not write a whole number of more than 4300 digits
        return "a number of more than 4300 digits"


def _nearest(path: str, keys: Sequence[str], model: type[BaseModel]) -> str:
    """A suggestion: the most similar key of the section, otherwise one of that name elsewhere."""
    name = path.rpartition(".")[2]
    close = difflib.get_close_matches(name, keys, n=1)
    if close:
        return f"; did you mean {close[0]}?"
    elsewhere = (
        [key_path for key_path in key_paths(model) if key_path != path] if len(name) > 2 else []
    )
    meant = [key_path for key_path in elsewhere if key_path.rpartition(".")[2] == name]
    if not meant:
        ends = {key_path.rpartition(".")[2] for key_path in elsewhere}
        for end in difflib.get_close_matches(name, sorted(ends), n=1, cutoff=0.75):
            meant = [key_path for key_path in elsewhere if key_path.rpartition(".")[2] == end]
    return f"; did you mean {' or '.join(meant[:3])}?" if meant else ""


def key_paths(model: type[BaseModel]) -> list[str]:
    """Paths of all keys below a section, in every member of a union and in the items of lists."""
    paths: list[str] = []
    for name, field in model.model_fields.items():
        paths.append(name)
        for section in _sections(field.annotation):
            paths += [f"{name}.{path}" for path in key_paths(section)]
    return list(dict.fromkeys(paths))


def describe(model: type[BaseModel], errors: Sequence[ErrorDetails]) -> str:
    """One line for each of the `errors` that `model` found: path, value and what is allowed."""
    lines: list[str] = []
    for error in errors[:_MOST_LINES]:
        path, sections = _walk(model, error)
        if error["type"] == "extra_forbidden":
            keys = list(dict.fromkeys(key for s in sections for key in s.model_fields))
            message = f"unknown key{_nearest(path, keys, model)}; allowed: {', '.join(keys)}"
        elif error["type"] == "missing":
            message = "a value is missing" if isinstance(error["loc"][-1], int) else "is missing"
        elif error["type"] in ("union_tag_invalid", "union_tag_not_found"):
            kinds = ", ".join(tag for tag in map(_tag, sections) if tag is not None)
            path += ".model"
            unknown_tag = error.get("ctx", {}).get("tag")
            message = "is missing" if unknown_tag is None else f"{unknown_tag} is unknown"
            message += f"; allowed: {kinds}"
        elif error["type"] in ("outside", "not_a_number", "not_allowed"):
            message = error["msg"]
        elif error["type"] == "value_error":
            message = error["msg"].removeprefix("Value error, ")
        else:
            message = _words(error, sections)
        lines.append(f"{shortened(path)}: {message}" if path else message)
    remaining = len(errors) - _MOST_LINES
    return "\n".join(
        [*dict.fromkeys(lines), *([f"and {remaining} errors more"] if remaining > 0 else [])]
    )
