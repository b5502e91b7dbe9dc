"""Files as ParaView's users save them: pairs, blocks, pieces, series; what is named is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.scene.spray import CfdSpray

pytest.importorskip("vtkmodules")

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import FRAME, notes_of, read, refused
from tests.unit.cfd.vtkfiles import (
    block_grid,
    cloud_data,
    collection,
    gas_file,
    mark_ghosts,
    parcels_file,
    pieces,
    pvd,
    save,
    stamped,
    vertices,
)

FIGURES = ("liquid_mass_kg", "vapour_mass_kg", "sauter_mean_diameter_m", "liquid_penetration_95_m")


@pytest.fixture
def expected(tmp_path: Path) -> dict[str, float]:
    return notes_of(foam.case(tmp_path / "expected"))


def pair(folder: Path) -> Path:
    gas_file(folder / "gas.vtu")
    parcels_file(folder / "drops.vtp")
    return folder


def blocks(folder: Path) -> Path:
    gas_file(folder / "all" / "all_0.vtu")
    parcels_file(folder / "all" / "all_1.vtp")
    return collection(folder / "all.vtm", {"gas": "all/all_0.vtu", "drops": "all/all_1.vtp"})


def blocks_of_vtk(folder: Path) -> Path:
    """Blocks in blocks, by vtk's own writer."""
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkMultiBlockDataSet
    from vtkmodules.vtkIOXML import vtkXMLMultiBlockDataWriter

    block, gas, cloud = foam.sample()
    inner: Any = vtkMultiBlockDataSet()
    inner.SetBlock(0, cloud_data(cloud))
    inner.GetMetaData(0).Set(vtkCompositeDataSet.NAME(), "rain")
    outer: Any = vtkMultiBlockDataSet()
    outer.SetBlock(0, block_grid(block, gas))
    outer.SetBlock(1, inner)
    folder.mkdir()
    writer: Any = vtkXMLMultiBlockDataWriter()
    writer.SetInputData(outer)
    writer.SetFileName(str(folder / "all.vtm"))
    writer.Write()
    return folder / "all.vtm"


def vertex_grids(folder: Path) -> Path:
    gas_file(folder / "a.vtu")
    parcels_file(folder / "b.vtu")
    return folder


def series(folder: Path) -> Path:
    block, gas, cloud = foam.sample()
    for step, share in (("0007", 0.5), ("0008", 1.0)):
        now = gas | {"C7H16": gas["C7H16"] * share}
        save(folder / f"gas_{step}.vtu", stamped(block_grid(block, now), float(step)))
        save(folder / f"drops_{step}.vtp", cloud_data(cloud))
    return folder


def listed(folder: Path) -> Path:
    series(folder)
    steps = {"-12.5": ["gas_0007.vtu"], "3.25": ["gas_0008.vtu"]}
    pvd(folder / "gas.pvd", steps)
    pvd(folder / "drops.pvd", {"-12.5": ["drops_0007.vtp"], "3.25": ["drops_0008.vtp"]})
    return folder


def parallel(folder: Path) -> Path:
    """Two halves of the mesh, a ghost cell of the other's in each; the parcels in two files."""
    block, gas, cloud = foam.sample()
    half = block.cells // 2
    for number, own in enumerate((range(half), range(half, block.cells))):
        ghost = half if number == 0 else half - 1
        kept = [*own, ghost]
        ghosts = np.arange(len(kept)) == half
        grid = block_grid(block, gas, kept)
        mark_ghosts(grid.GetCellData(), ghosts)
        save(folder / "gas" / f"gas_{number}.vtu", grid)
        part = slice(0, 5) if number == 0 else slice(5, None)
        some = {name: values[part] for name, values in cloud.items()}
        save(folder / "drops" / f"drops_{number}.vtp", cloud_data(some))
    pieces(folder / "gas.pvtu", ["gas/gas_0.vtu", "gas/gas_1.vtu"])
    pieces(folder / "drops.pvtp", ["drops/drops_0.vtp", "drops/drops_1.vtp"])
    return folder


LAYOUTS = [pair, blocks, blocks_of_vtk, vertex_grids, series, listed, parallel]


