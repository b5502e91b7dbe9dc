"""Records what the program gives, and compares two records to the bit.

`python -m tests.bench.proof record OUT.json [--cases FOLDER ...] [--scenes NAME ...] [--free GB]`
`python -m tests.bench.proof compare BEFORE.json AFTER.json`

A record holds the help of every command, the names of the API pages, the scene reference, and for
each shipped scene at two accuracies and three seeds a digest of every array of weights and maps,
the stated errors, the remarks and core seconds. An acquisition is simulated and evaluated, and
every CFD case below `--cases` is read. It also runs on older code: put that tree first on
PYTHONPATH. Free memory limits the cells of some scenes at 1 K, so that their bits depend on what
else the machine runs: `--free` sets the same limit for both records.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

Record = dict[str, Any]
SEEDS = (1, 2, 3)
ACCURACIES_K = (4.0, 1.0)
PIXELS = 64


def digest(array: Any) -> str:
    data = np.ascontiguousarray(array)
    return hashlib.sha256(f"{data.dtype}{data.shape}".encode() + data.tobytes()).hexdigest()[:16]


def arrays(folder: Path) -> dict[str, str]:
    """Digests of all images below a folder, by their relative path."""
    import tifffile

    found = {}
    for file in sorted(folder.rglob("*.tif")):
        if "shots" not in file.parts:
            found[file.relative_to(folder).as_posix()] = digest(tifffile.imread(file))
    return found


def helps() -> dict[str, str]:
    """The help of every command and subcommand."""
    import click

    from cldit.cli import main as root

    texts: dict[str, str] = {}

    def walk(words: tuple[str, ...], command: click.Command, parent: click.Context | None) -> None:
        context = click.Context(command, info_name=words[-1], parent=parent, terminal_width=100)
        texts[" ".join(words)] = command.get_help(context)
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                inner = command.get_command(context, name)
                if inner is not None:
                    walk((*words, name), inner, context)

    walk(("cldit",), root, None)
    return texts


def api_names(root: Path) -> list[str]:
    lines = [line for page in sorted((root / "docs" / "api").glob("*.md"))
             for line in page.read_text(encoding="utf-8").splitlines()]  # fmt: skip
    return sorted(line.removeprefix("::: ") for line in lines if line.startswith("::: "))


def one_run(name: str, accuracy_K: float, seed: int, cache: Path) -> Record:
    """One shipped scene, traced and stored; in this process, so that its core seconds are known."""
    import cldit
    from cldit.scene import parse_scene

    data = cldit.load_scene(name).model_dump(mode="json")
    data["transport"]["accuracy_K"] = accuracy_K
    data["transport"]["seed"] = seed
    data["camera"]["pixels"] = [PIXELS, PIXELS]
    if data["spray"].get("seed") is not None:
        data["spray"]["seed"] = seed
    with tempfile.TemporaryDirectory() as place:
        begun = time.process_time()
        run = cldit.simulate(parse_scene(data), Path(place) / "run", cache=cache)
        core_s = time.process_time() - begun
        errors = run.errors
        return {
            "arrays": arrays(Path(place) / "run"),
            "stated": None if errors is None else errors.text,
            "causes": [] if errors is None
            else [[each.name, each.error_K, each.fixed] for each in errors.causes],
            "remarks": list(run.info.remarks),
            "core_s": round(core_s, 2),
        }  # fmt: skip


def set_free_memory(free_bytes: int) -> None:
    """Replaces the free memory of the machine where cells are chosen, here and in older code."""
    for name in ("cldit.prepare.cell_choice", "cldit.run.cell_choice"):
        with suppress(ImportError):
            module: Any = importlib.import_module(name)
            module.free_bytes = lambda: free_bytes


def experiment() -> Record:
    """One simulated acquisition from trace to evaluated maps."""
    import cldit
    from cldit.api.experiment import run_experiment
    from cldit.scene import parse_scene

    data = cldit.load_scene("gdi-cone").model_dump(mode="json")
    data["camera"]["pixels"] = [PIXELS, PIXELS]
    data["transport"]["accuracy_K"] = 4.0
    with tempfile.TemporaryDirectory() as place:
        run_experiment(parse_scene(data), Path(place) / "run")
        return {"arrays": arrays(Path(place) / "run")}


def cases(folders: list[Path]) -> Iterator[tuple[str, Record]]:
    """The totals and parcels of every CFD case that `cldit import` reads, or its refusal."""
    from cldit.cfd.importing import cfd_spray, imported
    from cldit.errors import ClditError

    for folder in folders:
        for path in sorted(folder.iterdir()):
            keys = {"model": "cfd", "file": str(path)}
            try:
                spray = imported(cfd_spray(keys), None)
            except ClditError as error:
                yield path.name, {"refused": str(error).replace(str(folder), "")}
                continue
            parts = {"parcels": spray.parcels, "vapour": spray.vapour}
            yield path.name, {"notes": spray.notes, "remarks": list(spray.remarks)} | {
                f"{part}.{name}": digest(value)
                for part, held in parts.items() if held is not None
                for name, value in sorted(vars(held).items()) if isinstance(value, np.ndarray)
            }  # fmt: skip


def record(out: Path, folders: list[Path], scenes: list[str]) -> None:
    import cldit

    root = Path(cldit.__file__).resolve().parents[1]
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=root, capture_output=True, text=True)
    found: Record = {
        "commit": commit.stdout.strip(),
        "help": helps(),
        "api": api_names(root),
        "scene_reference": digest(
            np.frombuffer(json.dumps(cldit.Scene.model_json_schema()).encode(), np.uint8)
        ),
        "runs": {},
        "cases": dict(cases(folders)),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as place:
        cache = Path(place)
        for name in scenes or cldit.shipped_scenes():
            for accuracy_K in ACCURACIES_K:
                for seed in SEEDS:
                    key = f"{name} {accuracy_K:g} K seed {seed}"
                    found["runs"][key] = one_run(name, accuracy_K, seed, cache)
                    print(key, found["runs"][key]["stated"], found["runs"][key]["core_s"],
                          flush=True)  # fmt: skip
                    out.write_text(json.dumps(found, indent=1), encoding="utf-8")
        os.environ["CLDIT_CACHE"] = str(cache)
        found["experiment"] = experiment()
    out.write_text(json.dumps(found, indent=1), encoding="utf-8")


def compare(before: Record, after: Record) -> int:
    """Prints what differs; the number of runs whose arrays or stated errors do."""
    changed = 0
    for key, old in before["runs"].items():
        new = after["runs"].get(key)
        if new is None:
            print(f"{key}: missing")
            changed += 1
            continue
        other = sorted(name for name in old["arrays"].keys() | new["arrays"].keys()
                       if old["arrays"].get(name) != new["arrays"].get(name))  # fmt: skip
        if other or old["causes"] != new["causes"]:
            print(f"{key}: {len(other)} arrays differ {other[:3]}; {old['stated']} {new['stated']}")
            changed += 1
    spent = [sum(run["core_s"] for run in each["runs"].values()) for each in (before, after)]
    print(f"core seconds {spent[0]:.1f} before, {spent[1]:.1f} after")
    for key in ("experiment", "api", "scene_reference", "help", "cases"):
        print(f"{key}: {'equal' if before.get(key) == after.get(key) else 'differs'}")
    print(f"{changed} of {len(before['runs'])} runs differ")
    return changed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    tasks = parser.add_subparsers(dest="task", required=True)
    made = tasks.add_parser("record")
    made.add_argument("out", type=Path)
    made.add_argument("--cases", type=Path, nargs="*", default=[])
    made.add_argument("--scenes", nargs="*", default=[])
    made.add_argument("--free", type=float, metavar="GB", help="free memory that is assumed")
    both = tasks.add_parser("compare")
    both.add_argument("before", type=Path)
    both.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.task == "record":
        if given.free is not None:
            set_free_memory(round(1e9 * given.free))
        record(given.out, given.cases, given.scenes)
    else:
        sys.exit(bool(compare(*(json.loads(path.read_text(encoding="utf-8"))
                                for path in (given.before, given.after)))))  # fmt: skip


if __name__ == "__main__":
    main()
