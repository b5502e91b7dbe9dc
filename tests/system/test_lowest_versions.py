"""The lowest versions that pyproject.toml declares do work, together, on the oldest Python."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ("pocl", "cfd", "export", "files", "zarr", "hcc", "studies", "rig")
# A scene end to end; imports (binary OpenFOAM, VTKHDF); images of cameras; evaluations; properties
# of fluids; a study; drivers on their emulators.
USES = (
    "tests/system/test_run.py",
    "tests/unit/cfd/test_openfoam.py",
    "tests/unit/cfd/test_composite.py",
    "tests/unit/acquisition/test_pictures.py",
    "tests/unit/acquisition/test_kinds.py",
    "tests/unit/acquisition/test_export.py",
    "tests/unit/dit",
    "tests/unit/spray/droplet/test_fluids.py",
    "tests/system/test_study.py",
    "tests/drivers/test_contract.py",
)


def lowest(requirements: list[str]) -> list[str]:
    """Each requirement `name[extra]>=version` at exactly that version."""
    pins = []
    for each in requirements:
        found = re.fullmatch(r"([\w.-]+(?:\[\w+\])?)>=([\d.]+)(,<[\d.]+)?", each)
        if found:
            pins.append(f"{found[1]}=={found[2]}")
    return pins


def test_requirements_have_a_lowest_version() -> None:
    """Every one of the package itself, and of the extras that are tried."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert len(lowest(project["dependencies"])) == len(project["dependencies"])
    for extra in EXTRAS[1:]:
        wanted = project["optional-dependencies"][extra]
        assert len(lowest(wanted)) == len(wanted), extra


@pytest.mark.long
@pytest.mark.skipif(
    sys.version_info[:2] != (3, 11), reason="the lowest versions are those of Python 3.11"
)
def test_the_lowest_versions_work(tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [each for name in EXTRAS[1:] for each in project["optional-dependencies"][name]]
    pins = lowest([*project["dependencies"], *extras])
    pins = [pin.replace("pyopencl==", "pyopencl[pocl]==") for pin in pins]
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "lowest")], check=True)
    python = str(tmp_path / "lowest" / "bin" / "python")
    install = [python, "-m", "pip", "install", "--quiet"]
    subprocess.run([*install, *pins, "pytest", "hypothesis"], check=True)
    subprocess.run([*install, "--no-deps", "--editable", str(ROOT)], check=True)
    # What is deprecated since those versions is no error.
    done = subprocess.run(
        [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", "filterwarnings=", *USES],
        cwd=ROOT,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
