"""Every page is walked: its commands and scripts run as typed, in order, in a folder of its own.

The installation is that of the README with the extras that the page names: a virtual environment
that sees these packages and no others. `documented.BEGIN` has the reader's own files, which are
made here: a CFD case, a measurement, scenes. In the tier `slow` the pages of a reader's first day
are walked, and each shipped scene is a file of its name with few pixels, coarse cells and no flow;
the tier `long`, for a release, has the other pages too, small and as they are.
`pytest -m slow tests/system/test_walk.py -k dit` walks one page, `-m long -k "small and optics"`
another.
"""

from __future__ import annotations

import faulthandler
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml

from cldit.optics.planck import band_radiance
from cldit.scene import dump_scene, load_scene, parse_scene, shipped_scenes
from tests.extras import needs
from tests.system.documented import BEGIN, PAGES, ROOT, Step, extras, steps, text_of

pytestmark = needs("packaging", extra="dev")

# Not run, with the reason.
NOT = {
    "python3 make.py test": "these tests",
    "python -m ": "measurements of developers, hours; tests/bench tests their parts",
    "pip install": "the extras are read from it",
    "cldit bench --only budget --out docs": "hours; tests/unit/bench runs it on a small scene",
    "cldit study all": "an hour; the same with --quick is run in the tier `long`",
    "cldit study models": "an hour; `models_small` of tests/bench is its small size",
    "cldit fit": "a measurement of the reader's scene; tests/unit/study runs it on a twin",
    "from dask_jobqueue": "needs SLURM; test_sweep.py has a command that stands for it",
    "cldit check-driver modbus_blackbody": "needs an instrument; tests/drivers has an emulated one",
}
ONLY_LONG = ("cldit study fig12", "cldit study all --quick", "cldit study walls --quick")
STATUS = {"cldit compare": (0, 3), "cldit plan --separate": (0, 3)}  # 3: a result, not a failure
ALWAYS_SMALL = ("docs/studies.md", "docs/benchmarks/index.md")  # a sweep, and a benchmark: hours
NO_SCRIPTS = ("docs/extending.md", "docs/errors.md")  # no commands; test_documented_python.py
FIRST_DAY = ("README.md", "docs/dit.md", "docs/importing.md", "docs/rig.md")
_WALKED = [page for page in PAGES if any(s.is_cldit for s in steps(page))]


def _installed_with(names: frozenset[str]) -> set[str]:
    """Distributions that `pip install ".[names]"` installs."""
    from packaging.requirements import Requirement

    found: set[tuple[str, str]] = set()
    waiting = [("cldit", name) for name in ("", *names)]
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in found:
            continue
        found.add((name, extra))
        try:
            required = distribution(name).requires or ()
        except PackageNotFoundError:  # an extra that the tests do without
            continue
        for text in required:
            needed = Requirement(text)
            if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                waiting += [(needed.name, each) for each in ("", *needed.extras)]
    return {name for name, _ in found}


@cache
def _environment(names: frozenset[str], folder: Path) -> Path:
    """Python of an environment with links to those packages, and cldit from this checkout."""
    venv.create(folder, with_pip=False, symlinks=True)
    paths = sysconfig.get_paths(vars={"base": str(folder), "platbase": str(folder)})
    site = Path(paths["purelib"])
    for name in _installed_with(names):
        try:
            one = distribution(name)
        except PackageNotFoundError:
            continue
        tops = {file.parts[0] for file in one.files or () if file.parts[0] not in ("..", "/")}
        if name == "cldit":  # its metadata alone, also where the checkout has an egg-info
            tops = {top for top in tops if top.endswith("-info")}
        for top in tops - {"__pycache__"}:
            link = site / top
            if not top.startswith("__editable__") and not link.exists():
                link.symlink_to(Path(str(one.locate_file(top))))
    (site / "cldit.pth").write_text(f"{ROOT}\n", encoding="utf-8")
    command = folder / "bin" / "cldit"
    command.write_text(f"#!{folder}/bin/python\nfrom cldit.cli import main\nmain()\n")
    command.chmod(0o755)
    return folder / "bin" / "python"


