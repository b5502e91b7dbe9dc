"""Data sets of VTK by what they hold: parcels on any cells, grids of every kind, ghosts, heads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from cldit.cfd.formats import contents
from cldit.cfd.to_spray import read_cfd
from cldit.cfd.vtk.datasets import as_numpy
from cldit.cfd.vtk.head import check_head
from cldit.constants import AVOGADRO_PER_MOL
from cldit.errors import EmptyCloud, SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import FRAME, notes_of, read, refused
from tests.unit.cfd.vtkfiles import block_grid, cloud_data, mark_ghosts, pieces, save, vtk_array

pytest.importorskip("vtkmodules")
from vtkmodules import vtkCommonDataModel as model
from vtkmodules.vtkCommonCore import vtkPoints


def joined(form: str) -> Any:
    """The parcels of the sample, on cells of a form."""
    cloud = foam.sample()[2]
    cells: Any = model.vtkCellArray()
    count = len(cloud["d"])
    if form == "tracks":  # three places of each parcel, one after the other
        way = np.repeat(np.arange(count), 3)
        late = np.tile([0.0, 1e-6, 2e-6], count)
        cloud = {name: values[way] for name, values in cloud.items()}
        cloud["position"] = cloud["position"] + late[:, None] * cloud["U"]
        cloud["age"] = late + 1e-5
    data = cloud_data(cloud)
    ends = {"tracks": 3, "one line": count, "few lines": 4, "vertices": 1, "surfaces": 3}[form]
    points = np.arange(len(cloud["position"]))
    for begin in range(0, len(points) // ends * ends, ends):
        cells.InsertNextCell(ends, points[begin : begin + ends].tolist())
    setter = {"vertices": data.SetVerts, "surfaces": data.SetPolys}.get(form, data.SetLines)
    setter(cells)
    if form == "vertices":
        data.GetCellData().ShallowCopy(data.GetPointData())
        data.GetPointData().Initialize()
    return data


@pytest.mark.parametrize("form", ["one line", "few lines", "vertices", "surfaces", "tracks"])
def test_parcels_on_any_cells(tmp_path: Path, form: str) -> None:
    """One of 17 points is on none of the lines of four points."""
    block, gas, cloud = foam.sample()
    save(tmp_path / "gas.vtu", block_grid(block, gas))
    save(tmp_path / "spray.vtp", joined(form))
    spec = CfdSpray(file=tmp_path, **FRAME)
    if form in ("surfaces", "tracks"):
        with pytest.raises(SprayError, match=r"spray\.vtp: has d and nParticle, .* parcels, on"):
            read_cfd(spec)
        assert "parcels" not in read_cfd(spec.model_copy(update={"cloud": "none"})).notes
        return
    mass = np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3)
    assert read_cfd(spec).notes["liquid_mass_kg"] == pytest.approx(mass, rel=1e-5)


def test_a_cloud_without_parcels_is_a_cloud(tmp_path: Path) -> None:
    """Before the injection ParaView writes poly data without points."""
    block, gas, cloud = foam.sample()
    save(tmp_path / "gas.vtu", block_grid(block, gas))
    save(tmp_path / "spray.vtp", cloud_data({name: values[:0] for name, values in cloud.items()}))
    with pytest.raises(EmptyCloud, match=r"spray\.vtp: points: cloud 'spray' has no parcel"):
        read(tmp_path)
    assert "parcels" not in notes_of(tmp_path, cloud="none")


def test_a_folder_without_gas_names_its_files(tmp_path: Path) -> None:
    save(tmp_path / "spray.vtp", cloud_data(foam.sample()[2]))
    image = model.vtkImageData()
    image.SetDimensions(5, 5, 1)
    save(tmp_path / "cut.vti", image)
    message = r"no gas: .*\(parcels alone in .*spray\.vtp; lines or surfaces in .*cut\.vti\)"
    refused(tmp_path, message)


def vapour_kg(path: Path) -> float:
    spec = CfdSpray(file=path, nozzle_m=(0.0, 0.0, 0.0), axis="-z", cloud="none")
    return read_cfd(spec).notes["vapour_mass_kg"]


def whole_kg() -> float:
    _, centre, volume = steady_jet(".vti")
    return float((RHO * field(centre)[1] * volume).sum())


def hdf(file: Path, kind: bytes) -> Path:
    """An image, or the image with a block of half its spacing within it, by VTK's documentation."""
    grid, step = steady_jet(".vti")[0], (HIGH - LOW) / SHAPE
    text = h5py.string_dtype("ascii", len(kind))
    with h5py.File(file, "w") as root:
        top = root.create_group("VTKHDF")
        top.attrs["Version"] = [1, 0]
        top.attrs.create("Type", kind, dtype=text)
        top.attrs["Origin"] = LOW
        ends = [end for count in SHAPE for end in (0, count)]
        if kind == b"ImageData":
            top.attrs["WholeExtent"], top.attrs["Spacing"] = ends, step
            top.attrs["Direction"] = np.eye(3).reshape(-1)
        else:
            top.attrs.create("GridDescription", b"XYZ", dtype=h5py.string_dtype("ascii", 3))
            fine = top.create_group("Level1")
            fine.attrs["Spacing"] = step / 2
            fine["AMRBox"] = np.array([[2, 5, 2, 5, 6, 11]], "i4")
        held = top if kind == b"ImageData" else top.create_group("Level0")
        if held is not top:
            held.attrs["Spacing"] = step
            held["AMRBox"] = np.array([[0, 6, 0, 5, 0, 8]], "i4")
        for name in ("T", "C7H16", "rho"):
            values = as_numpy(grid.GetCellData().GetArray(name))
            held[f"CellData/{name}"] = values.reshape(SHAPE[::-1]) if held is top else values
            if held is not top:  # each coarse cell as eight of its values
                some = values.reshape(SHAPE[::-1])[3:6, 1:3, 1:3]
                eight = some.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)
                fine[f"CellData/{name}"] = eight.reshape(-1)
    return file


