"""The program around the commands: exit status, commands loaded on demand, streams."""

import ast
import sys
from collections.abc import Mapping
from enum import IntEnum
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from cldit.errors import ClditError
from cldit.io.terminal import cannot_take, prepare_streams, silence, warn


class Exit(IntEnum):
    """The exit status of `cldit`."""

    DONE = 0
    FAILED = 1
    USAGE = 2  # click's
    DIFFERS = 3
    STOPPED = 130  # of shells for Ctrl-C

    @property
    def text(self) -> str:
        """Meaning on one line."""
        return _TEXT[self]


_TEXT = {
    Exit.DONE: "done",
    Exit.FAILED: "refused or failed; the standard error gives the reason",
    Exit.USAGE: "invalid command line",
    Exit.DIFFERS: "compare, repeat: beyond the errors; plan --separate: no plan is enough",
    Exit.STOPPED: "stopped by Ctrl-C",
}


def epilog() -> str:
    """Exit codes for the end of `cldit --help`; `\\b` keeps click from joining the lines."""
    lines = [f"  {code.value:<4d}{code.text}" for code in Exit]
    return "\n".join(["\b", "Exit status:", *lines])


class LazyGroup(click.Group):
    """Group whose commands are imported on demand, so that each loads only what it uses.

    commands_at: `package.module:name` by command, in the order of the help.
    """

    def __init__(self, *args: Any, commands_at: Mapping[str, str], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.commands_at = dict(commands_at)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, without importing them."""
        return list(self.commands_at)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Imports the command `cmd_name` if there is one."""
        if cmd_name not in self.commands_at:
            return None
        module, _, name = self.commands_at[cmd_name].partition(":")
        command = getattr(import_module(module), name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the commands by the docstrings in their sources; importing all takes seconds.

        Sentences are wrapped; click would cut them.
        """
        with formatter.section("Commands"):
            formatter.write_dl([(name, self._sentence(name)) for name in self.commands_at])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Commands and options that begin with `incomplete`, without importing a command."""
        names = [name for name in self.commands_at if name.startswith(incomplete)]
        items = [CompletionItem(name, help=self._sentence(name)) for name in names]
        return items + click.Command.shell_complete(self, ctx, incomplete)

    def _sentence(self, name: str) -> str:
        """First sentence of a command's help."""
        return click.Command(name, help=_docstring(self.commands_at[name])).get_short_help_str(999)


def _docstring(at: str) -> str:
    """Docstring of the function at `package.module:name`, without importing the module."""
    module, _, name = at.partition(":")
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None, module
    for node in ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            return ast.get_docstring(node) or ""
    raise LookupError(f"{at}: no such function")


class Program(LazyGroup):
    """The outermost group."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Runs the command line as click does; ends with 1 if its output cannot be written.

        A pipe whose reader has gone ends it without a message, as in click.
        """
        prepare_streams()
        try:
            try:
                return super().main(*args, **kwargs)
            finally:
                if sys.stdout is not None:
                    sys.stdout.flush()
        except ClditError as error:  # of a command that could not be loaded
            warn(f"error: {error}")
            sys.exit(Exit.FAILED)
        except OSError as error:
            problem = cannot_take(sys.stdout) or cannot_take(sys.stderr)
            if problem is None or error.filename is not None:
                raise
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and cannot_take(stream):
                silence(stream)
        warn(f"error: the output cannot be written ({problem.strerror}); computed results are kept")
        sys.exit(Exit.FAILED)
