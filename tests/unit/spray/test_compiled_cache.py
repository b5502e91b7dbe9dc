"""Compiled code of other sources is not found."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SOURCE = """
from typing import NamedTuple
class {name}(NamedTuple):
    x: float
"""
USER = """
import {types}
from cldit.spray.numba_typing import compiled
@compiled
def twice(state):
    return 2.0 * state.x
"""
RUN = "import user, {types}; print(user.twice({types}.{name}(1.5)))"


def test_a_renamed_type_leaves_no_cache_behind(tmp_path: Path) -> None:
    """numba unpickles all that it has of a function before it looks at what it is asked for."""
    code = (
        "import sys; from cldit.io import content; content.code_digest = lambda *_: sys.argv[1]; "
        "import importlib; exec(sys.argv[2])"
    )
    (tmp_path / "user.py").write_text(USER.format(types="types_of"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]),
                   "NUMBA_CACHE_DIR": str(tmp_path / "cache")}  # fmt: skip

    def run(digest: str, name: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "types_of.py").write_text(SOURCE.format(name=name))
        words = [sys.executable, "-c", code, digest, RUN.format(types="types_of", name=name)]
        return subprocess.run(words, env=environment, capture_output=True, text=True)

    assert run("a", "State").stdout.strip() == "3.0"
    assert "AttributeError" in run("a", "FilmState").stderr  # why the digest is needed
    assert run("b", "FilmState").stdout.strip() == "3.0"
