"""Files that are not read are named for what they are, with the export that is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray

KINDS = [
    ("engine.sim", r"is a session, mesh or tracks of STAR-CCM\+, .*EnSight Gold"),
    ("cells.csv", r"is a table, .*mapping file \(\.yaml\)"),
    ("cells.parquet", "is a Parquet table, .*save it as CSV"),
    ("parcels.XLSX", "is a spreadsheet, .*save it as CSV"),
    ("case.tar.gz", "is an archive, .*unpack it"),
    ("notes.xyz", r"is of no kind that is read; allowed: an OpenFOAM case"),
]


@pytest.mark.parametrize(("name", "message"), KINDS)
def test_files(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(SprayError, match=rf"{name}: {message}"):
        read_cfd(CfdSpray(file=tmp_path / name))
    if "no kind" not in message:
        what = message.partition(", ")[0].removeprefix("is ")
        if not name.endswith(".h5"):
            with pytest.raises(SprayError, match=f"no case that is read; {name} is {what}"):
                read_cfd(CfdSpray(file=tmp_path))


def test_an_empty_folder_and_an_openfoam_case_without_a_mesh(tmp_path: Path) -> None:
    with pytest.raises(SprayError, match="no case that is read, but: nothing; allowed:"):
        read_cfd(CfdSpray(file=tmp_path))
    (tmp_path / "case.foam").touch()
    with pytest.raises(SprayError, match="no mesh: neither constant/polyMesh nor constant/REGION"):
        read_cfd(CfdSpray(file=tmp_path / "case.foam"))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["spray0.f00012"], "is a field file of Nek5000: with its .nek5000 file open it in ParaV"),
        (["otape17"], "is a file of KIVA: convert it to GMV"),
        (["run.silo"], "is a file of Tecplot, Silo, VisIt"),
    ],
)
def test_other_programs_by_name(tmp_path: Path, names: list[str], message: str) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(SprayError, match=message):
        read_cfd(CfdSpray(file=(tmp_path / names[0]).parent))
