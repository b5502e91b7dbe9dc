"""Import of CFD files that are flipped, cut, doubled, swapped, or in other units."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Spray
from tests.unit.cfd.composites import write_format
from tests.unit.cfd.conftest import Block, Foam
from tests.unit.cfd.test_damage import cut, flip

FORMATS = ("openfoam", "vtk", "ensight-ascii", "cgns", "tables")
TEXTS = ("openfoam", "ensight-ascii", "tables")  # of lines; the others of numbers of eight bytes
EACH = 80  # files of each format and change: 2,000 in all
PLACE: dict[str, Any] = {"nozzle_m": (0.0, 0.0, 0.0), "axis": "+z"}
OUTCOMES = ("refused", "same", "reported", "silent")
Random = np.random.Generator
# factor and offset of a quantity in another unit
UNITS: tuple[tuple[str, str, float, float], ...] = (
    ("gas", "T", 1.0, -273.15),
    ("gas", "T", 1.8, -459.67),
    ("gas", "p", 1e-5, 0.0),
    ("gas", "p", 1e-6, 0.0),
    ("gas", "rho", 1e-3, 0.0),
    ("gas", "C7H16", 100.0, 0.0),
    ("cloud", "T", 1.0, -273.15),
    ("cloud", "d", 1e6, 0.0),
    ("cloud", "d", 1e3, 0.0),
    ("cloud", "rho", 1e-3, 0.0),
    ("cloud", "position", 1e3, 0.0),
    ("cloud", "position", 1e2, 0.0),
    ("cloud", "nParticle", 1e-9, 0.0),
)


@dataclass(frozen=True)
class Jet(Foam):
    """A jet of 200 parcels in a box of 576 cells; `change` is that of a unit."""

    change: tuple[str, str, float, float] | None = None

    def sample(self, shear: float = 0.0) -> tuple[Block, dict[str, Any], dict[str, Any]]:
        random = np.random.default_rng(11)
        ends = ((-8e-3, 8e-3, 7), (-8e-3, 8e-3, 7), (0.0, 50e-3, 17))
        x, y, z = (np.linspace(*end) for end in ends)
        block = Block((x, y, z), shear)
        middle = block.centre
        width = 1e-3 + 0.15 * middle[:, 2]
        fuel = 0.2 * np.exp(-(middle[:, 0] ** 2 + middle[:, 1] ** 2) / width**2)
        temperature = 800.0 - 900.0 * fuel
        moles = fuel / 0.100204 + (1.0 - fuel) / 0.02885
        gas = {"T": temperature, "p": np.full(block.cells, 5e6), "C7H16": fuel}
        gas["rho"] = gas["p"] / (moles * 8.314463 * temperature)
        age, speed = random.uniform(2e-5, 7e-4, 200), random.normal(55.0, 5.0, 200)
        aside = random.normal(0.0, 3.0, (200, 2))
        velocity = np.column_stack([aside, speed])
        cloud = {"position": velocity * age[:, None], "U": velocity, "age": age}
        for name, low, high in (("d", 5e-6, 3e-5), ("nParticle", 5e2, 4e3), ("T", 340, 400)):
            cloud[name] = random.uniform(low, high, 200)
        cloud["rho"] = random.uniform(600.0, 650.0, 200)
        if self.change is not None:
            part, name, factor, offset = self.change
            fields = gas if part == "gas" else cloud
            fields[name] = fields[name] * factor + offset
        return block, gas, cloud


def _parts(whole: bytes, text: bool) -> list[bytes]:
    if text:
        return whole.splitlines(keepends=True)
    return [whole[at : at + 8] for at in range(0, len(whole), 8)]


def _double(whole: bytes, random: Random, text: bool) -> bytes:
    """A part of the file twice: one row, or many."""
    parts = _parts(whole, text)
    begin = int(random.integers(0, len(parts)))
    some = parts[begin : begin + int(random.choice([1, 10, len(parts)]))]
    return b"".join([*parts[:begin], *some, *some, *parts[begin + len(some) :]])


def _swap(whole: bytes, random: Random, text: bool) -> bytes:
    parts = _parts(whole, text)
    a, b = random.integers(0, len(parts), 2)
    parts[a], parts[b] = parts[b], parts[a]
    return b"".join(parts)


CHANGES: dict[str, Callable[[bytes, Random, bool], bytes]] = {
    "flip": lambda whole, random, _: flip(whole, int(random.integers(0, 8 * len(whole)))),
    "truncate": lambda whole, random, _: cut(whole, 8 * int(random.integers(0, len(whole)))),
    "double": _double,
    "swap rows": _swap,
}


def _outcome(spec: CfdSpray, sound: Spray) -> str:
    try:
        found = read_cfd(spec)
    except SprayError:
        return "refused"
    same = found.notes.keys() == sound.notes.keys() and all(
        np.isclose(value, sound.notes[name], rtol=1e-3) for name, value in found.notes.items()
    )
    if same:
        return "same"
    return "silent" if set(found.remarks) <= set(sound.remarks) else "reported"


def fuzz(kind: str, each: int, seed: int = 1) -> dict[str, Counter[str]]:
    """Counts of `OUTCOMES` by change, of `each` files; "silent" has the files that differ unsaid.

    Same: all printed figures within 0.1 %.
    """
    random = np.random.default_rng(seed)
    counts: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "case"
        spec = CfdSpray(file=write_format(kind, folder, Jet().sample()), **PLACE)
        sound = read_cfd(spec)
        kept = (".yaml", ".case")  # names, units and times that nothing else states
        files = [f for f in sorted(folder.rglob("*")) if f.is_file() and f.suffix not in kept]
        for name, change in CHANGES.items():
            counts[name] = Counter()
            for _ in range(each):
                file = files[int(random.integers(0, len(files)))]
                whole = file.read_bytes()
                file.write_bytes(change(whole, random, kind in TEXTS))
                result = _outcome(spec, sound)
                counts[name][result] += 1
                if result == "silent":
                    counts[name][f"  {file.name}"] += 1
                file.write_bytes(whole)
        counts["units"] = Counter()
        units = [unit for unit in UNITS if unit[0] == "gas" or kind != "cgns"]
        for number in range(each):
            unit = units[number % len(units)]
            shutil.rmtree(folder)
            write_format(kind, folder, Jet(change=unit).sample())
            result = _outcome(spec, sound)
            counts["units"][result] += 1
            if result == "silent":
                counts["units"][f"  {unit[0]} {unit[1]} x {unit[2]:g} + {unit[3]:g}"] += 1
    return counts


def main() -> None:
    """Prints a row of each format and change, and the files of those that nothing told."""
    each = int(sys.argv[1]) if len(sys.argv) > 1 else EACH
    print(f"| format | change | {' | '.join(OUTCOMES)} |")
    print("| --- | --- | " + " | ".join(["---:"] * len(OUTCOMES)) + " |")
    unsaid: Counter[str] = Counter()
    for kind in FORMATS:
        for change, counts in fuzz(kind, each).items():
            row = " | ".join(str(counts[outcome]) for outcome in OUTCOMES)
            print(f"| {kind} | {change} | {row} |", flush=True)
            for key, count in counts.items():
                if key not in OUTCOMES:
                    unsaid[f"{kind}, {change}:{key}"] += count
    print("\nSilent, by file:")
    for key, count in unsaid.most_common():
        print(f"{count:4} {key}")
