"""Commands and scripts of the README and the docs, page by page, and what each page begins with."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import click
import pytest

from cldit.cli import main

ROOT = Path(__file__).parents[2]
PAGES = ["README.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_EXTRAS = re.compile(r'pip\s+install\s+"[^"\[]*\[([\w,]+)\]"|`cldit\[(\w+)\]`')

BEGIN: dict[str, tuple[str, ...]] = {
    "README.md": ("path/to/case",),
    "docs/benchmarks/index.md": ("my.yaml",),
    "docs/dit.md": ("runs/gdi", "measurements/july"),
    "docs/importing.md": ("CASE",),
    "docs/injections.md": ("scene.yaml", "shots"),
    "docs/rig.md": ("rig.yaml", "plan.yaml"),
    "docs/scattering.md": ("runs/gdi",),
    "docs/sharing.md": ("runs/gdi",),
    "docs/telling-models-apart.md": ("a.yaml", "b.yaml", "rig.yaml", "unknowns.yaml"),
    "docs/ten-things.md": ("measurements/july",),
    "docs/view.md": ("runs/gdi",),
}
"""Files and folders of the reader that a page assumes; all others are made on the page."""


@dataclass(frozen=True)
class Step:
    """A command of the shell, without its comment, or a block of Python."""

    language: str
    text: str

    @property
    def is_cldit(self) -> bool:
        return self.language == "sh" and self.text.startswith("cldit ")


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def steps(page: str) -> list[Step]:
    """Commands and scripts of a page, in order."""
    made = []
    for language, text in _BLOCK.findall(text_of(page)):
        lines = [text]
        if language == "sh":
            lines = [_bare(line) for line in text.replace("\\\n", " ").splitlines()]
        made += [Step(language, line) for line in lines if line]
    return made


def _bare(line: str) -> str:
    return re.sub(r"(^|\s)#.*", "", line).strip()


def extras(page: str) -> frozenset[str]:
    """Extras of README's installation, and those that the page names."""
    named = {name for pair in _EXTRAS.findall(text_of(page)) for part in pair if part
             for name in part.split(",")}  # fmt: skip
    return frozenset(named | {"pocl"})


def parsed(text: str) -> click.Context:
    """Context of a command that is parsed, not run; the files that it names need not exist."""
    words = shlex.split(text)[1:]
    group: click.Command = main
    context = click.Context(main, info_name="cldit")
    while isinstance(group, click.Group) and not (
        group.invoke_without_command and (not words or words[0].startswith("-"))
    ):
        name = words.pop(0)
        command = group.get_command(context, name)
        assert command is not None, f"no command {name}"
        context = click.Context(command, info_name=name, parent=context)
        group = command
    with pytest.MonkeyPatch.context() as patch:
        for part in group.params:
            if isinstance(part.type, click.Path):
                patch.setattr(part.type, "exists", False)
        return group.make_context(group.name, words, parent=context.parent)
