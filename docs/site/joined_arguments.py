"""griffe extension: `a, b: text` under Args stands for an entry of a and one of b."""

from __future__ import annotations

import re
from typing import Any

import griffe

_SECTION = re.compile(r"^( *)Args:\n((?:\1 +\S.*\n?|\n)+)", re.MULTILINE)
_JOINED = re.compile(r"^( +)(\w+(?:, \w+)+)(:.*\n?(?:\1 +\S.*\n?)*)", re.MULTILINE)


def apart(docstring: str) -> str:
    """The docstring with an entry for each argument."""

    def entries(found: re.Match[str]) -> str:
        indent, names, text = found.groups()
        return "\n".join(f"{indent}{name}{text.rstrip()}" for name in names.split(", ")) + "\n"

    def section(found: re.Match[str]) -> str:
        return f"{found[1]}Args:\n{_JOINED.sub(entries, found[2])}"

    return _SECTION.sub(section, docstring)


class JoinedArguments(griffe.Extension):
    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = apart(obj.docstring.value)
