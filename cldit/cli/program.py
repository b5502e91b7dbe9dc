"""The program around the commands: its streams, and how it ends where they take nothing."""

from __future__ import annotations

import sys
from typing import Any

from cldit.cli.exit_codes import Exit
from cldit.cli.lazy import LazyGroup
from cldit.errors import ClditError
from cldit.io.terminal import cannot_take, prepare_streams, silence, warn


class Program(LazyGroup):
    """The outermost group."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Runs the command line as click does; ends with 1 where its output cannot be written.

        A pipe whose reader has gone ends it without a word, as click does it.

        Args:
            args, kwargs: click's.
        """
        prepare_streams()
        try:
            try:
                return super().main(*args, **kwargs)
            finally:
                if sys.stdout is not None:
                    sys.stdout.flush()
        except ClditError as error:  # of a command that could not even be loaded
            warn(f"error: {error}")
            sys.exit(Exit.FAILED)
        except OSError as error:
            problem = cannot_take(sys.stdout) or cannot_take(sys.stderr)
            if problem is None or error.filename is not None:
                raise
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and cannot_take(stream):
                silence(stream)
        warn(f"error: the output cannot be written ({problem.strerror}); what is computed stays")
        sys.exit(Exit.FAILED)
