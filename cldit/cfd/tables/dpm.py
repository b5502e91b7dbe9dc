"""Fluent's samples of particles (.dpm).

Two lines in parentheses name the surface and the columns; each further line is a parcel:
`((x y z ... flow-rate) injection-0:17)` (Fluent's User's Guide, "Sampling of Trajectories"; no file
written by Fluent was at hand).
"""

import re
from pathlib import Path

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.inputs import text_of
from cldit.errors import SprayError

DENSITY = "mass-density"  # of a droplet: mass over volume, as Fluent gives none
_ROW = re.compile(r"\(\(([^()]*)\)\s*([^()\s]*)\s*\)\s*$")


def dpm_names(file: Path) -> list[str]:
    """Names of the columns; with `DENSITY` if mass and diameter are among them."""
    return _named(file, text_of(file).splitlines())


def _named(file: Path, lines: list[str]) -> list[str]:
    head = [line.strip() for line in lines[:2]]
    if len(head) < 2 or not all(re.fullmatch(r"\([^()]+\)", line) for line in head):
        raise SprayError(
            f"{file}: does not begin with Fluent's two lines, (surface count) and (x y z ... name)"
        )
    names = head[1][1:-1].split()
    if names[-1] == "name":
        names.pop()
    return [*names, *([DENSITY] if {"mass", "diameter"} <= set(names) else [])]


def dpm_columns(file: Path) -> dict[str, Column]:
    """All columns (N,) by name."""
    content = text_of(file)
    names = _named(file, content.splitlines())
    written = [name for name in names if name != DENSITY]
    rows = []
    for number, line in enumerate(content.splitlines()[2:], start=3):
        if not line.strip():
            continue
        match = _ROW.match(line.strip())
        try:
            row = [] if match is None else [float(part) for part in match[1].split()]
        except ValueError:
            row = []
        if len(row) != len(written):
            layout = f"{len(written)} numbers in double parentheses, and a name"
            raise SprayError(f"{file}: line {number}: expected: {layout}")
        rows.append(row)
    if not rows or not content.endswith("\n"):
        raise SprayError(f"{file}: " + ("no parcel in it" if not rows else "is cut off"))
    table = np.array(rows)
    columns = {
        name: Column(f"{file}: column {name}", table[:, place])
        for place, name in enumerate(written)
    }
    if DENSITY in names:
        diameter = columns["diameter"].values
        if not np.all(diameter >= 0):
            bad = int(np.argmin(diameter >= 0))
            label = columns["diameter"].label
            raise SprayError(f"{label}: {diameter[bad]:g} (entry {bad}) is not a size")
        volume = np.where(diameter > 0, np.pi / 6 * diameter**3, np.nan)  # none of a dummy
        density = columns["mass"].values / volume
        columns[DENSITY] = Column(f"{file}: columns mass and diameter", density)
    return columns
