"""Scenes as YAML to edit: keys that are set, and all others as comments."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from cldit.io.plain_data import yaml_line
from cldit.scene.checks import descriptions
from cldit.scene.schema import Scene

_STEP = "  "


def commented(scene: Scene) -> str:
    """YAML of a scene with the meaning of every key; keys that are not set are comments.

    `parse_scene` reads the same scene back.
    """
    head = (
        f"# {scene.name}, to edit. Lines that start with # are defaults; to set one, remove its #",
        "# and that of its section.",
    )
    return "\n".join([*head, *_section(scene, indent="", comment=False)]) + "\n"


def _section(section: BaseModel, *, indent: str, comment: bool) -> list[str]:
    lines: list[str] = []
    plain = section.model_dump(mode="json")
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        unset = comment or name not in section.model_fields_set
        if value == field.default and not field.is_required() and name != "model":
            unset = True
        start = ("# " if unset else "") + indent
        about = " ".join(descriptions(type(section)).get(name, "").split())
        about = f"  # {about}" if about else ""
        if isinstance(value, BaseModel):
            lines.append(f"{start}{name}:{about}")
            lines += _section(value, indent=indent + _STEP, comment=unset)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            lines.append(f"{start}{name}:{about}")
            for item in value:
                line = yaml_line(item.model_dump(mode="json", exclude_unset=True))
                lines.append(f"{start}{_STEP}- {line}")
        else:
            lines.append(f"{start}{_entry(name, plain[name])}{about}")
    return lines


def _entry(name: str, value: Any) -> str:
    if isinstance(value, Mapping | list):
        return f"{name}: {yaml_line(value)}"
    return yaml_line({name: value})[1:-1]
