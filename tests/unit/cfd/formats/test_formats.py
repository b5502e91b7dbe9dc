"""One small case in every format: the same masses, sizes and penetration; vtk reads it too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.formats import contents
from cldit.cfd.to_spray import read_cfd
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import WRITERS, write_converge, write_ensight
from tests.unit.cfd.reading import FRAME, notes_of, read, refused

KINDS = list(WRITERS)
FIGURES = (
    "liquid_mass_kg",
    "vapour_mass_kg",
    "sauter_mean_diameter_m",
    "liquid_penetration_95_m",
    "vapour_penetration_m",
    "droplets",
    "gas_temperature_max_K",
)


@pytest.mark.parametrize("kind", KINDS)
def test_same_figures_in_every_format(tmp_path: Path, kind: str) -> None:
    write, slack = WRITERS[kind]
    block, gas, cloud = sample = foam.sample()
    path = write(tmp_path / "other", sample)
    spray = read(path)
    expected = read(foam.write(tmp_path / "foam", block, gas=gas, cloud=cloud))
    mass = np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(mass, rel=slack)
    vapour = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(vapour, rel=slack)
    for name in FIGURES:
        assert spray.notes[name] == pytest.approx(expected.notes[name], rel=slack), name
    assert spray.notes["time_s"] == 0.001
    assert spray.parcels is not None
    assert expected.parcels is not None
    wanted = expected.parcels.position_m
    assert spray.parcels.position_m == pytest.approx(wanted, abs=10e-3 * slack, rel=0)
    found = contents(CfdSpray(file=path))
    assert found.format == kind.split("-")[0]
    assert found.times_s[-1] == 0.001
    assert len(found.clouds) == 1
    axis = {key: FRAME[key] for key in ("nozzle_m",)}
    inferred = read_cfd(CfdSpray(file=path, **axis))  # the velocity came over
    assert inferred.notes["axis_y"] == -1.0


def test_sheared_cells_and_earlier_time(tmp_path: Path) -> None:
    block, gas, _ = sample = foam.sample(shear=0.4)
    vapour = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    for polyhedra in (False, True):
        path = write_ensight(tmp_path / str(polyhedra), sample, binary=True, polyhedra=polyhedra)
        now = notes_of(path)
        assert now["vapour_mass_kg"] == pytest.approx(vapour, rel=5e-6)
        early = notes_of(path, time_s=0.0005)
        assert early["vapour_mass_kg"] == pytest.approx(vapour / 2, rel=5e-6)
    folder = write_converge(tmp_path / "h5", sample, new=True)
    assert notes_of(folder)["vapour_mass_kg"] == pytest.approx(vapour, rel=5e-6)
    first = min(folder.iterdir())
    assert notes_of(first)["time_s"] == 0.0005
    refused(folder, r"no time 0\.002 s .* available: 0\.0005, 0\.001", time_s=0.002)


@pytest.mark.parametrize("new", [False, True])
def test_vtk_reads_the_same_post_file(tmp_path: Path, new: bool) -> None:
    """That the layout written here is CONVERGE's is vtk's word, not the reader's own."""
    pytest.importorskip("vtkmodules")
    from vtkmodules.vtkIOCONVERGECFD import vtkCONVERGECFDReader

    block, _, cloud = sample = foam.sample()
    folder = write_converge(tmp_path, sample, new=new)
    reader: Any = vtkCONVERGECFDReader()
    reader.SetFileName(str(min(folder.iterdir())))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    mesh, parcels = parts[0], parts[-1]
    assert mesh.GetNumberOfCells() == block.cells
    assert parcels.GetNumberOfPoints() == len(cloud["d"])
    radius = parcels.GetPointData().GetArray("RADIUS").GetValue(3)
    assert 2 * radius == pytest.approx(cloud["d"][3], rel=1e-6)
    assert parcels.GetPointData().GetArray("VELOCITY").GetNumberOfComponents() == 3


@pytest.mark.parametrize("binary", [False, True])
def test_vtk_reads_the_same_ensight(tmp_path: Path, binary: bool) -> None:
    pytest.importorskip("vtkmodules")
    from vtkmodules.vtkIOEnSight import vtkEnSightGoldCombinedReader

    block, gas, cloud = sample = foam.sample()
    reader: Any = vtkEnSightGoldCombinedReader()
    reader.SetCaseFileName(str(write_ensight(tmp_path, sample, binary=binary)))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    assert parts[0].GetNumberOfCells() == block.cells
    assert parts[0].GetCellData().GetArray("T").GetValue(5) == pytest.approx(gas["T"][5], rel=1e-5)
    drops = next(part for part in parts if part.GetPointData().GetArray("d") is not None)
    found = [drops.GetPointData().GetArray("d").GetValue(n) for n in range(17)]
    assert found == pytest.approx(cloud["d"], rel=1e-5)
