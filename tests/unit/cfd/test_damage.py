"""Files cut off or with a flipped bit: an error in words, or the same figures; nothing else.

A flipped bit in a number is found where the format has a checksum: packed VTK and packed OpenFOAM
files. Elsewhere nobody can tell such a number from another, and what is asked is that import ends
with a spray or an error of cldit's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import WRITERS
from tests.unit.cfd.reading import FRAME

CHECKED = ("vtk", "openfoam-gz", "vtkhdf", "parquet")
KINDS = (*CHECKED, "converge", "tables", "fluent", "cgns", "vtkhdf-by-vtk")
SLOW_KINDS = (*KINDS, "openfoam", "openfoam-binary", "ensight", "ensight-ascii")
QUICK, MANY = 4, 20


def write(kind: str, folder: Path) -> Path:
    """The sample, without p: beside it a damaged name of rho would make a case of p alone."""
    block, gas, cloud = foam.sample()
    if kind not in (*WRITERS, "parquet"):
        gas.pop("p")
    return write_format(kind, folder, (block, gas, cloud))


def figures(spec: CfdSpray) -> tuple[object, ...]:
    """All that comes over."""
    spray = read_cfd(spec)
    arrays: list[Any] = []
    if (vapour := spray.vapour) is not None:
        cells = vapour.cells
        arrays += [cells.lower_m, cells.upper_m, vapour.number_density_m3, vapour.temperature_K]
    if (parcels := spray.parcels) is not None:
        arrays += [parcels.position_m, parcels.diameter_m, parcels.droplets]
        arrays += [parcels.temperature_K, parcels.density_kg_m3]
    return (spray.notes, *(values.tobytes() for values in arrays))


def damaged(
    kind: str, folder: Path, count: int, damage: Callable[[bytes, int], bytes]
) -> list[str]:
    """What was another figure after `damage` to each file at `count` random places."""
    spec = CfdSpray(file=write(kind, folder), **FRAME)
    sound = figures(spec)
    random = np.random.default_rng(20)
    wrong = []
    # what is left of a mapping or of EnSight's list of times may be another that is right
    texts = (".yaml", ".case")
    files = [path for path in folder.rglob("*") if path.is_file() and path.suffix not in texts]
    for file in sorted(files):
        whole = file.read_bytes()
        for place in random.integers(0, 8 * len(whole), count).tolist():
            file.write_bytes(damage(whole, place))
            try:
                if figures(spec) != sound:
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


@pytest.mark.parametrize("kind", KINDS)
def test_cut_off(kind: str, tmp_path: Path) -> None:
    assert damaged(kind, tmp_path, QUICK, cut) == []


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
