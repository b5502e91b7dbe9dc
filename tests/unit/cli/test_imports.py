"""Each command imports what it uses and nothing that is slow besides."""

from __future__ import annotations

import subprocess
import sys

import pytest

SLOW = {"matplotlib", "numba", "scipy", "pyopencl", "CoolProp", "vtk"}


@pytest.mark.parametrize(
    ("words", "allowed"),
    [
        (["scenes"], set()),
        (["--version"], set()),
        (["export", "--help"], set()),
        (["acquire", "--help"], set()),
        (["bench", "rig", "--help"], set()),
        (["optics", "--help"], SLOW - {"vtk"}),
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
