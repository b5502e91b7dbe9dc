"""Damaged, incomplete and implausible OpenFOAM cases: refused, with file and field by name."""

from __future__ import annotations

import gzip
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, refused

CLOUD = "0.001/lagrangian/sprayCloud"


def replace(file: Path, old: bytes, new: bytes) -> None:
    """The first match of a regular expression."""
    changed, count = re.subn(old, new, file.read_bytes(), count=1)
    assert count, "the test must change something"
    file.write_bytes(changed)


FIRST = rb"\n\(\n[^\n]+\n"  # the first number of a list

MISSING: list[tuple[str, str]] = [
    ("0.001/T", "0.001: no cell field 'T'; it has: C7H16, p, rho"),
    ("0.001/C7H16", r"no cell field 'C7H16' \(spray.fuel_field\); it has: T, p, rho"),
    ("constant/polyMesh/points", "constant/polyMesh/points: is missing"),
    (f"{CLOUD}/d", "sprayCloud: cloud 'sprayCloud' has no field 'd'; it has: T, U, nParticle, rho"),
    (f"{CLOUD}/nParticle", "has no field 'nParticle'"),
    (f"{CLOUD}/positions", "sprayCloud: the cloud 'sprayCloud' has neither positions nor coord"),
]


@pytest.mark.parametrize(("file", "message"), MISSING)
def test_missing_file(tmp_path: Path, file: str, message: str) -> None:
    foam.case(tmp_path)
    (tmp_path / file).unlink()
    refused(tmp_path, message)


CHANGES: list[tuple[str, bytes, bytes, str]] = [
    (
        "0.001/T",
        FIRST,
        b"\n(\nnan\n",
        r"0.001/T: nan \(entry 0\) is outside 1..5000 .*; this cell is at \(",
    ),
    ("0.001/T", FIRST, b"\n(\nabc\n", "0.001/T: (truncated or|contains text)"),
    ("0.001/T", FIRST, b"\n(\n", "0.001/T: truncated or damaged: 23 numbers, expected 24"),
    ("0.001/T", rb"\n24\n\(\n[^\n]+", b"\n23\n(", "0.001/T: 23 values, but the mesh has 24 cells"),
    ("0.001/T", b"nonuniform", b"uniform", "0.001/T: internalField is .uniform List"),
    ("0.001/T", b"FoamFile", b"Foam", "0.001/T: is not an OpenFOAM file"),
    ("0.001/C7H16", FIRST, b"\n(\n1.2\n", "C7H16: 1.2 .* it must be the mass fraction"),
    ("0.001/rho", FIRST, b"\n(\ninf\n", r"0.001/rho: inf \(entry 0\) is outside 0..2000"),
    (f"{CLOUD}/d", FIRST, b"\n(\n9\n", "sprayCloud/d: 9 .* diameter of a droplet in metres"),
    (f"{CLOUD}/nParticle", FIRST, b"\n(\n-1\n", "sprayCloud/nParticle: -1 "),
    (f"{CLOUD}/T", FIRST, b"\n(\n1e5\n", r"sprayCloud/T: 100000 \(entry 0\) .*in K"),
    (f"{CLOUD}/rho", FIRST, b"\n(\n0.6\n", "sprayCloud/rho: 0.6 .* density in kg/m3"),
    (f"{CLOUD}/rho", rb"\n17\n\(\n[^\n]+", b"\n16\n(", "sprayCloud/rho: 16 values for 17 parcels"),
    (
        f"{CLOUD}/positions",
        rb"\n\(\(?\n\([^)]+\)",
        b"\n(\n(0 5 0)",
        "positions: parcel 0 at .0, 5, 0",
    ),
    (
        f"{CLOUD}/positions",
        rb"\n\(\n\([^)]+\)",
        b"\n(\n(nan 0 0)",
        "positions: parcel 0 at .nan, 0",
    ),
    (f"{CLOUD}/positions", rb"(?s)\n17\n\(.*\)\n", b"\n0()\n", "has no parcel; choose another"),
    ("constant/polyMesh/owner", FIRST, b"\n(\n-1\n", "polyMesh: owner labels -1 to 23"),
    ("constant/polyMesh/owner", FIRST, b"\n(\n0.5\n", "owner: a label is no whole"),
    ("constant/polyMesh/neighbour", FIRST, b"\n(\n900\n", "24 values, but the mesh has 901 cells"),
    ("constant/polyMesh/faces", rb"\n\(\n4\(\d+", b"\n(\n4(99999", "polyMesh: point labels"),
    ("constant/polyMesh/faces", rb"\n\(\n4\(", b"\n(\n7(", "faces: truncated or damaged"),
    ("constant/polyMesh/points", rb"\n\(\(?\n?\([^)]+\)", b"\n(\n(nan 0 0)", "a point of the mesh"),
    ("constant/polyMesh/points", rb"\n\(\(?\n?\([^)]+\)", b"\n(\n(9 9 9)", ""),
]


