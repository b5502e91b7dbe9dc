"""What is printed arrives in any locale; an output that takes nothing ends the command in words."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

_C = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
_SAY = (
    "import click; from cldit.cli.program import Program; from cldit.cli.console import OUT\n"
    "from cldit.io.terminal import tell\n"
    "@click.group(cls=Program, commands_at={'x': '__main__:x'})\n"
    "def main(): pass\n"
    "@click.command()\n"
    "def x():\n"
    "    OUT.print('10\\u00b2 \\u00b5m \\u2192 \\u00e9 \\u4f60 \\udcff')\n"
    "    tell('\\u00b2')\n"
    "main(['x'])"
)
full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")


def cldit(words: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A line of the shell in which CLDIT is the command."""
    line = words.replace("CLDIT", f"{shlex.quote(sys.executable)} -m cldit")
    return subprocess.run(
        ["sh", "-c", line], env={**os.environ, **environment}, capture_output=True, check=False
    )


def test_any_text_in_any_locale() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _SAY], env={**os.environ, **_C}, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == b"102 um -> e ? \xff\n2\n"
    done = subprocess.run([sys.executable, "-c", _SAY], capture_output=True, check=True)
    assert done.stdout == "10² µm → é 你 ".encode() + b"\xff\n" + "²\n".encode()


@full
@pytest.mark.parametrize("words", ["CLDIT scenes", "CLDIT --help", "CLDIT scenes --schema"])
def test_full_output(words: str) -> None:
    done = cldit(f"{words} > /dev/full")
    assert done.returncode == 1
    assert done.stderr.startswith(b"error: the output cannot be written (No space left on device)")
    assert done.stderr.count(b"\n") == 1


@full
def test_nobody_to_tell() -> None:
    assert cldit("CLDIT scenes > /dev/full 2> /dev/full").returncode == 1
    assert cldit("CLDIT acquire nowhere.yaml no.yaml --out no 2> /dev/full").returncode == 1


def test_closed_pipes_and_closed_streams(tmp_path: Path) -> None:
    """No traceback; and no file gets the number of a stream that was closed."""
    done = cldit("{ CLDIT scenes --schema; echo $? >&2; } | true")
    assert done.stderr in (b"1\n", b"0\n")  # 0: all of it was in the pipe before the reader went
    done = cldit("CLDIT scenes >&-")
    assert (done.returncode, done.stderr) == (0, b"")
    assert cldit("CLDIT acquire nowhere.yaml no.yaml --out no >&- 2>&-").returncode == 1


def test_a_command_that_cannot_be_loaded_says_why(tmp_path: Path) -> None:
    """No folder for caches takes anything, not even the temporary one."""
    done = cldit("ulimit -f 1; CLDIT devices", TMPDIR=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert done.returncode == 1 and b"Traceback" not in done.stderr
    assert b"caches cannot be kept here" in done.stderr and b"make room" in done.stderr