@pytest.mark.parametrize("kind", [b"ImageData", b"OverlappingAMR"])
def test_images_and_levels_in_hdf(tmp_path: Path, kind: bytes) -> None:
    assert vapour_kg(hdf(tmp_path / "gas.vtkhdf", kind)) == pytest.approx(whole_kg(), rel=1e-9)


@pytest.mark.parametrize("both", [False, True])
def test_ghosts_on_both_sides(tmp_path: Path, both: bool) -> None:
    """Two pieces share a layer of cells, which one of them marks as a copy, or both."""
    block, gas, cloud = foam.sample()
    shape = block.shape[::-1]
    layer = np.arange(block.cells).reshape(shape)
    for number, (points, kept) in enumerate(
        ((slice(0, 3), slice(0, 2)), (slice(1, 4), slice(1, 3)))
    ):
        own = foam.block((block.edges[0][points], block.edges[1], block.edges[2]))
        cells = layer[:, :, kept].reshape(-1)
        grid = block_grid(own, {name: values[cells] for name, values in gas.items()})
        shared = np.isin(cells, layer[:, :, 1]) & (both or number == 0)
        mark_ghosts(grid.GetCellData(), shared)
        save(tmp_path / f"gas_{number}.vtu", grid)
        drops = cloud_data(cloud)
        mark_ghosts(drops.GetPointData(), np.full(17, both or number == 0))
        save(tmp_path / f"drops_{number}.vtp", drops)
    pieces(tmp_path / "gas.pvtu", ["gas_0.vtu", "gas_1.vtu"])
    pieces(tmp_path / "drops.pvtp", ["drops_0.vtp", "drops_1.vtp"])
    spray = read(tmp_path)
    vapour = float(np.sum(gas["rho"] * gas["C7H16"] * block.volume))
    assert spray.notes["vapour_mass_kg"] == pytest.approx(vapour, rel=1e-5)
    assert spray.notes["parcels"] == 17
    remark = "Marked as ghost in every piece, kept once: 25."
    assert (remark in spray.remarks) == both


