"""The program `cldit`, run in the tests' process."""

from __future__ import annotations

from click.testing import CliRunner, Result

from cldit.cli import main


def command(*words: object, status: int = 0) -> Result:
    """Result of a command line, whose exit status is as expected."""
    done = CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == status, done.output + done.stderr
    return done
