"""One small case in every format: the same spray; vtk's own readers read it too."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd import inputs
from cldit.cfd.formats import contents, read_case
from cldit.cfd.importing import imported
from cldit.cfd.mapping.file import read_column_map
from cldit.cfd.mapping_draft import write_mapping
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import keys_of, write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import WRITERS, write_converge, write_ensight
from tests.unit.cfd.reading import FRAME, notes_of, read, refused, same
from tests.unit.cfd.test_paraview import LAYOUTS
from tests.unit.cfd.vtkfiles import cell_arrays

FIGURES = (
    "liquid_mass_kg",
    "vapour_mass_kg",
    "sauter_mean_diameter_m",
    "liquid_penetration_95_m",
    "vapour_penetration_m",
    "droplets",
    "gas_temperature_max_K",
)
# relative error of the figures: of float64, or of vtk's float32, through d^3 or V
EXACT = ["openfoam", "openfoam-binary", "openfoam-gz", "openfoam-barycentric", "fluent", "cgns"]
EXACT += ["fluent-dpm", "cgns-polyhedra", "cgns-mixed", "cgns-structured"]
KINDS: dict[str, float] = (
    dict.fromkeys(EXACT, 1e-12)
    | {kind: slack for kind, (_, slack) in WRITERS.items()}
    | dict.fromkeys(("vtk", "vtk-legacy", "vtkhdf", "vtkhdf-by-vtk"), 5e-6)
    | dict.fromkeys((f"vtk {layout.__name__}" for layout in LAYOUTS), 5e-6)
)
GAS_ALONE = ("cgns", "fluent ")  # formats without parcels


def written(kind: str, folder: Path) -> Path:
    layouts = {f"vtk {layout.__name__}": layout for layout in LAYOUTS}
    return layouts[kind](folder) if kind in layouts else write_format(kind, folder, foam.sample())


@pytest.mark.parametrize("kind", KINDS)
def test_same_spray_in_every_format(tmp_path: Path, kind: str) -> None:
    path, slack = written(kind, tmp_path / "other"), KINDS[kind]
    keys = keys_of(kind, tmp_path / "other")
    spray, expected = read(path, **keys), read(foam.case(tmp_path / "foam"))
    with_parcels = not f"{kind} ".startswith(GAS_ALONE)
    for name in FIGURES:
        if with_parcels or not name.startswith(("liquid", "sauter", "droplets")):
            assert spray.notes[name] == pytest.approx(expected.notes[name], rel=slack), name
    assert spray.notes["gas_cells"] == expected.notes["gas_cells"] == 24
    found = contents(CfdSpray(file=path))
    assert found.format == re.split("[- ]", kind)[0].replace("vtkhdf", "vtk")
    assert {"C7H16"} <= {
        name.removeprefix("MASSFRAC_") for name in found.fields
    } or kind == "tables"
    assert len(found.clouds) == (with_parcels and kind != "fluent-dpm")
    for file in spray.files:
        assert Path(file.path).is_relative_to(tmp_path / "other")
        assert hashlib.sha256(Path(file.path).read_bytes()).hexdigest() == file.sha256
    if with_parcels:
        assert spray.parcels is not None and expected.parcels is not None
        place = expected.parcels.position_m
        assert spray.parcels.position_m == pytest.approx(place, abs=10e-3 * slack, rel=0)
        inferred = read_cfd(CfdSpray(file=path, nozzle_m=FRAME["nozzle_m"], **keys))
        assert inferred.notes["axis_y"] == -1.0  # the velocity came over
    if kind.startswith(("openfoam", *WRITERS)):
        assert spray.notes["time_s"] == found.times_s[-1] == 0.001


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "fluent-dpm"])
def test_a_drafted_mapping_reads_the_same(tmp_path: Path, kind: str) -> None:
    case, out = written(kind, tmp_path / "case"), tmp_path / "names.yaml"
    assert write_mapping(CfdSpray(file=case), out)[0] == str(out)
    assert "# available: " in out.read_text()
    keys = {"file": out} if case.suffix == ".yaml" else {"file": case, "mapping": out}
    assert same(read_cfd(CfdSpray(**keys, **FRAME)), read(case))
    write_mapping(CfdSpray(**keys), tmp_path / "again.yaml")
    assert read_column_map(tmp_path / "again.yaml").parcels == read_column_map(out).parcels


LARGE = ["openfoam", "vtk", "tables", "ensight", "ensight-ascii", "converge", "vtkhdf", "cgns"]
LARGE += ["fluent", "amrex"]


@pytest.mark.parametrize("kind", LARGE)
def test_progress_and_what_does_not_fit(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused before anything large is read; counts of faces, lines or bytes are estimates."""
    told: list[tuple[str, int, int]] = []
    case = written(kind, tmp_path / "case")
    spec = CfdSpray(**({"file": case} | FRAME | keys_of(kind, tmp_path / "case")))
    imported(spec, tmp_path / "spray.npz", watch=lambda *each: told.append(each))
    assert all(0 <= done <= total for _, done, total in told)
    phases = [phase for phase, _, _ in told]
    assert "measuring cells" in phases and phases[-1] == "writing spray.npz"
    assert phases[0].startswith(("reading", "measuring cells"))
    told.clear()
    monkeypatch.setattr(inputs, "free_bytes", lambda: 0.15e9)
    with pytest.raises(SprayError) as caught:
        imported(spec, None, watch=lambda *each: told.append(each))
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "case")) and "export only the region" in message
    cells = "2048" if kind == "amrex" else r"\d+" if kind[:2] in ("op", "ta", "en") else "24"
    assert re.search(rf"{cells} cells.* need some 0\.2 GB of memory; 0\.15 GB are free", message)
    assert told == []


