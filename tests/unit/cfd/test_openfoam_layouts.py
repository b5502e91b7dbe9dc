"""Regions, times, places of parcels and collated files in OpenFOAM cases."""

from __future__ import annotations

import gzip
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.formats import contents
from cldit.cfd.importing import list_case
from cldit.cfd.openfoam.regions import is_openfoam
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import FRAME, notes_of, read, refused, same


def region(case: Path, name: str, time: str = "0.001") -> None:
    """Makes the only mesh and its fields those of a region."""
    (case / "constant" / "polyMesh").rename(case / "moved")
    (case / "constant" / name).mkdir()
    (case / "moved").rename(case / "constant" / name / "polyMesh")
    (case / time).rename(case / "moved")
    (case / time).mkdir()
    (case / "moved").rename(case / time / name)


def test_regions(tmp_path: Path) -> None:
    expected = notes_of(foam.case(tmp_path / "plain"))
    case = foam.case(tmp_path / "case")
    (case / "case.foam").touch()
    region(case, "gas")
    spray = read(case / "case.foam")
    assert spray.notes == expected
    assert "Region gas, the only one." in spray.remarks
    assert contents(CfdSpray(file=case)).fields == ("gas/C7H16", "gas/T", "gas/p", "gas/rho")
    solid = foam.sample()[0]
    foam.write(case, solid, gas={"T": 400.0, "rho": 2700.0})
    region_of_solid = case / "0.001" / "wall"
    region_of_solid.mkdir()
    for name in ("T", "rho"):
        (case / "0.001" / name).rename(region_of_solid / name)
    (case / "constant" / "wall").mkdir()
    (case / "constant" / "polyMesh").rename(case / "constant" / "wall" / "polyMesh")
    spray = read(case)
    assert spray.notes == expected
    assert "Region gas has C7H16; not read: wall." in spray.remarks
    assert notes_of(case, region="gas") == expected
    refused(case, r"no region 'film' .*available: gas, wall", region="film")
    refused(case, "no cell field 'C7H16'", region="wall")
    shutil.copy(case / "0.001" / "gas" / "C7H16", region_of_solid / "C7H16")
    refused(case, r"2 of its regions .*region to one of gas, wall")
    with pytest.raises(SprayError, match=r"spray\.region is for openfoam; this is converge"):
        read_cfd(CfdSpray(file=tmp_path / "a.h5", region="gas", format="converge"))


@pytest.mark.parametrize("time", ["-12.5", "-3e-05", "345", "1e-3", "0"])
def test_any_number_is_a_time(tmp_path: Path, time: str) -> None:
    case = foam.case(tmp_path, time=time)
    assert notes_of(case)["time_s"] == float(time)
    assert notes_of(case, time_s=float(time))["time_s"] == float(time)
    assert notes_of(case, time_s="latest")["time_s"] == float(time)
    away = float(time) + 1.5
    refused(case, r"the nearest is 1\.5 away: `nearest ", time_s=away)
    spray = read(case, time_s=f"nearest {away}")
    assert any("1.5 away" in text for text in spray.remarks)


