"""Images, rectilinear and structured grids of VTK, against a field that is known everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.formats import contents
from cldit.cfd.to_spray import read_cfd
from cldit.constants import AVOGADRO_PER_MOL
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray

pytest.importorskip("vtkmodules")
from vtkmodules import vtkCommonDataModel as model
from vtkmodules import vtkIOXML as xml
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkIOLegacy import vtkDataSetWriter

from tests.unit.cfd.conftest import foam

SHAPE = (7, 6, 9)  # cells
LOW, HIGH = np.array([-7e-3, -6e-3, -45e-3]), np.array([7e-3, 6e-3, 0.0])
TURN_DEG = 25.0  # of the structured grid about z
RHO = 20.0
KINDS: dict[str, Any] = {
    ".vti": model.vtkImageData,
    ".vtr": model.vtkRectilinearGrid,
    ".vts": model.vtkStructuredGrid,
}
WRITERS = {
    ".vti": xml.vtkXMLImageDataWriter,
    ".vtr": xml.vtkXMLRectilinearGridWriter,
    ".vts": xml.vtkXMLStructuredGridWriter,
}


def field(place_m: Any) -> tuple[Any, Any]:
    """Temperature [K] and mass fraction of the fuel of a steady jet along -z, at (N, 3)."""
    x, y, z = place_m.T
    width = 1e-3 - 0.1 * z
    return 500.0 + 4e3 * z, 0.3 * np.exp(-(x**2 + y**2) / (2.0 * width**2))


def vtk_array(values: Any) -> Any:
    convert: Any = numpy_to_vtk
    return convert(values, deep=True)


def grid_of(kind: str) -> tuple[Any, Any, Any]:
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
            getattr(grid, f"Set{name}Coordinates")(vtk_array(values))
    else:
        points = vtkPoints()
        points.SetData(vtk_array(block.points @ turn))
        grid.SetPoints(points)
    centre = block.centre @ turn
    temperature, fraction = field(centre)
    for name, values in (("T", temperature), ("C7H16", fraction), ("rho", 0.0 * fraction + RHO)):
        array = vtk_array(values)
        array.SetName(name)
        grid.GetCellData().AddArray(array)
    return grid, centre, block.volume


def write(file: Path, grid: Any, kind: str) -> Path:
    writer: Any = vtkDataSetWriter() if file.suffix == ".vtk" else WRITERS[kind]()
    if file.suffix == ".vtk":
        writer.SetFileTypeToBinary()
    writer.SetFileName(str(file))
    writer.SetInputData(grid)
    assert writer.Write()
    return file


def spec(file: Path) -> CfdSpray:
    return CfdSpray(file=file, nozzle_m=(0.0, 0.0, 0.0), axis="-z")


@pytest.mark.parametrize("legacy", [False, True], ids=["xml", "legacy"])
@pytest.mark.parametrize("kind", WRITERS)
def test_a_known_field(kind: str, legacy: bool, tmp_path: Path) -> None:
    """Coordinates in double precision: what is left is the rounding of volumes and centroids."""
    grid, centre, volume = grid_of(kind)
    file = write(tmp_path / f"gas{'.vtk' if legacy else kind}", grid, kind)
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
    grid, _, volume = grid_of(".vts")
    grid.BlankCell(200)
    grid.BlankPoint(0)  # the corner of one cell
    spray = read_cfd(spec(write(tmp_path / "gas.vts", grid, ".vts")))
    assert spray.notes["gas_cells"] == len(volume) - 2
    assert "Marked as ghost or hidden, omitted: 2 cells." in spray.remarks


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_cut_off(kind: str, share: float, tmp_path: Path) -> None:
    file = write(tmp_path / f"gas{kind}", grid_of(kind)[0], kind)
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(SprayError, match=rf"gas\{kind}: is damaged or truncated"):
        read_cfd(spec(file))
