"""Collated OpenFOAM cases, made from decomposed ones: the same spray comes out."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.importing import list_case
from cldit.cfd.openfoam.regions import is_openfoam
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, refused, same

HEAD = b"FoamFile { version 2.0; format binary; %s class decomposedBlockData; }\n// * //\n"


def collate(parts: list[Path], folder: Path, *, headers: bool = False) -> None:
    """One file of blocks from each file that a part has; later blocks without their header, unless
    `headers`. A part that lacks the file has an empty block."""
    names = sorted({each.relative_to(part) for part in parts for each in part.rglob("*")})
    for name in names:
        files = [part / name for part in parts]
        if not any(file.is_file() for file in files):
            continue
        contents = [file.read_bytes() if file.is_file() else b"" for file in files]
        full = next(content for content in contents if content)
        head, body = full[: full.index(b"}") + 1], contents
        if not contents[0]:
            body = [head + b"\n0\n()\n", *contents[1:]]
        arch = b'arch "LSB;label=32;scalar=64";' if b"arch" in head else b""
        out = HEAD % arch
        for number, content in enumerate(body):
            inside = content if number == 0 or headers else content[content.find(b"}") + 1 :]
            out += b"\n// Processor%d\n%d\n(%s)\n" % (number, len(inside), inside)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(out)


def decomposed(case: Path, *, binary: bool, barycentric: str = "") -> list[Path]:
    """Three processors side by side; the spray has reached the last two."""
    block, gas, cloud = foam.sample()
    form = foam.form(binary=binary)
    parts = []
    for number in range(3):
        wide = np.array([0.02 * number, 0.0, 0.0])
        moved = foam.block((block.edges[0] + wide[0], block.edges[1], block.edges[2]))
        own = None if number == 0 else cloud | {"position": cloud["position"] + wide}
        own_gas = gas | {"T": gas["T"] + number}
        part = case / f"processor{number}"
        foam.write(part, moved, gas=own_gas, cloud=own, form=form, barycentric=barycentric)
        parts.append(part)
    return parts


@pytest.mark.parametrize("barycentric", ["", "coordinates"])
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("folders", ["one", "two", "headers"])
def test_it_is_the_decomposed_case(
    tmp_path: Path, folders: str, binary: bool, barycentric: str
) -> None:
    parts = decomposed(tmp_path / "apart", binary=binary, barycentric=barycentric)
    wanted = read(tmp_path / "apart")
    case = tmp_path / "together"
    if folders == "two":
        collate(parts[:1], case / "processors3_0-0")
        collate(parts[1:], case / "processors3_1-2")
    else:
        collate(parts, case / "processors3", headers=folders == "headers")
    assert is_openfoam(case)
    found = read(case)
    assert found.notes["parcels"] == 2 * 17 and same(found, wanted)
    listed = "\n".join(list_case(CfdSpray(file=case)))
    assert "C7H16" in listed and "sprayCloud" in listed


def test_damaged_cases(tmp_path: Path) -> None:
    parts = decomposed(tmp_path / "apart", binary=True)
    case = tmp_path / "case"
    collate(parts, case / "processors3")

    file = case / "processors3" / "0.001" / "T"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    refused(case, r"processors3/0.001/T: truncated or damaged: block \d does not end")
    collate(parts[:2], case / "processors3")
    file.write_bytes(whole)
    refused(case, r"truncated, or of fewer processors: 2 blocks, no block 2")
    shutil.rmtree(case)
    # A value, a NaN for instance, is told with the block that it is in.
    d = parts[1] / "0.001" / "lagrangian" / "sprayCloud" / "d"
    d.write_bytes(d.read_bytes().replace(b"17\n(", b"16\n("))
    collate(parts, case / "processors3")
    refused(case, r"sprayCloud/d, block 1: truncated, or its header is wrong")
    shutil.rmtree(case)
    collate(parts, case / "processors3_0-1")
    refused(case, r"no folder for processor 2 of 3; it has processors3_0-1")
    collate(parts, case / "processors4")
    refused(case, r"decomposed in more than one way: processors3_0-1, processors4")


def test_folder_and_file_must_agree(tmp_path: Path) -> None:
    parts = decomposed(tmp_path / "apart", binary=False)
    collate(parts, tmp_path / "case" / "processors3")
    mesh = Path("constant") / "polyMesh" / "points"
    shutil.copy(parts[0] / mesh, tmp_path / "case" / "processors3" / mesh)
    refused(tmp_path / "case", "points: is not collated, but in a folder")
    collate(parts[:1], parts[1])
    refused(tmp_path / "apart", "is collated, but not in a folder processorsN")
