"""Python of the pages without commands runs as it is typed; `test_walk.py` runs the other pages."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.acquisition.frames import open_stack
from cldit.acquisition.pictures.source import Source
from cldit.errors import EvaluationError

_ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(r"^```(python|toml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"# ([\w.-]+)\n")


def blocks(page: str) -> list[tuple[str, str]]:
    return _BLOCK.findall((_ROOT / page).read_text(encoding="utf-8"))


def run(page: str) -> dict[str, Any]:
    """Runs a page's blocks in one namespace, here; those that begin with a name become files."""
    names: dict[str, Any] = {"__name__": "__page__"}
    for language, text in blocks(page):
        named = _FILE.match(text)
        if named:
            Path(named[1]).write_text(text, encoding="utf-8")
        if language == "toml":
            _install(text)
        elif not named:
            # registered so that dataclasses and pydantic find the module of what they are given
            exec(compile(text, page, "exec"), names)
    return names


def _install(pyproject: str) -> None:
    """What `pip install -e .` leaves behind: the entry points."""
    project = tomllib.loads(pyproject)["project"]
    info = Path(f"{project['name'].replace('-', '_')}-{project['version']}.dist-info")
    info.mkdir()
    lines = [f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"]
    (info / "METADATA").write_text(lines[0], encoding="utf-8")
    points = [
        f"[{group}]\n" + "".join(f"{name} = {where}\n" for name, where in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(points), encoding="utf-8")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_extending(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from cldit.spray.droplet.models import MODELS

    before = dict(MODELS)
    try:
        names = run("docs/extending.md")
    finally:
        MODELS.clear()
        MODELS.update(before)
        for module in ("my_blackbody", "my_bench"):
            sys.modules.pop(module, None)
    _read_a_film(here)
    assert names["life"].vanished and "still" not in MODELS


def _read_a_film(folder: Path) -> None:
    """The reader of the page is found by the ending, and refuses a film that was cut off."""
    pictures = np.arange(24, dtype="<u2").reshape(2, 3, 4)
    film = np.array([4, 3, 0, 0], "<u4").tobytes() + pictures.tobytes()
    (folder / "a.film").write_bytes(film)
    (folder / "cut.film").write_bytes(film[:-2])
    try:
        stack = open_stack(Source(folder / "a.film"))
        assert len(stack) == 2 and np.array_equal(stack.read(1), pictures[1])
        with pytest.raises(EvaluationError, match=r"cut\.film: cannot be read"):
            open_stack(Source(folder / "cut.film"))
    finally:
        sys.modules.pop("my_film", None)


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_errors() -> None:
    names = run("docs/errors.md")
    assert {cause.name for cause in names["run"].errors.causes} >= {"trace", "cells"}