class Walk:
    """A page's folder, and the Python of its installation."""

    def __init__(self, folder: Path, python: Path) -> None:
        self.folder = folder
        self.python = python

    def run(self, words: list[str] | str, allowed: tuple[int, ...] = (0,)) -> str:
        """Runs a command in the folder; its standard output."""
        path = f"{self.python.parent}{os.pathsep}{os.environ['PATH']}"
        hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
        environment = {name: value for name, value in os.environ.items() if name not in hidden}
        faulthandler.dump_traceback_later(3600.0, exit=True)  # of each command, not of the page
        done = subprocess.run(
            words,
            shell=isinstance(words, str),
            cwd=self.folder,
            env={**environment, "PATH": path, "BROWSER": "true", "MPLBACKEND": "Agg"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        ended = f"{words}: {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        assert done.returncode in allowed, ended
        assert "Warning" not in done.stderr, ended
        return done.stdout

    def make(self, arguments: str) -> None:
        """`make.py`, whose installation is there, and whose checkout is the folder."""
        code = (
            f"import sys, pathlib; sys.path.insert(0, {str(ROOT)!r}); import make\n"
            f"make.HERE = pathlib.Path({str(self.folder)!r})\n"
            "def installed(extras):\n"
            "    assert extras == 'pocl', extras\n"
            "    return pathlib.Path(sys.executable)\n"
            f"make.install = installed; sys.argv[1:] = {arguments.split()!r}; make.main()\n"
        )
        self.run([str(self.python), "-c", code])

    def step(self, step: Step, script: str) -> None:
        """Runs a step; `script` is the page's Python so far, for a block that continues it."""
        if step.language == "python":
            self.run([str(self.python), "-c", script])
        elif step.text.startswith("python3 make.py "):
            self.make(step.text.removeprefix("python3 make.py "))
        else:
            assert step.is_cldit, step.text
            allowed = [codes for start, codes in STATUS.items() if step.text.startswith(start)]
            self.run(step.text, allowed[0] if allowed else (0,))


def _case(folder: Path) -> None:
    """An OpenFOAM case: a cone of parcels that left (0, 11 mm, 0) along -y up to 0.1 ms ago."""
    foam = _module(ROOT / "tests/unit/cfd/conftest.py")
    random = np.random.default_rng(3)
    edges = [np.linspace(*span) for span in ((-6e-3, 6e-3, 7), (0.0, 12e-3, 7), (-6e-3, 6e-3, 7))]
    block = foam.Block(tuple(edges))
    velocity = random.normal((0.0, -80.0, 0.0), 4.0, (500, 3))
    age = random.uniform(1e-6, 1e-4, 500)
    cloud = {
        "position": np.array([0.0, 11e-3, 0.0]) + velocity * age[:, None],
        "U": velocity,
        "age": age,
        "d": random.uniform(2e-6, 2e-5, 500),
        "nParticle": np.full(500, 1e3),
        "T": np.full(500, 370.0),
        "rho": np.full(500, 610.0),
    }
    gas: dict[str, Any] = {"T": 570.0, "p": 6e5, "rho": 3.6}
    gas["C7H16"] = random.uniform(0.0, 0.1, block.cells)
    foam.write_case(folder, block, gas=gas, cloud=cloud)


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _measurement(folder: Path, *, described: bool) -> None:
    """Twenty images in front of each of three backgrounds of a sheet: emissivity 0.4, 430 K.

    Without a description there is no measured.yaml, which the page then drafts.
    """
    folder.mkdir(parents=True)
    random = np.random.default_rng(5)
    sets = []
    for kelvin in (413.0, 453.0, 493.0):
        light, own = band_radiance([kelvin, 430.0], filter_um=(3.3, 3.5))
        for kind, seen in (("references", light), ("injections", 0.6 * light + 0.4 * own)):
            electrons = random.poisson(4.8e-16 * seen, (20, 16, 24))
            counts = 300 + (electrons + 200 * random.standard_normal(electrons.shape)) / 40
            tifffile.imwrite(folder / f"{kelvin:g}K-{kind}.tif", np.rint(counts).astype(np.uint16))
        names = {kind: f"{kelvin:g}K-{kind}.tif" for kind in ("references", "injections")}
        sets.append({"temperature_K": kelvin, **names})
    data = {
        "filter_um": [3.3, 3.5],
        "setup": {"pixel_m": [1e-4, 1e-4]},
        "sensor": {"saturation_counts": 16383},
        "backgrounds": sets,
    }
    if described:
        (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")


def _complete(draft: Path) -> None:
    """The reader's part of a drafted measured.yaml: filter and pixel size, as the page has them."""
    text = draft.read_text(encoding="utf-8")
    for key in ("filter_um", "pixel_m"):
        assert f"# {key}: [" in text, text
        text = text.replace(f"# {key}: [", f"{key}: [")
    draft.write_text(text, encoding="utf-8")


def _small(name: str) -> str:
    """A shipped scene with few pixels, coarse cells and no flow."""
    data = load_scene("gdi-cone" if name == "gdi" else name).model_dump(mode="json")
    data["name"] = name
    data["camera"]["pixels"] = [96, 96]
    data["domain"]["leaf_edge_m"] = 4e-3
    if data["spray"]["model"] == "lagrangian":
        data["spray"] = {"model": "cone"}
    return dump_scene(parse_scene(data))


def _scene(path: Path) -> None:
    """The reader's scene, or the second of two rivals, based on `a.yaml`."""
    if path.name == "b.yaml":
        path.write_text("base: a.yaml\nspray: {evaporation: false}\n", encoding="utf-8")
    else:
        path.write_text(_small("gdi-cone"), encoding="utf-8")


def _printed(path: Path, page: str) -> None:
    """The file that a page prints, below its name."""
    block = rf"^```yaml\n(# {re.escape(path.name)}\n.*?)^```"
    printed = re.search(block, text_of(page), re.M | re.S)
    assert printed is not None
    of_flow = r"^spray\.mixing_length: .*\n"  # the reader's scene has no flow
    path.write_text(re.sub(of_flow, "", printed[1], flags=re.M), encoding="utf-8")


def _rig(path: Path, walk: Walk) -> None:
    """The rig file of a simulated rig, as a run writes it."""
    rigs = sorted(path.parent.glob("runs/*/rig.yaml"))
    if not rigs:
        walk.run("cldit run a.yaml --out runs/a")
        rigs = [path.parent / "runs/a/rig.yaml"]
    path.write_text(rigs[0].read_text(encoding="utf-8"), encoding="utf-8")


def _begin(name: str, page: str, walk: Walk) -> None:
    """Makes a file or folder that the page assumes."""
    path = walk.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if name in ("CASE", "path/to/case"):
        _case(path)
    elif name == "measurements/july":
        drafted = any(" --write-measured " in step.text for step in steps(page))
        _measurement(path, described=not drafted)
    elif name == "runs/gdi":
        walk.run("cldit run gdi")  # `python3 make.py run`
    elif name in ("plan.yaml", "unknowns.yaml"):
        _printed(path, page)
    elif name == "rig.yaml":
        _rig(path, walk)
    else:
        _scene(path)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[frozenset[str]], Path]:
    folder = tmp_path_factory.mktemp("installed")

    def python(names: frozenset[str]) -> Path:
        return _environment(names, folder / "-".join(sorted(names)))

    return python


def _todo(page: str, small: bool) -> Iterator[Step]:
    for step in steps(page):
        left_out = [start for start in NOT if step.text.startswith(start)]
        if "--quick" in step.text:  # as `cldit study all --quick`
            left_out = []
        if left_out or (small and step.text.startswith(ONLY_LONG)):
            continue
        yield step


def _walk(page: str, walk: Walk, small: bool) -> int:
    if small or page in ALWAYS_SMALL:
        for name in shipped_scenes():
            (walk.folder / name).write_text(_small(name), encoding="utf-8")
    walked, script = 0, ""
    waiting = [name for name in BEGIN.get(page, ()) if name != "shots"]  # of `cldit fit`
    for step in _todo(page, small):
        for name in [name for name in waiting if name in step.text]:
            _begin(name, page, walk)
            waiting.remove(name)
        if step.language == "python":
            script = step.text if "import cldit" in step.text else script + step.text
        walk.step(step, script)
        if " --write-measured " in step.text:
            _complete(walk.folder / step.text.split()[-1])
        walked += 1
    return walked


@pytest.mark.parametrize(
    ("page", "small"),
    [
        pytest.param(page, small, marks=mark, id=f"{page}-{'small' if small else 'typed'}")
        for page in _WALKED
        for small, mark in (
            (True, pytest.mark.slow if page in FIRST_DAY else pytest.mark.long),
            (False, pytest.mark.long),
        )
        if any(_todo(page, small))
    ],
)
def test_page(
    page: str, small: bool, installed: Callable[[frozenset[str]], Path], tmp_path: Path
) -> None:
    folder = tmp_path / "a walk"
    folder.mkdir()
    assert _walk(page, Walk(folder, installed(extras(page))), small) > 0
    shutil.rmtree(folder)


@pytest.mark.slow
def test_nothing_else_is_installed(
    installed: Callable[[frozenset[str]], Path], tmp_path: Path
) -> None:
    code = (
        "from importlib.util import find_spec\n"
        "for name in ('h5py', 'vtk', 'xarray', 'zarr', 'imageio_ffmpeg', 'pytest'):\n"
        "    assert find_spec(name) is None, name\n"
        "import cldit, pyopencl\n"
        "print(cldit.__file__)\n"
    )
    walk = Walk(tmp_path, installed(frozenset({"pocl"})))
    printed = walk.run([str(walk.python), "-c", code])
    assert Path(printed.strip()).is_relative_to(ROOT)


def test_every_page_with_commands_is_walked() -> None:
    others = [page for page in PAGES if page not in _WALKED]
    scripts = {page for page in others if any(s.language == "python" for s in steps(page))}
    assert scripts == set(NO_SCRIPTS)
    assert len(_WALKED) > 15
    assert extras("docs/dit.md") >= {"pocl", "files", "studies", "hcc"}
    assert extras("docs/index.md") == {"pocl"}
