"""Printed output: in any locale, where nothing can be written, and the result of a run."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.cli.console import ERR, OUT, ProgressBar
from cldit.prepare.stages import StageLine, Stages
from tests.command_line import command

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


def shell(words: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
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
    done = shell(f"{words} > /dev/full")
    assert done.returncode == 1
    assert done.stderr.startswith(b"error: the output cannot be written (No space left on device)")
    assert done.stderr.count(b"\n") == 1


@full
def test_nobody_to_tell() -> None:
    assert shell("CLDIT scenes > /dev/full 2> /dev/full").returncode == 1
    assert shell("CLDIT acquire nowhere.yaml no.yaml --out no 2> /dev/full").returncode == 1


def test_closed_pipes_and_closed_streams(tmp_path: Path) -> None:
    """No traceback; and no file gets the number of a stream that was closed."""
    done = shell("{ CLDIT scenes --schema; echo $? >&2; } | true")
    assert done.stderr in (b"1\n", b"0\n")  # 0: all of it was in the pipe before the reader went
    done = shell("CLDIT scenes >&-")
    assert (done.returncode, done.stderr) == (0, b"")
    assert shell("CLDIT acquire nowhere.yaml no.yaml --out no >&- 2>&-").returncode == 1


def test_a_command_that_cannot_be_loaded_says_why(tmp_path: Path) -> None:
    """No folder for caches takes anything, not even the temporary one."""
    done = shell("ulimit -f 1; CLDIT devices", TMPDIR=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert done.returncode == 1 and b"Traceback" not in done.stderr
    assert b"caches cannot be kept here" in done.stderr and b"make room" in done.stderr


_COARSE = ("--trace-only", "--pixels", "32", "--accuracy", "20", "--set", "domain.leaf_edge_m=6e-3")


def _run(folder: Path, *words: str) -> str:
    said = command("run", "gdi-cone", *_COARSE, "--out", folder, *words).output
    return said.replace(str(folder), "RUN")


def test_a_run_ends_with_its_result(tmp_path: Path) -> None:
    lines = _run(tmp_path / "run", "--field", "60").splitlines()
    found = dict(line.split(" ", 1) for line in lines if " " in line)
    run = cldit.open_run(tmp_path / "run")
    seen = run.maps.apparent_temperature_K[run.maps.has_temperature]
    low, high, median = map(float, re.findall(r"[\d.]+", found["T_app"]))
    assert (low, high) == pytest.approx(tuple(np.percentile(seen, (1, 99))), abs=0.06)
    assert median == pytest.approx(float(np.median(seen)), abs=0.06)
    count = f"{int(run.maps.has_temperature.sum())} of 32 x 32 traced pixels"
    assert f"  in {count} with an emissivity above 0.05" in lines
    assert run.errors is not None
    stated = [line for line in lines if line.startswith("error of ")]
    largest, most = run.errors.largest(), run.errors.largest(of_emissivity=True)
    assert largest is not None and most is not None and len(stated) == 2
    for line, text, cause in zip(
        stated,
        (f"T_app {run.errors.text}", f"emissivity {run.errors.emissivity_text}"),
        (largest, most),
        strict=True,
    ):
        assert f"error of {text} RMS; largest source: {cause.name}, " in line
    assert (
        f"liquid {1e3 * run.info.spray['liquid_penetration_95_m']:.1f} mm" in found["penetration:"]
    )
    assert lines[-2:] == ["RUN/maps", "next: cldit view RUN"]
    assert "octree" not in "".join(lines) and "OpenCL" not in "".join(lines)
    # 60 mm: 5 mm are above the nozzle
    assert run.scene.target_m == pytest.approx((0.0, 0.0, -0.025))


def test_what_the_field_cuts_is_said_and_stages_are_behind_v(tmp_path: Path) -> None:
    kept = "camera.target_m=[0.0, 0.0, -0.01]"
    text = _run(tmp_path / "run", "--field", "60x12", "-v", "--set", kept)
    assert re.search(r"cuts the visible spray at its edges: .*bottom \(\d+ pixels\)", text)
    assert "  octree\n" in text and "OpenCL device" in text and "error by" in text
    assert cldit.open_run(tmp_path / "run").scene.target_m == (0.0, 0.0, -0.01)


def test_only_stages_are_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    said: list[Any] = []
    stages = Stages(said.append)
    with stages.stage("spray"):
        stages.remark(["a remark"])
    assert [isinstance(line, StageLine) for line in said] == [True, False]
    for line in said:
        ProgressBar().say(line)
    assert capsys.readouterr().out == "  a remark\n"
    ProgressBar(stages=True).say(said[0])
    assert capsys.readouterr().out == "  spray\n"


def test_names_in_messages_stay_as_they_are() -> None:
    for console in (OUT, ERR):
        with console.capture() as got:
            console.print("a:x:b.yaml")
        assert got.get() == "a:x:b.yaml\n"
