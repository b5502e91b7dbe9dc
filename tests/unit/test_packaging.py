"""The list of packages is the tree; what it lacks works when editable, and not as a wheel."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(
    not (ROOT / "pyproject.toml").is_file(), reason="not run from a checkout"
)


def test_every_package_is_listed() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    found = [
        ".".join(init.parent.relative_to(ROOT).parts)
        for top in ("cldit", "drivers", "kernels")
        for init in (ROOT / top).rglob("__init__.py")
    ]
    inside = [name if name.startswith("cldit") else f"cldit.{name}" for name in found]
    assert sorted(listed) == sorted(inside)


def test_every_data_file_matches_a_pattern() -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"][
        "package-data"
    ]
    for path in [*(ROOT / "cldit").rglob("*"), *(ROOT / "kernels").iterdir()]:
        if path.is_dir() or path.suffix == ".py" or path.parent.name == "__pycache__":
            continue
        package = ".".join(path.parent.relative_to(ROOT).parts)
        package = "cldit.kernels" if package == "kernels" else package
        patterns = data.get(package, [])
        assert any(path.match(pattern) for pattern in patterns), f"{path} is not package data"


def test_top_level_is_as_stated() -> None:
    names = {path.name for path in ROOT.iterdir() if not path.name.startswith(".")}
    allowed = {
        "CHANGELOG.md", "LICENSE", "README.md", "build", "cldit", "cldit.egg-info", "dist", "docs",
        "drivers", "kernels", "make.py", "pyproject.toml", "runs", "tests",
    }  # fmt: skip
    assert names <= allowed
