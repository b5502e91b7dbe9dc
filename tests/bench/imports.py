"""Peak memory and time of `cldit import` and of vtk's own readers on large cases."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cldit.bench.case import BenchError, Say
from cldit.bench.report import Part
from cldit.cfd.inputs import Size
from cldit.cfd.openfoam.case import foam_size
from cldit.cfd.vtk.head import vtk_size
from cldit.io.plain_data import parse_json
from cldit.show.page import Table
from tests.bench import import_cases as cases
from tests.bench.page import UNLISTED, write_measured

_FIELDS = 4
_HEAD = (
    "case",
    "cells",
    "parcels",
    "vtk, GB",
    "vtk, s",
    "cldit, GB",
    "cldit, s",
    "with --out, GB",
    "with --out, s",
    "expected, GB",
    "memory / vtk",
    "time / vtk",
)


@dataclass(frozen=True)
class Large:
    """Case to be written, and the files that vtk reads."""

    label: str
    write: Callable[..., None]
    cells_a_side: int
    parcels: int

    def files(self, folder: Path) -> list[Path]:
        """Files that vtk reads."""
        return sorted([*folder.rglob("*.vt[up]"), *folder.glob("*.foam")])

    def size(self, folder: Path) -> Size:
        """Size that cldit expects before it reads."""
        if (folder / "constant").is_dir():
            return foam_size([folder / "constant" / "polyMesh"], fields=_FIELDS)
        mesh, *clouds = (vtk_size(file, fields=_FIELDS) for file in self.files(folder))
        return Size(
            mesh.cells,
            sum(cloud.parcels for cloud in clouds),
            mesh.held_bytes + sum(cloud.held_bytes for cloud in clouds),
        )


CASES = (
    Large("hexahedra, .vtu and .vtp", cases.write_hexahedra, 170, 1_000_000),
    Large("polyhedra, .vtu", cases.write_polyhedra, 100, 0),
    Large("OpenFOAM, binary", cases.write_foam, 100, 0),
)


@dataclass(frozen=True)
class Taken:
    """Cost of a process. resident_bytes: peak; wall_s, cpu_s: from start to end."""

    resident_bytes: int
    wall_s: float
    cpu_s: float


def imports(say: Say, large: tuple[Large, ...] = CASES) -> Part:
    """Measures each case with vtk's reader, `cldit import`, and `cldit import --out`."""
    rows, data = [], []
    with tempfile.TemporaryDirectory() as name:
        small = Path(name) / "small"
        for case in large:  # compiles, so that no measurement contains it
            case.write(small / case.write.__name__, cells_a_side=3, parcels=min(case.parcels, 10))
            _apart("cldit", small / case.write.__name__)
        for number, case in enumerate(large):
            folder = Path(name) / str(number)
            sizes = str(case.cells_a_side), str(case.parcels)
            _apart("write", folder, case.write.__name__, *sizes)
            files = map(str, case.files(folder))
            taken = {
                "vtk": _apart("vtk", folder, *files),
                "cldit": _apart("cldit", folder),
                "cldit --out": _apart("cldit", folder, str(folder / "spray.npz")),
            }
            row, more = _row(case, case.size(folder), taken)
            rows.append(row)
            data.append(more)
            say(" | ".join(row))
    return Part(
        name="import",
        title="Importing large CFD cases",
        tables=(Table(_HEAD, rows),),
        data=data,
        text=(
            "Peak resident memory and CPU seconds of vtk's reader, of `cldit import CASE`, and of "
            "the same with `--out`. Expected: the memory that cldit estimates before it reads; it "
            "refuses if less is free.",
        ),
    )


def _row(case: Large, size: Size, taken: dict[str, Taken]) -> tuple[tuple[str, ...], Any]:
    vtk, plain, out = taken.values()
    memory = plain.resident_bytes / vtk.resident_bytes
    times = plain.cpu_s / vtk.cpu_s
    cells = case.cells_a_side**3
    row = [case.label, f"{cells:,}".replace(",", " "), f"{case.parcels:,}".replace(",", " ")]
    for each in (vtk, plain, out):
        row += [f"{each.resident_bytes / 1e9:.2f}", f"{each.cpu_s:.1f}"]
    row += [f"{size.need_bytes / 1e9:.2f}", f"{memory:.1f}", f"{times:.1f}"]
    measured = {how: vars(each) for how, each in taken.items()}
    more = {"case": case.label, "cells": cells, "said_bytes": size.need_bytes, **measured}
    return tuple(row), more | {"memory_ratio": memory, "time_ratio": times}


def _apart(how: str, folder: Path, *more: str) -> Taken:
    """Runs the work in a process of its own."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "tests.bench.import_child", how, str(folder), *more],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise BenchError(f"import: the measuring process failed:\n{done.stderr[-2000:]}")
    found = parse_json(done.stdout.splitlines()[-1])
    return Taken(found["resident_bytes"], time.perf_counter() - start, found["cpu_s"])


def main() -> None:
    """Writes build/benchmarks/import.md; docs/benchmarks/import-formats.md has its table."""
    write_measured(lambda given: imports(given.say), folder=UNLISTED)
