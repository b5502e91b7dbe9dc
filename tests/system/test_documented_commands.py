"""Every `cldit` command in the README and the docs is one that there is, options and all."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from cldit.cli import main

_ROOT = Path(__file__).parents[2]
_SHELL = re.compile(r"^```(?:sh|bash|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def documented() -> list[tuple[str, str]]:
    """(page, command) of every line of a shell block that calls cldit."""
    found = []
    for page in [_ROOT / "README.md", *sorted((_ROOT / "docs").rglob("*.md"))]:
        for block in _SHELL.findall(page.read_text(encoding="utf-8")):
            lines = block.replace("\\\n", " ").splitlines()
            found += [
                (str(page.relative_to(_ROOT)), line.strip())
                for line in lines
                if re.match(r"\s*cldit\b", line)
            ]
    return found


def _parse(line: str) -> None:
    """As the command line would, without running; the files that it names need not be there."""
    words = shlex.split(line, comments=True)[1:]
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
        group.make_context(group.name, words, parent=context.parent)


def test_documented_commands_are_understood() -> None:
    wrong = []
    for page, line in documented():
        for single in line.split(" | "):
            if single.strip().startswith("cldit"):
                try:
                    _parse(single)
                except (click.UsageError, AssertionError) as error:
                    wrong.append(f"{page}: {single.strip()}: {error}")
    assert not wrong, "\n".join(wrong)


def test_commands_are_found_in_the_pages() -> None:
    pages = {page for page, _ in documented()}
    assert {"README.md", "docs/importing.md", "docs/optics.md", "docs/transport/method.md"} <= pages


@pytest.mark.parametrize("line", ["cldit rnu gdi", "cldit run gdi --acuracy 1", "cldit run"])
def test_a_wrong_one_is_noticed(line: str) -> None:
    with pytest.raises((click.UsageError, AssertionError)):
        _parse(line)
