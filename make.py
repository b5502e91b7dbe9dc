#!/usr/bin/env python3
"""Sets up what is needed and runs it; needs Python 3.11 or newer and nothing else.

python3 make.py run [SCENE] [cldit run options]   the main job; `gdi` if no scene is given
python3 make.py test [--all] [pytest options]     the tests of the first tier; of both
python3 make.py lint                              ruff, mypy --strict, types as users see them
python3 make.py docs                              the docs as a site: build/docs/index.html
python3 make.py wheel                             builds and checks the wheel, runs it elsewhere
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
_BIN = "Scripts" if os.name == "nt" else "bin"

# Run with the wheel alone, from a folder that is not the checkout.
WHEEL_CHECK = """
import pathlib, sys
import numpy as np
import cldit, cldit.drivers.dg645, cldit.kernels
assert pathlib.Path(cldit.__file__).is_relative_to(sys.prefix), cldit.__file__
assert (pathlib.Path(cldit.kernels.__path__[0]) / "sweep.cl").is_file()
for name in cldit.shipped_scenes():
    cldit.load_scene(name)
data = cldit.load_scene("droplets-only").model_dump(mode="json")
data["camera"]["pixels"] = [64, 64]
data["domain"]["leaf_edge_m"] = 2e-3
run = cldit.simulate(cldit.Scene.from_dict(data), "run", record=True)
assert np.nanmax(run.measured.emissivity) > 0.9
assert (run.folder / "report.html").is_file()
print("the wheel works outside the checkout:", cldit.__version__)
"""


def call(*command: str | Path, **options: object) -> None:
    """Runs a command; its exit status is ours if it fails."""
    print("+", " ".join(str(part) for part in command), flush=True)
    result = subprocess.run([str(part) for part in command], cwd=options.get("cwd", HERE))
    if result.returncode:
        sys.exit(result.returncode)


def environment(folder: Path) -> Path:
    """Makes a virtual environment if there is none; its Python."""
    python = folder / _BIN / "python"
    if not python.exists() and not python.with_suffix(".exe").exists():
        call(sys.executable, "-m", "venv", folder)
    return python


def install(extras: str) -> Path:
    """Installs the project, editable, with extras; nothing to do if that was done before."""
    if not (HERE / "cldit" / "drivers").is_dir():
        sys.exit("cldit/drivers is no link: clone with `git clone -c core.symlinks=true`")
    python = environment(VENV)
    stamp = VENV / f"installed-{extras.replace(',', '-')}"
    key = hashlib.sha256((HERE / "pyproject.toml").read_bytes()).hexdigest()
    if not stamp.exists() or stamp.read_text() != key:
        call(python, "-m", "pip", "install", "--quiet", "--editable", f"{HERE}[{extras}]")
        stamp.write_text(key)
    return python


def run(arguments: list[str]) -> None:
    python = install("pocl")
    if not arguments or arguments[0].startswith("-"):
        arguments = ["gdi", *arguments]
    call(python.parent / "cldit", "run", *arguments)


def test(arguments: list[str]) -> None:
    """The first tier, or both with --all; on all cores if no other option is given."""
    python = install("pocl,cfd,rig,studies,dev")
    options = [argument for argument in arguments if argument != "--all"]
    tiers = ["-m", "not long and not hardware"] if "--all" in arguments else []
    parallel = [] if options else ["--numprocesses", "auto", "--dist", "worksteal"]
    call(python, "-m", "pytest", *tiers, *parallel, *options)


def lint() -> None:
    python = install("pocl,cfd,rig,studies,dev")
    call(python, "-m", "ruff", "check", ".")
    call(python, "-m", "ruff", "format", "--check", ".")
    call(python, "-m", "mypy")
    call(python, "-m", "pytest", "-m", "slow", "tests/system/test_types_outside.py")


def docs() -> None:
    python = install("docs")
    call(python, "-m", "mkdocs", "build", "--quiet", "--config-file", "docs/site/mkdocs.yml")
    print(HERE / "build" / "docs" / "index.html")


def wheel() -> None:
    python = install("pocl,cfd,rig,studies,dev")
    with tempfile.TemporaryDirectory(prefix="cldit wheel ") as place:
        call(python, "-m", "build", "--outdir", Path(place) / "dist", HERE)
        built = next(Path(place, "dist").glob("*.whl"))
        call(python, "-m", "twine", "check", "--strict", *Path(place, "dist").iterdir())
        call(python.parent / "check-wheel-contents", built)
        fresh = environment(Path(place) / "venv")
        call(fresh, "-m", "pip", "install", "--quiet", f"{built}[pocl]")
        call(fresh, "-W", "error", "-c", WHEEL_CHECK, cwd=place)
        call(fresh.parent / "cldit", "devices", cwd=place)


def main() -> None:
    if sys.version_info < (3, 11):  # noqa: UP036  (users meet this before any metadata is read)
        sys.exit(f"cldit needs Python 3.11 or newer; this is {sys.version.split()[0]}")
    task, *arguments = sys.argv[1:] or ["help"]
    if task == "run":
        run(arguments)
    elif task == "test":
        test(arguments)
    elif task == "lint":
        lint()
    elif task == "docs":
        docs()
    elif task == "wheel":
        wheel()
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