def test_ghosts_of_pieces(tmp_path: Path) -> None:
    spray = read(parallel(tmp_path / "vtk"))
    assert "Marked as ghost or hidden, omitted: 2 cells." in spray.remarks
    assert len(spray.files) == 6


def test_times_of_a_list(tmp_path: Path, expected: dict[str, float]) -> None:
    folder = listed(tmp_path / "vtk")
    assert notes_of(folder)["time_s"] == 3.25
    assert notes_of(folder, time_s="latest")["time_s"] == 3.25
    early = notes_of(folder, time_s=-12.5)
    assert early["vapour_mass_kg"] == pytest.approx(expected["vapour_mass_kg"] / 2, rel=5e-6)
    near = read(folder, time_s="nearest -10")
    assert near.notes["time_s"] == -12.5
    assert "Time -12.5 is the nearest to -10: 2.5 away." in near.remarks
    refused(folder, r"available: -12\.5, 3\.25; the nearest is 2\.5 away", time_s=-10)


def test_a_named_file_bounds_the_search(tmp_path: Path) -> None:
    air = gas_file(tmp_path / "air.vtu")
    block, gas, _ = foam.sample()
    save(tmp_path / "zone.vtu", block_grid(block, gas | {"C7H16": 0.0 * gas["C7H16"]}))
    spray = read(air)
    assert spray.notes["vapour_mass_kg"] > 0
    assert [Path(file.path).name for file in spray.files] == ["air.vtu"]
    assert any("no parcels in it: gas alone" in text for text in spray.remarks)
    refused(tmp_path, r"2 claim to be the mesh of the gas: .*air.*zone")
    parcels_file(tmp_path / "drops.vtp")
    refused(air, r"some in .*drops\.vtp.*spray.cloud: none")
    assert "parcels" not in notes_of(air, cloud="none")
    refused(tmp_path / "drops.vtp", r"no gas: .* \(parcels alone in .*drops\.vtp\)")


def test_two_clouds_and_two_claims(tmp_path: Path) -> None:
    pair(tmp_path)
    parcels_file(tmp_path / "more.vtp")
    refused(tmp_path, r"several clouds: drops, more; set spray\.cloud")
    assert notes_of(tmp_path, cloud="more")["parcels"] == 17
    save(tmp_path / "more.vtu", vertices(foam.sample()[2]))
    refused(tmp_path, r"2 claim to be cloud 'more': .*more\.vtp, .*more\.vtu", cloud="drops")


def test_a_time_that_stands_twice(tmp_path: Path) -> None:
    """As the list of a run that was started again: the same part of the same time."""
    folder = series(tmp_path)
    rows = "".join(f'<DataSet timestep="1" file="gas_000{n}.vtu"/>' for n in (7, 8))
    (folder / "gas.pvd").write_text(f"<VTKFile><Collection>{rows}</Collection></VTKFile>")
    refused(folder / "gas.pvd", r"2 claim to be part 0 of time 1 in .*0007.*0008")


def test_pieces_that_are_the_same(tmp_path: Path) -> None:
    """vtk's parallel writer, used in a serial program, writes the whole into each piece."""
    from vtkmodules.vtkIOParallelXML import vtkXMLPUnstructuredGridWriter

    block, gas, _ = foam.sample()
    writer: Any = vtkXMLPUnstructuredGridWriter()
    writer.SetInputData(block_grid(block, gas))
    writer.SetFileName(str(tmp_path / "gas.pvtu"))
    writer.SetNumberOfPieces(2)
    writer.SetStartPiece(0)
    writer.SetEndPiece(1)
    writer.Write()
    refused(tmp_path / "gas.pvtu", r"gas_1\.vtu: 24 cells with fuel lie where those of .*_0")


