"""A script in another folder sees the types of the installed package."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import cldit
import cldit.kernels
from cldit.drivers.dg645 import open_dg645

reveal_type(cldit.load_scene)
reveal_type(cldit.load_scene("gdi-cone").camera.pixels)
reveal_type(cldit.open_run("runs/gdi").scene.name)
reveal_type(open_dg645)
cldit.load_scene(3)
"""
EXPECTED = (
    'note: Revealed type is "def (name_or_path: str | pathlib.Path) -> cldit.scene.schema.Scene"',
    'note: Revealed type is "tuple[int, int]"',
    'note: Revealed type is "str"',
    'note: Revealed type is "def (settings: dict[str, Any], context: cldit.rig.drivers.RigContext)'
    ' -> cldit.drivers.dg645.Dg645"',
    'error: Argument 1 to "load_scene" has incompatible type "int"',
)


@pytest.mark.slow  # mypy reads NumPy's and pydantic's types: 15 s, 3 s with its cache
def test_mypy_from_another_folder(tmp_path: Path) -> None:
    folder = tmp_path / "with a space"
    folder.mkdir()
    (folder / "script.py").write_text(SCRIPT)
    cache = Path(__file__).parents[2] / ".mypy_cache" / "outside"
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", cache, "script.py"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    lines = done.stdout.splitlines()
    assert len(lines) == len(EXPECTED) + 1, done.stdout + done.stderr
    for line, expected in zip(lines, EXPECTED, strict=False):
        assert expected in line, done.stdout