def test_pieces_of_a_grid(tmp_path: Path) -> None:
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    for number, ends in enumerate(((0, 7, 0, 6, 0, 4), (0, 7, 0, 6, 4, 9))):
        writer: Any = vtkXMLImageDataWriter()
        writer.SetInputData(steady_jet(".vti")[0])
        writer.SetWriteExtent(*ends)
        writer.SetFileName(str(tmp_path / f"gas_{number}.vti"))
        writer.Write()
    pieces(tmp_path / "gas.pvti", ["gas_0.vti", "gas_1.vti"])
    assert vapour_kg(tmp_path / "gas.pvti") == pytest.approx(whole_kg(), rel=1e-9)
    assert vapour_kg(tmp_path) == pytest.approx(whole_kg(), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("gas.vtu", 'NumberOfPoints="560"', 'NumberOfPoints="0"'),
        ("gas.vtu", 'NumberOfPoints="560"', 'NumberOfPoints="7"'),
        ("gas.vtu", 'NumberOfCells="378"', 'NumberOfCells="-1"'),
        ("gas.vtu", 'NumberOfCells="378"', 'NumberOfCells="99999999999999999999"'),
        ("gas.vtu", 'NumberOfComponents="3"', 'NumberOfComponents="-1"'),
        ("gas.vtu", 'NumberOfComponents="3"', 'NumberOfComponents="999999999999"'),
        ("gas.vtu", 'type="UnstructuredGrid"', 'type="PolyData"'),
        ("gas.vtu", "<UnstructuredGrid>", "<UnstructuredGrit>"),
        ("gas.vtu", '<?xml version="1.0"?>', '<?xml version="1.0" encoding="none"?>'),
        ("gas.vti", 'WholeExtent="0 7', 'WholeExtent="0 9999999'),
        ("gas.vti", ' Extent="0 7', ' Extent="9 7'),
        ("gas.vti", ' Extent="0 7', ' Extent="- 7'),
        ("gas.vti", ' Spacing="0.002', ' Step="0.002'),
        ("gas.vti", 'Spacing="0.002', 'Spacing="nan'),
        ("gas.vti", 'Spacing="0.002', 'Spacing="'),
        ("gas.vti", 'Spacing="0.002', 'Spacing="-0.002'),
        ("gas.vtk", "DIMENSIONS 8", "DIMENSIONS 800000000"),
        ("gas.vtk", "DIMENSIONS 8", "DIMENSIONS -8"),
        ("gas.vtk", "POINTS 560", "POINTS 99999999999"),
        ("gas.vtk", "CELL_DATA 378", "CELL_DATA 37800000000"),
    ],
)
def test_heads_that_end_the_process(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, old: str, new: str
) -> None:
    grid = steady_jet(".vti" if name == "gas.vti" else ".vts")[0]
    if name == "gas.vtu":
        from vtkmodules.vtkFiltersCore import vtkAppendFilter

        append = vtkAppendFilter()
        append.AddInputData(grid)
        append.Update()
        grid = append.GetOutput()
        mark_ghosts(grid.GetCellData(), np.arange(378) == 3)
    file = tmp_path / name
    save(file, grid)
    content = file.read_bytes()
    assert old.encode() in content
    file.write_bytes(content.replace(old.encode(), new.encode(), 1))
    with pytest.raises(SprayError, match=rf"{name}: is (damaged|of type PolyData; expected)"):
        vapour_kg(file)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("packing", "bits"), [(0, 32), (1, 64), (2, 32), (3, 64)])
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "AppendedBase64"])
@pytest.mark.parametrize(
    ("name", "count", "true"),
    [("gas.vtu", "NumberOfCells", 378), ("gas.vtu", "NumberOfPoints", 560),
     ("rain.vtp", "NumberOfPoints", 40), ("rain.vtp", "NumberOfVerts", 40)],
)  # fmt: skip
def test_counts_are_those_of_the_arrays(
    tmp_path: Path, name: str, count: str, true: int, mode: str, packing: int, bits: int
) -> None:
    """vtk reads as many cells or points as the head says, and omits the rest without a word.

    packing: none, zlib, lz4, lzma; bits of the numbers in the heads of arrays.
    """
    from vtkmodules import vtkIOXML
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersSources import vtkPointSource

    if name == "gas.vtu":
        made: Any = vtkAppendFilter()
        made.AddInputData(steady_jet(".vts")[0])
        writer: Any = vtkIOXML.vtkXMLUnstructuredGridWriter()
    else:
        made = vtkPointSource()
        made.SetNumberOfPoints(40)
        writer = vtkIOXML.vtkXMLPolyDataWriter()
    made.Update()
    source = made.GetOutput()
    if name == "rain.vtp":  # a cell with all points; here one for each
        from vtkmodules.vtkCommonDataModel import vtkCellArray

        verts = vtkCellArray()
        for number in range(40):
            verts.InsertNextCell(1, [number])
        source.SetVerts(verts)
    file = tmp_path / name
    writer.SetFileName(str(file))
    writer.SetInputData(source)
    getattr(writer, f"SetDataModeTo{mode.removesuffix('Base64')}")()
    writer.SetEncodeAppendedData(mode.endswith("64"))
    writer.SetCompressorType(packing)
    writer.SetHeaderType(bits)
    writer.Write()
    check_head(file)
    content = file.read_bytes()
    few = f'{count}="{true - 7}"'.encode()
    file.write_bytes(content.replace(f'{count}="{true}"'.encode(), few, 1))
    with pytest.raises(SprayError, match=rf"{name}: .*{count} is {true - 7}; allowed: {true}\)"):
        check_head(file)


