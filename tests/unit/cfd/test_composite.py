"""Several data sets, sections or times in one file: VTK's HDF and CGNS."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from cldit.cfd.formats import contents, read_case
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import (
    ZONE,
    node,
    with_sections,
    write_cgns,
    write_elements,
    write_hdf,
    write_hdf_steps,
)
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_converge
from tests.unit.cfd.reading import notes_of, read, refused
from tests.unit.cfd.vtkfiles import block_grid, cloud_data, mark_ghosts


def masses(path: Path, **keys: Any) -> tuple[float, float]:
    notes = notes_of(path, **keys)
    return notes["vapour_mass_kg"], notes.get("liquid_mass_kg", 0.0)


def expected(sample: Any) -> tuple[float, float]:
    block, gas, cloud = sample
    liquid = np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3)
    return float(np.sum(gas["rho"] * gas["C7H16"] * block.volume)), float(liquid)


def test_a_choice_of_clouds(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    blocks = {"internal": block_grid(block, gas), "drops": cloud_data(cloud)}
    file = write_hdf(tmp_path / "a.vtkhdf", blocks)
    assert masses(tmp_path) == masses(file)  # the folder of it
    assert masses(file, cloud="none")[1] == 0.0
    refused(file, r"no cloud 'rain' .* available: drops", cloud="rain")


def test_partitions_and_ghosts(tmp_path: Path) -> None:
    """Two halves, each with the other's first cell as a ghost."""
    sample = foam.sample()
    block, gas, _ = sample
    parts = []
    count = block.cells
    for own in (range(count // 2 + 1), range(count // 2 - 1, count)):
        part = block_grid(block, gas, own)
        mark_ghosts(part.GetCellData(), np.array(own) == own[-1 if own[0] == 0 else 0])
        parts.append(part)
    file = write_hdf(tmp_path / "a.vtkhdf", {"gas": parts, "drops": cloud_data(sample[2])})
    spray = read(file)
    assert spray.notes["gas_cells"] == count
    assert spray.notes["vapour_mass_kg"] == pytest.approx(expected(sample)[0], rel=5e-6)
    assert "omitted: 2 cells" in " ".join(spray.remarks)


def test_times_of_a_file(tmp_path: Path) -> None:
    sample = foam.sample()
    file = write_hdf_steps(tmp_path / "a.vtkhdf", sample, [0.0005, 0.001])
    whole = expected(sample)[0]
    assert masses(file)[0] == pytest.approx(whole, rel=1e-12)
    assert masses(file, time_s=0.0005)[0] == pytest.approx(whole / 2, rel=1e-12)
    assert contents(CfdSpray(file=file)).times_s == (0.0005, 0.001)
    refused(file, r"no time 0\.2 s", time_s=0.2)
    refused(tmp_path, "has several times in it")


@pytest.mark.parametrize("kind", ["", "polyhedra", "mixed"])
def test_cgns_with_values_at_vertices(tmp_path: Path, kind: str) -> None:
    block, gas, _ = sample = foam.sample()
    file = write_cgns(tmp_path / "a.cgns", sample, points=True)
    file = with_sections(file, block, kind) if kind else file
    vapour = gas["rho"].mean() * gas["C7H16"].mean() * block.volume.sum()
    assert masses(file)[0] == pytest.approx(vapour, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "corners", "volume"),
    [
        (10, [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], 1 / 6),
        (12, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)], 1 / 3),
        (14, [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)], 1 / 2),
    ],
)
def test_corners_of_cgns(
    tmp_path: Path, kind: int, corners: list[tuple[float, ...]], volume: float
) -> None:
    """Orders of the standard's figures: the first face counts inwards."""
    file = write_elements(tmp_path / "a.cgns", kind, np.array(corners) * 0.01)
    mesh = read_case(CfdSpray(file=file)).mesh
    assert mesh.measure(np.arange(1)).volume_m3 == pytest.approx([volume * 1e-6], rel=1e-12, abs=0)


def test_parcels_that_a_converter_left_out(tmp_path: Path) -> None:
    """An export with one of the case's two clouds, in the case's folder."""
    sample = foam.sample()
    block, gas, _cloud = sample
    case = foam.case(tmp_path / "case")
    (case / "0.001/lagrangian/rain").mkdir()
    (case / "VTK").mkdir()
    blocks = {"gas": block_grid(block, gas), "sprayCloud": cloud_data(sample[2])}
    file = write_hdf(case / "VTK/a.vtkhdf", blocks)
    said = " ".join(read(file).remarks)
    assert re.search(r"parcels of rain in .*case are not read", said)
    refused(case, r"cloud 'rain' has neither positions nor coordinates", cloud="rain")


def test_a_mesh_in_another_file(tmp_path: Path) -> None:
    sample = foam.sample()
    mesh = write_cgns(tmp_path / "mesh.cgns", sample)
    whole = notes_of(mesh)
    path = write_cgns(tmp_path / "result.cgns", sample)
    with h5py.File(path, "a") as file:
        for name in ("GridCoordinates", "Hexahedra"):
            del file[f"{ZONE}/{name}"]
            link = node(file[ZONE], name, "", form="LK")
            link[" link"] = h5py.ExternalLink("mesh.cgns", f"/{ZONE}/{name}")
    found = read(path)
    assert found.notes == whole
    assert {Path(file.path).name for file in found.files} == {"mesh.cgns", "result.cgns"}
    mesh.rename(tmp_path / "gone.cgns")
    refused(path, r"mesh\.cgns")


@pytest.mark.parametrize("new", [True, False])
def test_streams_of_converge(tmp_path: Path, new: bool) -> None:
    """A solid stream has no fuel, and is left out by name; two files of a time are an error."""
    folder = write_converge(tmp_path / "h5", foam.sample(), new=new)
    expected = read(folder)
    last = max(folder.iterdir())
    assert [Path(file.path) for file in expected.files] == [last]
    with h5py.File(last, "r+") as post:
        post.copy("STREAM_00", "STREAM_01")
        solid = post["STREAM_01"]
        del solid["PARCEL_DATA"], solid["CELL_CENTER_DATA/MASSFRAC_C7H16"]
        solid["CELL_CENTER_DATA/DENSITY"][...] = 7800.0
    spray = read(folder)
    assert spray.notes == expected.notes
    assert any(
        "without C7H16 were omitted" in text and "STREAM_01" in text for text in spray.remarks
    )
    (folder / "copy.h5").write_bytes(last.read_bytes())
    refused(folder, r"2 claim to be time 0\.001: .*copy\.h5")