def test_ensight_of_vtk(tmp_path: Path, expected: dict[str, float]) -> None:
    """vtk's EnSight writer has names of its own, which a mapping tells."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkIOParallel import vtkEnSightWriter

    block, gas, _ = foam.sample()
    grid = block_grid(block, gas)
    convert: Any = numpy_support.numpy_to_vtk
    part = convert(np.ones(block.cells, dtype=np.int32), deep=1)
    part.SetName("BlockId")
    grid.GetCellData().AddArray(part)
    writer: Any = vtkEnSightWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(tmp_path / "case"))
    writer.Write()
    writer.WriteCaseFile(1)
    case = tmp_path / "case.0.case"
    refused(case, r"no cell field 'C7H16'.* it has: C7H16_c, T_c")
    mapping = tmp_path / "names.yaml"
    mapping.write_text("cells: {temperature: T_c, density: rho_c, pressure: p_c, fuel: C7H16_c}")
    found = notes_of(case, mapping=mapping)
    assert found["vapour_mass_kg"] == pytest.approx(expected["vapour_mass_kg"], rel=5e-6)
    assert found["gas_cells"] == expected["gas_cells"]


def test_a_surface_is_left_out_by_name(tmp_path: Path) -> None:
    from vtkmodules.vtkFiltersSources import vtkSphereSource

    pair(tmp_path)
    source: Any = vtkSphereSource()
    source.Update()
    save(tmp_path / "walls.vtp", source.GetOutput())
    spray = read(tmp_path)
    said = [text for text in spray.remarks if "neither gas nor parcels: " in text]
    assert len(said) == 1
    assert "walls.vtp" in said[0]


@pytest.mark.parametrize("density", [True, False])
def test_point_data_keep_the_mass(tmp_path: Path, density: bool) -> None:
    """Each corner stands for an eighth of each of its cells: the masses are sums over corners."""
    block, _, _ = foam.sample()
    random = np.random.default_rng(3)
    count = len(block.points)
    points = {
        "T": random.uniform(400.0, 900.0, count),
        "p": random.uniform(4e6, 5e6, count),
        "C7H16": random.uniform(0.0, 0.3, count),
    }
    gas_constant, air_kg_mol = 8.31446261815324, 0.02885
    points["rho"] = points["p"] * air_kg_mol / (gas_constant * points["T"])
    grid = block_grid(block, {})
    from tests.unit.cfd.vtkfiles import vtk_array

    for name, values in points.items():
        if density or name != "rho":
            grid.GetPointData().AddArray(vtk_array(name, values))
    save(tmp_path / "gas.vtu", grid)
    spray = read(tmp_path / "gas.vtu")
    corners = block.hexahedra
    share = block.volume / 8
    if density:
        mass = np.sum((points["rho"] * points["C7H16"])[corners] * share[:, None])
        assert spray.notes["vapour_mass_kg"] == pytest.approx(mass, rel=5e-6)
    # T is weighted by mass: the colder, denser corners count more than in a plain mean
    weight = points["p"] / points["T"] if not density else points["rho"]
    mean = (weight * points["T"])[corners].sum(axis=1) / weight[corners].sum(axis=1)
    assert spray.vapour is not None
    assert spray.vapour.temperature_K == pytest.approx(mean, rel=1e-6)
    assert any("at points became means over cells" in text for text in spray.remarks)


def test_mapping_of_names_and_units(tmp_path: Path, expected: dict[str, float]) -> None:
    block, gas, cloud = foam.sample()
    other = {"Temp": gas["T"] - 273.15, "P": gas["p"] / 1e5, "Density": gas["rho"]}
    save(tmp_path / "gas.vtu", block_grid(block, other | {"Y": gas["C7H16"] * 100}))
    drops = {"position": cloud["position"], "Radius": cloud["d"] * 5e5, "N": cloud["nParticle"]}
    drops |= {"Tp": cloud["T"], "Rp": cloud["rho"], "Vel": cloud["U"]}
    save(tmp_path / "drops.vtp", cloud_data(drops))
    refused(tmp_path, "has no field 'd'; it has: N, Radius, Rp, Tp, Vel")
    mapping = tmp_path / "names.yaml"
    mapping.write_text(
        "cells: {temperature: {column: Temp, unit: degC}, pressure: {column: P, unit: bar},\n"
        "  density: Density, fuel: {column: Y, unit: '%'}}\n"
        "parcels: {radius: {column: Radius, unit: um}, number: N, temperature: Tp, density: Rp,\n"
        "  velocity: Vel}\n"
    )
    spray = read_cfd(CfdSpray(file=tmp_path, mapping=mapping, nozzle_m=FRAME["nozzle_m"]))
    for name in FIGURES:
        assert spray.notes[name] == pytest.approx(expected[name], rel=5e-6), name
    assert spray.notes["axis_y"] == -1.0  # the velocity came over
    assert str(mapping) in {file.path for file in spray.files}
