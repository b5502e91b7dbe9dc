"""Every `cldit` command of the README and the docs, run as it is typed, page by page.

All pages share one folder. What stands in for a user's own files is made here: a CFD case, a
measurement, a table of n and k, a scene. Commands that measure `gdi` for many minutes run in a
folder in which `gdi` (as a cone) and `droplets-only` are files with fewer pixels and coarser cells:
a scene is given by its file as well as by its name. Nothing of cldit is replaced.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml

from cldit.optics.liquid import liquid
from cldit.optics.planck import band_radiance
from cldit.scene import dump_scene, load_scene, parse_scene

_ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.long

# Run with small scenes: each takes from some minutes to an hour with gdi as it is.
SMALL = (
    r"cldit bench",
    r"cldit study \w+ --grid",
)
_NEEDS_GDI = ("docs/dit.md", "docs/rig.md", "docs/scattering.md", "docs/view.md")
# Not run, with the reason.
NOT = {
    "cldit bench --only budget --out docs": "hours; tests/unit/bench runs it on a small scene",
    "cldit study all": "an hour; the same with --quick is run",
    "cldit study models": "hours; tests/system/test_study.py runs it on a small scene",
    "cldit plan --separate": "two scenes of the reader; tests/unit/dit runs it",
    "cldit fit": "a measurement of the reader's scene; tests/unit/study runs it on a twin",
    "cldit check-driver modbus_blackbody": "needs an instrument; tests/drivers has an emulated one",
}


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


commands = _module(Path(__file__).with_name("test_documented_commands.py"))
_TOUR = ("README.md", "docs/ten-things.md", "docs/gallery.md")  # test_tour.py walks them
PAGES = sorted({page for page, _ in commands.documented()} - set(_TOUR))


def _case(folder: Path) -> None:
    """An OpenFOAM case: a cone of parcels that left (0, 11 mm, 0) along -y up to 0.1 ms ago."""
    foam = _module(_ROOT / "tests/unit/cfd/conftest.py")
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


def _measurement(folder: Path) -> None:
    """Twenty pictures before each of two backgrounds of a sheet of emissivity 0.4 at 430 K."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(5)
    sets = []
    for kelvin in (413.0, 453.0, 493.0):
        light, own = band_radiance([kelvin, 430.0], filter_um=(3.3, 3.5))
        for kind, seen in (("references", light), ("injections", 0.6 * light + 0.4 * own)):
            electrons = random.poisson(4.8e-16 * seen, (20, 16, 24))
            counts = 300 + (electrons + 200 * random.standard_normal(electrons.shape)) / 40
            tifffile.imwrite(folder / f"{kelvin:g}-{kind}.tif", np.rint(counts).astype(np.uint16))
        names = {kind: f"{kelvin:g}-{kind}.tif" for kind in ("references", "injections")}
        sets.append({"temperature_K": kelvin, **names})
    described = {
        "filter_um": [3.3, 3.5],
        "setup": {"pixel_m": [1e-4, 1e-4]},
        "sensor": {"saturation_counts": 16383},
        "backgrounds": sets,
    }
    (folder / "measured.yaml").write_text(yaml.safe_dump(described), encoding="utf-8")


def _small(name: str) -> str:
    data = load_scene(name).model_dump(mode="json")
    data["camera"]["pixels"] = [160, 160]
    data["domain"]["leaf_edge_m"] = 4e-3
    return dump_scene(parse_scene(data))


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("documented")
    for case in ("CASE", "path/to/case"):
        _case(folder / case)
    _measurement(folder / "measurements" / "july")
    um = np.linspace(2.5, 4.5, 800)
    n, k = liquid("n-octane").index(um, 300.0)
    table = np.column_stack([um, n, k])
    np.savetxt(folder / "table.csv", table, delimiter=",", header="wavelength_um,n,k", comments="")
    small = folder / "small"
    small.mkdir()
    for place in (folder, small):
        (place / "docs").mkdir()
        (place / "my.yaml").write_text(_small("gdi-cone"), encoding="utf-8")
    for name, fast in (("gdi", "gdi-cone"), ("droplets-only", "droplets-only")):
        (small / name).write_text(_small(fast), encoding="utf-8")
    return folder


def _run(line: str, folder: Path) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        env={**os.environ, "PATH": path, "BROWSER": "true"},  # the command that does nothing
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


def _before(page: str, folder: Path) -> None:
    """What a page takes for done."""
    if page in _NEEDS_GDI and not (folder / "runs/gdi").exists():
        _run("cldit run gdi", folder)  # `python3 make.py run`
    if page == "docs/rig.md":
        (folder / "rig.yaml").write_bytes((folder / "runs/gdi/rig.yaml").read_bytes())
        text = (_ROOT / page).read_text(encoding="utf-8")
        plan = re.search(r"^```yaml\n(# plan\.yaml\n.*?)^```", text, re.MULTILINE | re.DOTALL)
        assert plan is not None
        (folder / "plan.yaml").write_text(plan[1], encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_page(page: str, scratch: Path) -> None:
    _before(page, scratch)
    for known, line in commands.documented():
        if known != page:
            continue
        bare = line.partition("#")[0].strip()
        skipped = [reason for start, reason in NOT.items() if bare.startswith(start)]
        if skipped and "--quick" not in bare:
            continue
        small = any(re.match(pattern, bare) for pattern in SMALL)
        _run(bare, scratch / "small" if small else scratch)


def test_python_of_the_studies(scratch: Path) -> None:
    """It reads the sweep that the page's commands made."""
    if not (scratch / "small" / "sweep").exists():
        test_page("docs/studies.md", scratch)
    text = (_ROOT / "docs/studies.md").read_text(encoding="utf-8")
    code = "\n".join(re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    (scratch / "small" / "block.py").write_text(code, encoding="utf-8")
    _run("MPLBACKEND=Agg python block.py", scratch / "small")


def test_what_is_left_out_is_documented() -> None:
    lines = [line for _, line in commands.documented()]
    for start in NOT:
        assert any(line.startswith(start) for line in lines)
