"""A group whose commands are imported when asked for, so that each pays for what it uses alone."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem


class LazyGroup(click.Group):
    """`commands_at`: command -> `package.module:name`, in the order in which help lists them."""

    def __init__(self, *args: Any, commands_at: Mapping[str, str], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.commands_at = dict(commands_at)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, none imported."""
        return list(self.commands_at)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Imports the command `cmd_name`, if there is one; `ctx` is click's."""
        if cmd_name not in self.commands_at:
            return None
        module, _, name = self.commands_at[cmd_name].partition(":")
        command = getattr(import_module(module), name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes commands from `ctx` to `formatter`, by docstrings in the sources: importing all
        of them takes seconds. Sentences are wrapped, where click would cut them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self._sentence(name)) for name in self.commands_at])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Commands and options of `ctx` that begin with `incomplete`, no command imported."""
        names = [name for name in self.commands_at if name.startswith(incomplete)]
        found = [CompletionItem(name, help=self._sentence(name)) for name in names]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def _sentence(self, name: str) -> str:
        """The first of a command's help."""
        return click.Command(name, help=_docstring(self.commands_at[name])).get_short_help_str(999)


def _docstring(at: str) -> str:
    """Of the function at `package.module:name`, without importing the module."""
    module, _, name = at.partition(":")
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None, module
    for node in ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            return ast.get_docstring(node) or ""
    raise LookupError(f"{at}: no such function")