@pytest.mark.parametrize(("file", "old", "new", "message"), CHANGES)
def test_impossible_content(
    tmp_path: Path, file: str, old: bytes, new: bytes, message: str
) -> None:
    foam.case(tmp_path)
    assert notes_of(tmp_path)["parcels"] == 17
    replace(tmp_path / file, old, new)
    if not message:  # a corner pulled out of place leaves a cell that is crooked, not open
        assert notes_of(tmp_path)["parcels"] == 17
        return
    refused(tmp_path, message)


def test_a_binary_list_without_its_length(tmp_path: Path) -> None:
    foam.case(tmp_path, form=foam.form(binary=True))
    replace(tmp_path / "0.001/T", rb"\n24\n?\(", b"\n(")
    refused(tmp_path, "T: a binary list without its length")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda row: row.__setitem__(4, 24), "a parcel in cell 24, but the mesh has 24"),
        (lambda row: row.__setitem__(5, 9999), "a parcel in face 9999"),
        (lambda row: row.__setitem__(4, (row[4] + 7) % 24), r"parcel 0: face \d+ does not belong"),
        (lambda row: row.__setitem__(6, 3), "parcel 0: point 3 of a face of 4 points"),
        (lambda row: row.__setitem__(0, 7.0), "do not sum to one"),
    ],
)
def test_barycentric_labels(
    tmp_path: Path, change: Callable[[list[float]], None], message: str
) -> None:
    block, gas, cloud = foam.sample()
    foam.write(tmp_path, block, gas=gas, cloud=cloud, barycentric="coordinates")
    weights, labels = block.barycentric(cloud["position"])
    row = [*weights[0].tolist(), *labels[0].tolist()]
    change(row)
    weights[0], labels[0] = row[:4], row[4:]
    body = foam.form().records(weights, labels)
    file = tmp_path / CLOUD / "coordinates"
    foam.form().write(file, "Cloud<passiveParticle>", body)
    refused(tmp_path, f"{CLOUD}/coordinates: .*{message}")


def test_times_and_clouds_that_are_not_there(tmp_path: Path) -> None:
    foam.case(tmp_path, cloud=None, time="0")
    foam.case(tmp_path)
    refused(tmp_path, r"no time 0\.002 s \(spray\.time_s\); available: 0, 0\.001", time_s=0.002)
    refused(tmp_path, r"no cloud 'rain' .spray.cloud.; available: sprayCloud", cloud="rain")
    refused(
        tmp_path, r"no parcels at this time, but at others: 0\.001 ", cloud="sprayCloud", time_s=0.0
    )
    foam.case(tmp_path, name="rain")
    refused(tmp_path, r"several clouds: rain, sprayCloud; set spray\.cloud")
    assert notes_of(tmp_path, cloud="rain")["parcels"] == 17


def test_paths_that_are_no_case(tmp_path: Path) -> None:
    refused(tmp_path / "nothing", "no such file or folder")
    refused(tmp_path / "nothing" / "case.foam", "no such file or folder")
    refused(tmp_path, "no case that is read, but: nothing; allowed:")
    foam.case(tmp_path, cloud=None)
    shutil.rmtree(tmp_path / "0.001")
    (tmp_path / "VTK").mkdir()
    refused(tmp_path, r"no time with results; its VTK output .*VTK$")


def test_neither_density_nor_pressure(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    foam.write(tmp_path, block, gas={name: gas[name] for name in ("T", "C7H16")})
    refused(tmp_path, r"0\.001: neither rho nor p among the cell fields")


def test_processors_must_have_the_same_fields(tmp_path: Path) -> None:
    for name in ("processor0", "processor1"):
        foam.case(tmp_path / name)
    (tmp_path / "processor1" / CLOUD / "T").unlink()
    refused(tmp_path, "only some processors have the field 'T'")


def test_binary_of_another_number_size(tmp_path: Path) -> None:
    """A header that lies about its number size must not be read as other numbers."""
    foam.case(tmp_path, form=foam.form(binary=True))
    for name, old, new in (
        ("constant/polyMesh/owner", b"label=32", b"label=64"),
        ("0.001/T", b"scalar=64", b"scalar=32"),
        (f"{CLOUD}/positions", b"label=32", b"label=64"),
    ):
        file = tmp_path / name
        before = file.read_bytes()
        replace(file, old, new)
        refused(tmp_path, re.escape(str(file)))
        file.write_bytes(before)
    assert notes_of(tmp_path)["parcels"] == 17


def test_gz_that_is_none(tmp_path: Path) -> None:
    foam.case(tmp_path, cloud=None, form=foam.form(gz=True))
    packed = tmp_path / "0.001" / "T.gz"
    packed.write_bytes(gzip.decompress(packed.read_bytes()))
    refused(tmp_path, r"0\.001/T\.gz: cannot be read")
