"""README's tour, docs/ten-things.md and the gallery, walked in one folder, in this order.

Every command and Python block runs as it is written, with README's own installation: a virtual
environment that sees the packages of `pip install ".[pocl]"` and no others. A CFD case and a
measurement are made here, in place of the reader's own files.
"""

from __future__ import annotations

import faulthandler
import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
import venv
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType

import pytest

from tests.extras import needs

_ROOT = Path(__file__).parents[2]
_PAGES = ("README.md", "docs/ten-things.md", "docs/gallery.md")
_BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_MAKE = "python3 make.py "
pytestmark = [pytest.mark.slow, needs("packaging", extra="dev")]


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"tour_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def steps(page: str) -> list[tuple[str, str]]:
    """Commands of the shell and blocks of Python of a page, in order."""
    found = []
    for language, text in _BLOCK.findall((_ROOT / page).read_text(encoding="utf-8")):
        if language == "python":
            found.append((language, text))
            continue
        lines = text.replace("\\\n", " ").splitlines()
        found += [(language, line.partition("#")[0].strip()) for line in lines]
    return found


def _installed_with(extra: str) -> set[str]:
    """Distributions that `pip install ".[extra]"` installs."""
    from packaging.requirements import Requirement

    found: set[tuple[str, str]] = set()
    waiting = [("cldit", extra), ("cldit", "")]
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in found:
            continue
        found.add((name, wanted))
        for text in distribution(name).requires or ():
            needed = Requirement(text)
            if needed.marker is None or needed.marker.evaluate({"extra": wanted}):
                waiting += [(needed.name, each) for each in ("", *needed.extras)]
    return {name for name, _ in found}


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with links to those packages, and cldit from this checkout."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    venv.create(folder, with_pip=False, symlinks=True)
    paths = sysconfig.get_paths(vars={"base": str(folder), "platbase": str(folder)})
    site = Path(paths["purelib"])
    for name in _installed_with("pocl"):
        one = distribution(name)
        tops = {file.parts[0] for file in one.files or () if file.parts[0] not in ("..", "/")}
        if name == "cldit":  # its metadata alone, also where the checkout has an egg-info
            tops = {top for top in tops if top.endswith("-info")}
        for top in tops - {"__pycache__"}:
            link = site / top
            if not top.startswith("__editable__") and not link.exists():
                link.symlink_to(Path(str(one.locate_file(top))))
    (site / "cldit.pth").write_text(f"{_ROOT}\n", encoding="utf-8")
    command = folder / "bin" / "cldit"
    command.write_text(f"#!{folder}/bin/python\nfrom cldit.cli import main\nmain()\n")
    command.chmod(0o755)
    return folder / "bin" / "python"


def _run(words: list[str] | str, folder: Path, python: Path) -> str:
    path = f"{python.parent}{os.pathsep}{os.environ['PATH']}"
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    faulthandler.dump_traceback_later(1200.0, exit=True)  # of each command, not of the tour
    done = subprocess.run(
        words,
        shell=isinstance(words, str),
        cwd=folder,
        env={**environment, "PATH": path, "BROWSER": "true", "MPLBACKEND": "Agg"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    differs = 3 if "compare" in words else 0
    assert done.returncode in (0, differs), f"{words}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def _make(arguments: str, folder: Path, python: Path) -> None:
    """`make.py`, whose installation is there, and whose checkout is `folder`."""
    code = (
        f"import sys, pathlib; sys.path.insert(0, {str(_ROOT)!r}); import make\n"
        f"make.HERE = pathlib.Path({str(folder)!r})\n"
        "def installed(extras):\n"
        "    assert extras == 'pocl', extras\n"
        "    return pathlib.Path(sys.executable)\n"
        f"make.install = installed; sys.argv[1:] = {arguments.split()!r}; make.main()\n"
    )
    _run([str(python), "-c", code], folder, python)


def test_nothing_else_is_installed(python: Path, tmp_path: Path) -> None:
    code = (
        "from importlib.util import find_spec\n"
        "for name in ('h5py', 'vtk', 'xarray', 'zarr', 'imageio_ffmpeg', 'pytest'):\n"
        "    assert find_spec(name) is None, name\n"
        "import cldit, pyopencl\n"
        "print(cldit.__file__)\n"
    )
    assert Path(_run([str(python), "-c", code], tmp_path, python).strip()).is_relative_to(_ROOT)


def test_tour(python: Path, tmp_path: Path) -> None:
    known = _module(Path(__file__).with_name("test_documented_commands_run.py"))
    known._case(tmp_path / "path/to/case")
    known._measurement(tmp_path / "measurements/july")
    walked = 0
    for page in _PAGES:
        for language, text in steps(page):
            if language == "python":
                _run([str(python), "-c", text], tmp_path, python)
            elif text.startswith(_MAKE):
                if not text.startswith(f"{_MAKE}test"):  # these tests
                    _make(text.removeprefix(_MAKE), tmp_path, python)
            else:
                assert text.startswith("cldit "), text
                _run(text, tmp_path, python)
            walked += 1
    assert walked > 30
    for name in ("maps.png", "errors.png"):
        assert (tmp_path / "runs/gdi/pictures" / name).stat().st_size > 10_000
