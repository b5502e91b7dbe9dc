"""Each command imports what it uses and nothing that is slow besides."""

from __future__ import annotations

import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from cldit import __version__
from cldit.cli import main
from cldit.cli.program import LazyGroup

SLOW = {"matplotlib", "scipy", "pyopencl", "CoolProp", "vtk"}


@pytest.mark.parametrize(
    ("words", "allowed"),
    [
        (["--help"], set()),
        (["bench", "--help"], set()),
        (["scenes"], set()),
        (["acquire", "--help"], set()),
    ],
    ids=lambda part: " ".join(part) if isinstance(part, list) else "may",
)
def test_only_what_a_command_uses(words: list[str], allowed: set[str]) -> None:
    code = (
        "import sys; from cldit.cli import main; "
        f"main({words!r}, standalone_mode=False); "
        f"print(*sorted({SLOW!r} & set(sys.modules)), sep=',', file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stderr.strip().split(",")) - {""} <= allowed


def test_modules_of_a_run_load_no_package_that_few_runs_use() -> None:
    """SciPy's packages are loaded by the calls of their functions."""
    code = (
        "import sys, cldit.cli.run; "
        "print(*(name for name in sys.modules if name.startswith(('scipy.', 'matplotlib'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[1] for name in done.stdout.split() if "." in name}
    assert not loaded & {"special", "ndimage", "linalg", "optimize", "interpolate", "spatial"}
    assert "matplotlib" not in done.stdout


def test_help_says_what_click_would() -> None:
    """Texts that are read from the sources are those of the commands, here of those soon loaded.

    On wide lines, where click cuts nothing.
    """
    quick = {name: main.commands_at[name] for name in ("scenes", "devices", "export", "study")}
    group = LazyGroup(commands_at=quick)
    context = click.Context(group, info_name="cldit", terminal_width=400, max_content_width=400)
    ours, theirs = (context.make_formatter() for _ in range(2))
    group.format_commands(context, ours)
    click.Group.format_commands(group, context, theirs)
    assert ours.getvalue() == theirs.getvalue() != ""


def test_python_m_cldit_is_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "cldit", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == CliRunner().invoke(main, ["--version"], prog_name="cldit").stdout
    assert done.stdout == f"cldit, version {__version__}\n"