SHAPE = (7, 6, 9)  # cells
LOW, HIGH = np.array([-7e-3, -6e-3, -45e-3]), np.array([7e-3, 6e-3, 0.0])
TURN_DEG = 25.0  # of the structured grid about z
RHO = 20.0
KINDS: dict[str, Any] = {
    ".vti": model.vtkImageData,
    ".vtr": model.vtkRectilinearGrid,
    ".vts": model.vtkStructuredGrid,
}


def field(place_m: Any) -> tuple[Any, Any]:
    """Temperature [K] and mass fraction of the fuel of a steady jet along -z, at (N, 3)."""
    x, y, z = place_m.T
    width = 1e-3 - 0.1 * z
    return 500.0 + 4e3 * z, 0.3 * np.exp(-(x**2 + y**2) / (2.0 * width**2))


def steady_jet(kind: str) -> tuple[Any, Any, Any]:
    """vtk's grid, centres (N, 3) and volumes (N,) of its cells.

    Nodes of a rectilinear grid are graded; a structured grid is turned about z.
    """
    steps = [np.linspace(0.0, 1.0, count + 1) for count in SHAPE]
    if kind == ".vtr":
        steps = [step + 0.1 * np.sin(np.pi * step) for step in steps]
    x, y, z = (low + (high - low) * s for low, high, s in zip(LOW, HIGH, steps, strict=True))
    block = foam.block((x, y, z))
    angle = np.radians(TURN_DEG) if kind == ".vts" else 0.0
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    grid: Any = KINDS[kind]()
    grid.SetDimensions(*(count + 1 for count in SHAPE))
    if kind == ".vti":
        grid.SetOrigin(*LOW)
        grid.SetSpacing(*((HIGH - LOW) / SHAPE))
    elif kind == ".vtr":
        for name, values in zip("XYZ", block.edges, strict=True):
            getattr(grid, f"Set{name}Coordinates")(vtk_array("", values, "f8"))
    else:
        points = vtkPoints()
        points.SetData(vtk_array("", block.points @ turn, "f8"))
        grid.SetPoints(points)
    centre = block.centre @ turn
    temperature, fraction = field(centre)
    for name, values in (
        ("T", temperature),
        ("C7H16", fraction),
        ("rho", 0.0 * fraction + RHO),
    ):
        grid.GetCellData().AddArray(vtk_array(name, values, "f8"))
    return grid, centre, block.volume


def spec(file: Path) -> CfdSpray:
    return CfdSpray(file=file, nozzle_m=(0.0, 0.0, 0.0), axis="-z")


@pytest.mark.parametrize("legacy", [False, True], ids=["xml", "legacy"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_known_field(kind: str, legacy: bool, tmp_path: Path) -> None:
    """Coordinates in double precision: what is left is the rounding of volumes and centroids."""
    grid, centre, volume = steady_jet(kind)
    file = save(tmp_path / f"gas{'.vtk' if legacy else kind}", grid)
    spray = read_cfd(spec(file))
    assert spray.parcels is None and spray.vapour is not None
    temperature, fraction = field(centre)
    density = RHO * fraction * AVOGADRO_PER_MOL / 0.100204
    cells = spray.vapour.cells
    assert spray.vapour.temperature_K == pytest.approx(temperature, rel=1e-9, abs=0)
    assert spray.vapour.number_density_m3 == pytest.approx(density, rel=1e-9, abs=0)
    assert (cells.upper_m - cells.lower_m).prod(axis=1) == pytest.approx(volume, rel=1e-9, abs=0)
    assert (cells.upper_m + cells.lower_m) / 2 == pytest.approx(centre, rel=0, abs=1e-12)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(
        (RHO * fraction * volume).sum(), rel=1e-9, abs=0
    )
    assert contents(spec(file)).fields == ("C7H16", "T", "rho")


def test_hidden_cells_and_corners(tmp_path: Path) -> None:
    grid, _, volume = steady_jet(".vts")
    grid.BlankCell(200)
    grid.BlankPoint(0)  # the corner of one cell
    spray = read_cfd(spec(save(tmp_path / "gas.vts", grid)))
    assert spray.notes["gas_cells"] == len(volume) - 2
    assert "Marked as ghost or hidden, omitted: 2 cells." in spray.remarks


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_cut_off(kind: str, share: float, tmp_path: Path) -> None:
    file = save(tmp_path / f"gas{kind}", steady_jet(kind)[0])
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(SprayError, match=rf"gas\{kind}: is damaged or truncated"):
        read_cfd(spec(file))
