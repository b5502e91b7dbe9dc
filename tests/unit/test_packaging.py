"""What lies in the tree is in the wheel, and type checkers find it in the editable install."""

from __future__ import annotations

import re
import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path

import pytest
import yaml
from mypy.modulefinder import FindModuleCache, SearchPaths, get_search_dirs

import cldit
from tests.bench import licences

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(
    not (ROOT / "pyproject.toml").is_file(), reason="not run from a checkout"
)


def test_every_folder_of_code_is_a_package() -> None:
    """The wheel holds the packages that are found, and a folder without `__init__.py` is none."""
    for top in ("cldit", "drivers", "kernels"):
        for path in (ROOT / top).rglob("*.py"):
            assert (path.parent / "__init__.py").is_file(), f"{path} is in no package"


@pytest.mark.parametrize("name", ["drivers", "kernels"])
def test_folders_beside_the_package_are_linked_into_it(name: str) -> None:
    """As links to a sibling, which hold wherever the checkout lies."""
    assert (ROOT / "cldit" / name).readlink() == Path("..", name)


def test_every_data_file_matches_a_pattern() -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"][
        "package-data"
    ]
    for path in [*(ROOT / "cldit").rglob("*"), *(ROOT / "kernels").rglob("*")]:
        if path.is_dir() or path.suffix == ".py" or path.parent.name == "__pycache__":
            continue
        package = ".".join(path.parent.relative_to(ROOT).parts)
        package = f"cldit.{package}" if package.startswith("kernels") else package
        patterns = data.get(package, [])
        assert any(path.match(pattern) for pattern in patterns), f"{path} is not package data"


def test_citation_is_of_this_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "CITATION.cff").read_text()
    citation = yaml.load(text, Loader=yaml.BaseLoader)  # a date is a text, as in the schema
    assert citation["title"] == project["name"]
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    assert citation["keywords"] == project["keywords"]
    assert citation["authors"] == project["authors"]


def test_licences_of_all_packages_are_listed() -> None:
    page = (ROOT / "docs" / "licences.md").read_text()
    row = re.compile(r"^\| ([a-z0-9-]+) \| ([^|]+?)(?: \*)? \|", re.MULTILINE)
    rows = dict(row.findall(page))
    for extra, texts in licences.project().items():
        if extra not in licences.OF_DEVELOPERS:
            assert licences.names(texts) <= rows.keys(), extra
    part = r"(LicenseRef-)?[A-Za-z0-9.-]+"  # of an SPDX expression
    whole = re.compile(rf"{part}( (AND|OR|WITH) {part})*")
    assert [name for name, licence in rows.items() if not whole.fullmatch(licence)] == []


def test_top_level_is_as_stated() -> None:
    names = {path.name for path in ROOT.iterdir() if not path.name.startswith(".")}
    allowed = {
        "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md", "build", "cldit",
        "cldit.egg-info", "dist", "docs", "drivers", "kernels", "make.py", "pyproject.toml", "runs",
        "tests",
    }  # fmt: skip
    assert names <= allowed


@pytest.mark.parametrize(
    "module", ["cldit", "cldit.scene.load", "cldit.drivers.dg645", "cldit.kernels"]
)
def test_mypy_finds_the_installed_package(module: str) -> None:
    """Where it looks from any other folder: in site-packages and what `.pth` files add to them.

    `tests/system/test_types_outside.py` runs it whole.
    """
    installed = tuple(path for paths in get_search_dirs(sys.executable) for path in paths)
    found = FindModuleCache(SearchPaths((), (), installed, ()), None, None).find_module(module)
    assert isinstance(found, str), f"mypy: {module}: {found}"
    wanted = Path(*module.split("."))
    wanted = wanted / "__init__.py" if len(wanted.parts) < 3 else wanted.with_suffix(".py")
    assert Path(found).parts[-len(wanted.parts) :] == wanted.parts


def test_no_import_hook_stands_before_the_package() -> None:
    """An editable install is one line of a `.pth` file, which is a path."""
    lines = [
        line
        for file in distribution("cldit").files or ()
        if file.suffix == ".pth"
        for line in str(file.read_text()).splitlines()
    ]
    assert not any(line.startswith("import ") for line in lines), lines


def test_no_public_name_is_that_of_a_module() -> None:
    """Else `cldit.NAME` is the module, once anyone has loaded it."""
    modules = {path.stem for path in Path(cldit.__file__).parent.iterdir()}
    assert modules.isdisjoint(cldit.__all__)
