"""The octree and the parcels of a run as files for ParaView, to lay over a CFD result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.cfd.orientation import Frame
from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.io.files import make_folder
from cldit.io.vtk_files import HEXAHEDRON, Grid, Points, write_vtkhdf, write_xml
from cldit.prepare.stages import Say
from cldit.run.cell_fields import CellFields
from cldit.run.rebuilt import Rebuilt, rebuilt
from cldit.run.result import Run
from cldit.spray.vtk_export import parcel_points

FORMATS = ("vtkhdf", "vtu")
_FRAME = tuple(f"{name}_{letter}" for name in ("nozzle", "axis") for letter in "xyz")


def export_octree(
    run: Run,
    form: str,
    target: Path | None,
    *,
    device: Device,
    cache: Path,
    node: int | None = None,
    own_frame: bool = False,
    say: Say | None = None,
) -> list[Path]:
    """Writes the leaves of a run's octree with their fields, and its parcels.

    Cells are hexahedra, which every filter of ParaView takes (of hyper tree grids many do not), and
    which stay right when they are turned into the case's coordinates.

    Args:
        run: as `open_run` reads it.
        form: `vtkhdf`: one file with the blocks `octree` and `parcels`; `vtu`: the cells, and a
            .vtp of the parcels beside it.
        target: the file; `octree.vtkhdf` or `octree.vtu` in the run's folder if left out.
        device: makes the medium, and solves for the source function.
        cache: folder of tables and sprays.
        node: number of the spectral node; None: the one with most of the light.
        own_frame: cldit's own coordinates also of a spray from CFD, which else comes back in those
            of its case.
        say: takes lines of progress.

    Returns:
        The files written.

    Raises:
        RunFolderError: as `rebuilt`.
        ClditError: as `simulate`.
        DiskFull, FileError: a file cannot be written.
    """
    if target is None and run.folder is None:
        raise RunFolderError("the run is not stored; give the file to write")
    path = target or (run.folder or Path()) / f"octree.{form}"
    made = rebuilt(run, device, cache, node=node, say=say)
    for text in made.remarks:
        if say is not None:
            say(text)
    fields = CellFields.of(made, run.quadrature, device)
    blocks = _blocks(made, fields, None if own_frame else case_frame(run.info.spray))
    make_folder(path.parent)
    if form == "vtkhdf":
        write_vtkhdf(path, blocks)
        return [path]
    written = [path]
    write_xml(path, blocks["octree"])
    if "parcels" in blocks:
        written.append(path.with_name(f"{path.stem}_parcels.vtp"))
        write_xml(written[-1], blocks["parcels"])
    return written


def case_frame(notes: dict[str, float]) -> Frame | None:
    """The frame in which a CFD case had its nozzle and axis; None: the spray is cldit's own.

    Args:
        notes: figures of the spray.
    """
    if not all(f"{name}_m" in notes or name in notes for name in _FRAME):
        return None
    nozzle = [notes[f"nozzle_{letter}_m"] for letter in "xyz"]
    axis = np.array([notes[f"axis_{letter}"] for letter in "xyz"])
    return Frame(np.array(nozzle), axis / np.linalg.norm(axis), ())


def _blocks(made: Rebuilt, fields: CellFields, frame: Frame | None) -> dict[str, Grid | Points]:
    def placed(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return points_m if frame is None else points_m @ frame.rotation + frame.nozzle_m

    cube = made.tree.frame
    points, nodes = fields.leaves.nodes(cube.cells)
    about = {
        "wavelength_um": np.array([fields.wavelength_um]),
        "node": np.array([made.number]),
    }
    corners_m = np.asarray(cube.lower_m) + points * cube.cell_m
    blocks: dict[str, Grid | Points] = {
        "octree": Grid(placed(corners_m), nodes, HEXAHEDRON, fields.values, about)
    }
    if made.spray.parcels is not None:
        own = parcel_points(made.spray.parcels)
        blocks["parcels"] = Points(placed(own.points_m), own.fields)
    return blocks