def test_unknown_free_memory_refuses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    large = inputs.Size(10**9, 0, 1e12)
    for free in (None, 10**14):
        monkeypatch.setattr(inputs, "free_bytes", lambda free=free: free)
        inputs.check_room(Path("case"), large)


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


def output_of(reader: Any, file: Path) -> Any:
    """Output of one of vtk's readers."""
    case = hasattr(reader, "SetCaseFileName")
    (reader.SetCaseFileName if case else reader.SetFileName)(str(file))
    reader.UpdateInformation()
    for name in ("EnableAllCellArrays", "EnableAllPatchArrays"):
        getattr(reader, name, lambda: None)()
    reader.Update()
    return reader.GetOutputDataObject(0)


@pytest.mark.parametrize("new", [False, True])
def test_vtk_reads_the_same_post_file(tmp_path: Path, new: bool) -> None:
    """That the layout written here is CONVERGE's is vtk's word, not the reader's own."""
    from vtkmodules.vtkIOCONVERGECFD import vtkCONVERGECFDReader

    block, _, cloud = sample = foam.sample()
    folder = write_converge(tmp_path, sample, new=new)
    data = output_of(vtkCONVERGECFDReader(), min(folder.iterdir()))
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    mesh, parcels = parts[0], parts[-1]
    assert mesh.GetNumberOfCells() == block.cells
    assert parcels.GetNumberOfPoints() == len(cloud["d"])
    radius = parcels.GetPointData().GetArray("RADIUS").GetValue(3)
    assert 2 * radius == pytest.approx(cloud["d"][3], rel=1e-6)
    assert parcels.GetPointData().GetArray("VELOCITY").GetNumberOfComponents() == 3


@pytest.mark.parametrize("binary", [False, True])
def test_vtk_reads_the_same_ensight(tmp_path: Path, binary: bool) -> None:
    from vtkmodules.vtkIOEnSight import vtkEnSightGoldCombinedReader

    block, gas, cloud = sample = foam.sample()
    case = write_ensight(tmp_path, sample, binary=binary)
    data = output_of(vtkEnSightGoldCombinedReader(), case)
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    assert parts[0].GetNumberOfCells() == block.cells
    assert parts[0].GetCellData().GetArray("T").GetValue(5) == pytest.approx(gas["T"][5], rel=1e-5)
    drops = next(part for part in parts if part.GetPointData().GetArray("d") is not None)
    found = [drops.GetPointData().GetArray("d").GetValue(n) for n in range(17)]
    assert found == pytest.approx(cloud["d"], rel=1e-5)


def test_vtk_reads_the_same_cgns(tmp_path: Path) -> None:
    """Single precision of that reader's points: 1e-7 of a place over the edge of a cell."""
    from vtkmodules.vtkIOCGNSReader import vtkCGNSReader

    block, gas, _ = foam.sample()
    data = output_of(vtkCGNSReader(), written("cgns", tmp_path))
    volume, fuel, density = cell_arrays(data.GetBlock(0).GetBlock(0), "C7H16", "Density")
    assert volume == pytest.approx(block.volume, rel=1e-4, abs=0)
    assert fuel == pytest.approx(gas["C7H16"], rel=1e-7)
    assert density == pytest.approx(gas["rho"], rel=1e-7)


@pytest.mark.parametrize("kind", ["openfoam", "openfoam-gz", "openfoam-binary", "openfoam-label64"])
def test_vtk_reads_the_same_openfoam(tmp_path: Path, kind: str) -> None:
    """vtk keeps float32: 6e-8 a number, and 1e-9 m of an edge of 1e-3 m."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkIOParallel import vtkPOpenFOAMReader

    numpy_of: Any = numpy_support.vtk_to_numpy
    folder = written(kind, tmp_path)
    (folder / "case.foam").touch()
    case, blocks = (
        read_case(CfdSpray(file=folder)),
        output_of(vtkPOpenFOAMReader(), folder / "case.foam"),
    )
    volume, *gas = cell_arrays(blocks.GetBlock(0), "T", "rho")
    cells = case.mesh.measure(np.arange(case.mesh.cells))
    assert cells.volume_m3 == pytest.approx(volume, rel=5e-6)
    for name, values in zip(("T", "rho"), gas, strict=True):
        assert case.gas[name].values == pytest.approx(values, rel=1e-6)
    points = blocks.GetBlock(blocks.GetNumberOfBlocks() - 1).GetBlock(0)
    assert case.cloud is not None
    place = numpy_of(points.GetPoints().GetData())
    assert case.cloud.position_m.values == pytest.approx(place, abs=2e-9, rel=0)
    count = numpy_of(points.GetPointData().GetArray("nParticle"))
    assert case.cloud.fields["nParticle"].values == pytest.approx(count, rel=1e-6)
