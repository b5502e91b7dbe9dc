"""Every `cldit` command in the README and the docs exists, with its options, and Python is valid.

`test_walk.py` runs the pages, on the files that each begins with.
"""

from __future__ import annotations

import click
import pytest

from tests.system.documented import PAGES, parsed, steps

_COMMANDS = [(page, step.text) for page in PAGES for step in steps(page) if step.is_cldit]


def test_documented_commands_are_understood() -> None:
    wrong = []
    for page, line in _COMMANDS:
        try:
            parsed(line)
        except (click.UsageError, AssertionError) as error:
            wrong.append(f"{page}: {line}: {error}")
    assert not wrong, "\n".join(wrong)


def test_documented_python_is_understood() -> None:
    scripts = [(page, step) for page in PAGES for step in steps(page) if step.language == "python"]
    assert len(scripts) >= 20
    for page, step in scripts:
        compile(step.text, page, "exec")


def test_commands_are_found_in_the_pages() -> None:
    pages = {page for page, _ in _COMMANDS}
    assert {"README.md", "docs/importing.md", "docs/optics.md", "docs/transport/method.md"} <= pages
    assert len(_COMMANDS) > 75


@pytest.mark.parametrize("line", ["cldit rnu gdi", "cldit run gdi --acuracy 1", "cldit run"])
def test_a_wrong_one_is_noticed(line: str) -> None:
    with pytest.raises((click.UsageError, AssertionError)):
        parsed(line)
