"""Files cut off or with a flipped bit: an error in words, or the same figures; nothing else.

A flipped bit in a number is found where the format has a checksum: packed VTK and packed OpenFOAM
files. Elsewhere nobody can tell such a number from another, and what is asked is that import ends
with a spray or an error of cldit's.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import WRITERS
from tests.unit.cfd.reading import FRAME, read, refused, same

CHECKED = ("vtk", "openfoam-gz", "vtkhdf")
KINDS = (*CHECKED, "converge", "tables", "fluent", "cgns", "vtkhdf-by-vtk")
SLOW_KINDS = (*KINDS, "openfoam", "openfoam-binary", "ensight", "ensight-ascii")
QUICK, MANY = 4, 20
TEXTS = (".yaml", ".case")  # what is left of one may be another that is right
EARLIER = (".000.", "post000001")  # of another time


def write(kind: str, folder: Path) -> Path:
    """The sample, without p: beside it a damaged name of rho would make a case of p alone."""
    block, gas, cloud = foam.sample()
    if kind not in WRITERS:
        gas.pop("p")
    return write_format(kind, folder, (block, gas, cloud))


def damaged(
    kind: str, folder: Path, count: int, damage: Callable[[bytes, int], bytes]
) -> list[str]:
    """What was another figure after `damage` to each file at `count` random places."""
    spec = CfdSpray(file=write(kind, folder), **FRAME)
    sound = read_cfd(spec)
    random = np.random.default_rng(20)
    wrong = []
    files = [path for path in folder.rglob("*") if path.is_file() and path.suffix not in TEXTS]
    for file in sorted(files):
        whole = file.read_bytes()
        for place in random.integers(0, 8 * len(whole), count).tolist():
            file.write_bytes(damage(whole, place))
            try:
                if not same(read_cfd(spec), sound):
                    wrong.append(f"{file.name}, bit {place % 8} of byte {place // 8}")
            except SprayError as error:
                assert str(error)
        file.write_bytes(whole)
    return wrong


def flip(whole: bytes, place: int) -> bytes:
    """With one bit turned."""
    content = bytearray(whole)
    content[place // 8] ^= 1 << place % 8
    return bytes(content)


def cut(whole: bytes, place: int) -> bytes:
    """Up to there, and not at the end of a line: the rows of a table are not announced."""
    return whole[: place // 8].rstrip(b"\r\n")


ENDS = [
    "openfoam",
    "openfoam-binary",
    "openfoam-gz",
    "vtk",
    "vtk-legacy",
    "vtkhdf",
    "vtkhdf-by-vtk",
]
ENDS += ["ensight", "ensight-ascii", "converge", "tables", "cgns", "fluent"]


@pytest.mark.parametrize("kind", ENDS)
@pytest.mark.parametrize("left", [0.0, 0.3, 0.7, 0.96])
def test_the_file_that_is_cut_off_is_named(kind: str, left: float, tmp_path: Path) -> None:
    """The last entries of an OpenFOAM field, of its boundary, are not read."""
    left = min(left, {"openfoam": 0.8, "openfoam-binary": 0.8}.get(kind, 1.0))
    case = write(kind, tmp_path)
    for file in sorted(path for path in tmp_path.rglob("*") if path.is_file()):
        unread = file.name.removesuffix(".gz") in ("boundary", "controlDict")
        if unread or file.suffix in TEXTS or any(part in file.name for part in EARLIER):
            continue
        whole = file.read_bytes()
        file.write_bytes(cut(whole, 8 * int(left * len(whole))))
        refused(case, re.escape(str(file)))
        file.write_bytes(whole)
    assert read(case).notes["gas_cells"] == 24


@pytest.mark.parametrize("kind", CHECKED)
def test_flipped(kind: str, tmp_path: Path) -> None:
    assert damaged(kind, tmp_path, QUICK, flip) == []


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in CHECKED])
def test_flipped_without_a_checksum(kind: str, tmp_path: Path) -> None:
    damaged(kind, tmp_path, QUICK, flip)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SLOW_KINDS)
def test_many_places(kind: str, tmp_path: Path) -> None:
    assert damaged(kind, tmp_path / "cut", MANY, cut) == []
    wrong = damaged(kind, tmp_path / "flipped", MANY, flip)
    assert kind not in CHECKED or wrong == []
