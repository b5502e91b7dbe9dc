"""Damage, impossible values, wrong units and wrong mapping files, in every format."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_converge, write_ensight, write_tables
from tests.unit.cfd.reading import FRAME, notes_of, refused


def test_mapping_of_ensight_and_converge(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    expected = np.sum(cloud["nParticle"] * 700.0 * np.pi / 6 * cloud["d"] ** 3)
    odd = {"position": cloud["position"], "halfmicron": cloud["d"] * 5e5} | {
        "n": cloud["nParticle"],
        "temp": cloud["T"],
    }
    path = write_ensight(tmp_path, (block, gas, odd), binary=True)
    refused(path, r"cloud .* has no field 'd'; it has: halfmicron, n, temp")
    mapping = tmp_path / "names.yaml"
    mapping.write_text(
        "parcels: {radius: {column: halfmicron, unit: um}, number: n, temperature: temp,\n"
        "  density: 700}\n"
    )
    notes = notes_of(path, mapping=mapping)
    assert notes["liquid_mass_kg"] == pytest.approx(expected, rel=1e-6)
    h5py = pytest.importorskip("h5py")
    folder = write_converge(tmp_path / "h5", (block, gas, cloud), new=False)
    with h5py.File(max(folder.iterdir()), "r+") as file:
        del file["STREAM_00/PARCEL_DATA/DENSITY"]
    refused(folder, "has no field 'rho'")
    mapping.write_text("parcels: {density: 700}")
    notes = notes_of(folder, mapping=mapping)
    assert notes["liquid_mass_kg"] == pytest.approx(expected, rel=1e-6)
    case = foam.case(tmp_path / "foam")
    notes = notes_of(case, mapping=mapping)
    assert notes["liquid_mass_kg"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("cells_temperature", "Tmp", r"cells.csv: no column 'Tmp' \(cells.temperature\); it has:"),
        ("cells_fuel", {"column": "Fuel", "unit": "ppm"}, "unit 'ppm' is unknown; allowed: 1, %"),
        ("cells_volume", "dx", "either size or volume"),
        ("cells_header_line", 3, "none of the mapped columns"),
        ("cells_colour", 3, "cells.colour: unknown key; allowed: "),
        ("parcels_diameter", "R", "diameter and radius are both given"),
        ("parcels_density", None, "has no field 'nParticle'"),
    ],
)
def test_mapping_that_is_wrong(tmp_path: Path, key: str, value: Any, message: str) -> None:
    path = write_tables(tmp_path, foam.sample(), **{key: value})
    refused(path, message)


def test_cells_by_volume(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    path = write_tables(tmp_path, (block, gas, cloud))
    lines = (tmp_path / "cells.csv").read_text().splitlines()
    volumes = ["Vol", *(repr(value) for value in (block.volume * 1e9).tolist())]
    joined = [f"{line},{volume}" for line, volume in zip(lines[1:], volumes, strict=True)]
    (tmp_path / "cells.csv").write_text("\n".join(["x", *joined, ""]))
    mapping = yaml.safe_load(path.read_text())
    del mapping["cells"]["size"]
    mapping["cells"]["volume"] = {"column": "Vol", "unit": "mm3"}
    path.write_text(yaml.safe_dump(mapping))
    notes = notes_of(path)
    mass = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert notes["vapour_mass_kg"] == pytest.approx(mass, rel=1e-9)
    (tmp_path / "cells.csv").write_text("\n".join(["x", joined[0], ""]))
    refused(path, r"cells\.csv: no row below its header")
    (tmp_path / "cells.csv").write_text("\n".join(["x", *joined, "1,2,3,4,5,6,oops,1,1,1,1", ""]))
    refused(path, r"cells\.csv: not all numbers: row 25 has 'oops' in the column Temp")


def test_choices_that_are_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sample = foam.sample()
    for path in (
        write_ensight(tmp_path / "e", sample, binary=True),
        write_converge(tmp_path / "c", sample, new=True),
    ):
        refused(path, r"no cloud 'rain' .spray.cloud.", cloud="rain")
        refused(path, r"no time 0\.3 s", time_s=0.3)
    write_ensight(tmp_path / "c", sample, binary=True)
    refused(tmp_path / "c", r"files of converge and ensight; set spray\.format")
    both = CfdSpray(file=tmp_path / "c", format="converge", **FRAME)
    assert read_cfd(both).notes["parcels"] == 17
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(SprayError, match=r'needs h5py; install it with: .* "h5py>='):
        read_cfd(both)


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