def test_two_claims(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")
    (case / "0.001" / "T.gz").write_bytes(gzip.compress((case / "0.001" / "T").read_bytes()))
    refused(case, r"2 claim to be .*001/T: .*001/T, .*T\.gz")
    (case / "0.001" / "T.gz").unlink()
    shutil.copytree(case / "0.001", case / "1e-3")
    refused(case, r"2 claim to be time 0\.001: .*0\.001, .*1e-3")
    shutil.rmtree(case / "1e-3")
    foam.case(case / "processor0")
    for root, age in ((case, 0), (case / "processor0", 100)):
        for file in (root / "0.001").iterdir():
            os.utime(file, (1e9 - age, 1e9 - age))
    spray = read(case)
    assert any("not from the processors" in text for text in spray.remarks)
    os.utime(case / "processor0" / "0.001" / "T")
    refused(case, r"2 claim to be time 0\.001, the processors' being newer")


def test_processor_without_cells(tmp_path: Path) -> None:
    expected = notes_of(foam.case(tmp_path / "plain"))
    case = tmp_path / "case"
    foam.case(case / "processor0")
    form, empty = foam.form(), case / "processor1" / "constant" / "polyMesh"
    for name, kind in (
        ("points", "vectorField"),
        ("owner", "labelList"),
        ("neighbour", "labelList"),
    ):
        form.write(empty / name, kind, b"0\n(\n)\n")
    form.write(empty / "faces", "faceList", b"0\n(\n)\n")
    for name in ("T", "p", "rho", "C7H16"):
        body = b"internalField nonuniform List<scalar> 0();\nboundaryField { }"
        form.write(case / "processor1" / "0.001" / name, "volScalarField", body)
    assert notes_of(case) == expected


def test_parcels_in_another_place(tmp_path: Path) -> None:
    """The Lagrangian library of OpenFOAM 13 has folders of its own."""
    case = foam.case(tmp_path)
    old = case / "0.001" / "lagrangian"
    for new in ("Lagrangian/cloud", "cloud"):
        (case / "0.001" / new).parent.mkdir(exist_ok=True)
        (old / "sprayCloud").rename(case / "0.001" / new)
        shutil.rmtree(old, ignore_errors=True)
        refused(case, r"OpenFOAM 13's .*foamToVTK .*spray\.cloud: none")
        assert "parcels" not in notes_of(case, cloud="none")
        old.mkdir()
        (case / "0.001" / new).rename(old / "sprayCloud")
        shutil.rmtree(case / "0.001" / "Lagrangian", ignore_errors=True)
    assert notes_of(case)["parcels"] == 17


def test_impossible_parcels_are_counted(tmp_path: Path) -> None:
    block, _, cloud = foam.sample()
    many = {name: np.concatenate([values] * 12) for name, values in cloud.items()}
    many["position"] += 1e-9 * np.arange(204)[:, None]  # each place once
    many["d"][3], many["T"][5] = -1e-6, np.nan
    many["position"][7] = [edge[-1] + 1e-4 for edge in block.edges]  # a hundredth of the width
    many["nParticle"][7] *= 1e-3  # light: 1/204 of the parcels, but little of the liquid
    case = foam.case(tmp_path / "case", cloud=many)
    refused(case, r"d: -1e-06 \(entry 3\) .*3 of 204 parcels.* 1 % may")
    spray = read(case, parcels_left_out=0.02)
    assert spray.notes["parcels"] == 201
    assert spray.notes["parcels_left_out"] == 3
    said = [text for text in spray.remarks if text.startswith("Omitted 1 of 204 parcels: ")]
    assert len(said) == 3
    good = np.setdiff1d(np.arange(204), [3, 5, 7])
    mass = many["nParticle"] * many["rho"] * np.pi / 6 * many["d"] ** 3
    assert spray.notes["liquid_mass_kg"] == pytest.approx(mass[good].sum(), rel=1e-12)
    many["nParticle"][7] *= 1e6  # few parcels, but much of the liquid
    case = foam.case(tmp_path / "heavy", cloud=many)
    refused(case, r"3 of 204 parcels are impossible or outside", parcels_left_out=0.02)


def test_mapping_of_an_openfoam_case(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    expected = notes_of(foam.case(tmp_path / "plain"))
    names = {"T": "Tgas", "p": "p_rgh", "rho": "thermo_rho", "C7H16": "Y"}
    drops = {{"d": "diam", "U": "V", "T": "Tp"}.get(name, name): v for name, v in cloud.items()}
    other = {names[name]: values for name, values in gas.items()}
    case = foam.write(tmp_path / "case", block, gas=other, cloud=drops)
    mapping = tmp_path / "names.yaml"
    mapping.write_text(
        "cells: {temperature: Tgas, pressure: p_rgh, density: thermo_rho, fuel: Y}\n"
        "parcels: {diameter: diam, velocity: V, temperature: Tp}\n"
    )
    found = read_cfd(CfdSpray(file=case, mapping=mapping, nozzle_m=FRAME["nozzle_m"]))
    assert found.notes == expected
    refused(case, r"no cell field 'C7H16'|has no field 'd'")


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


def test_times_and_clouds_that_are_not_there(tmp_path: Path) -> None:
    foam.case(tmp_path, cloud=False, time="0")
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
    foam.case(tmp_path, cloud=False)
    shutil.rmtree(tmp_path / "0.001")
    (tmp_path / "VTK").mkdir()
    refused(tmp_path, r"no time with results; its VTK output .*VTK$")


def test_processors_must_have_the_same_fields(tmp_path: Path) -> None:
    for name in ("processor0", "processor1"):
        foam.case(tmp_path / name)
    (tmp_path / "processor1" / "0.001/lagrangian/sprayCloud/T").unlink()
    refused(tmp_path, "only some processors have the field 'T'")
