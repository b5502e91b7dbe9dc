"""The octree and the parcels of a run as files for ParaView, to lay over a CFD result."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.arrays import Floats
from cldit.cfd.orientation import InjectorFrame
from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.io.files import make_folder
from cldit.io.vtk_files import HEXAHEDRON, Grid, Points, write_xml
from cldit.medium.leaves import Leaves
from cldit.medium.octree import Octree
from cldit.optics.spectral import Quadrature
from cldit.prepare.stages import Say
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run.rebuilt import Rebuilt, rebuilt
from cldit.run.result import Run
from cldit.spray.vtk_export import parcel_points
from cldit.transport.source_iteration import source_function

_FRAME = tuple(f"{name}_{letter}" for name in ("nozzle", "axis") for letter in "xyz")


@dataclass(frozen=True)
class CellFields:
    """Leaves, and their fields (N,) float32 by name.

    extinction, vapour_absorption, droplet_absorption, droplet_scattering, per_m: coefficients.
    albedo_1: scattered share of the extinction. emission: thermal, photons s-1 m-3 sr-1.
    source_function: of all light from the leaf to the camera, photons s-1 m-2 sr-1.
    vapour_temperature, droplet_temperature, K: of the black body with the same emission at the
    node; NaN where the phase does not absorb. wavelength_um: of the node.
    """

    leaves: Leaves
    values: dict[str, NDArray[np.float32]]
    wavelength_um: float

    @classmethod
    def of(cls, medium: Rebuilt, quadrature: Quadrature, device: Device) -> "CellFields":
        """Fields in front of the middle background (`quadrature.reference_K`); raises as
        `source_function`."""
        node = quadrature.nodes[medium.number]
        bounds = Boundary.of(Surroundings.from_scene(medium.scene), node.radiance, node.pane)
        boundary = {
            "background": float(bounds.leaving(quadrature.reference_K)),
            "wall": bounds.wall,
            **bounds.patches,
        }
        source = source_function(medium.tree, medium.scene, device, medium.settings, boundary)
        fields = medium.tree.fields
        leaves = Leaves.of(medium.tree, [*fields.values(), source])
        at = leaves.address
        values = {name: part[at] for name, part in _optical(medium.tree).items()}
        values["source_function_photons_per_s_m2_sr"] = source[at]
        for phase, name in (("vapour", "vapour"), ("droplet", "droplet")):
            values[f"{name}_temperature_K"] = temperature_K(
                fields[f"{phase}_emission"][at], fields[f"{phase}_absorption"][at], node.radiance
            )
        narrow = {name: part.astype(np.float32) for name, part in values.items()}
        return cls(leaves, narrow, node.wavelength_um)


def _optical(tree: Octree) -> dict[str, Floats]:
    fields = {name: values.astype(np.float64) for name, values in tree.fields.items()}
    scattering = fields["droplet_scattering"]
    extinction = fields["vapour_absorption"] + fields["droplet_absorption"] + scattering
    albedo = np.divide(scattering, extinction, out=np.zeros_like(extinction), where=extinction > 0)
    return {
        "extinction_per_m": extinction,
        "albedo_1": albedo,
        "emission_photons_per_s_m3_sr": fields["vapour_emission"] + fields["droplet_emission"],
        "vapour_absorption_per_m": fields["vapour_absorption"],
        "droplet_absorption_per_m": fields["droplet_absorption"],
        "droplet_scattering_per_m": scattering,
    }


def temperature_K(
    emission: NDArray[np.floating],
    absorption: NDArray[np.floating],
    radiance: Callable[[ArrayLike], Floats],
) -> Floats:
    """Temperature (N,) at which `absorption` (N,) per metre times a black body's radiance is the
    `emission` (N,), photons s-1 m-3 sr-1 (Kirchhoff); NaN without absorption or emission."""
    grid_K = np.geomspace(20.0, 5000.0, 20_000)
    table = np.log(np.maximum(radiance(grid_K), np.finfo(float).tiny))
    emitting = (absorption > 0) & (emission > 0)
    black = np.divide(emission, absorption, out=np.ones(len(emission)), where=emitting)
    # nearly straight: logarithm over 1 / T
    inverse = np.interp(np.log(black), table, -1.0 / grid_K)
    return np.where(emitting, -1.0 / inverse, np.nan)


def export_octree(
    run: Run,
    target: Path | None,
    *,
    device: Device,
    cache: Path,
    node: int | None = None,
    own_frame: bool = False,
    say: Say | None = None,
) -> list[Path]:
    """Writes the leaves of a run's octree with their fields, and its parcels.

    Cells are hexahedra, which every filter of ParaView supports (many do not support hyper tree
    grids), and which stay right when they are rotated into the case's coordinates.

    Args:
        target: the .vtu of the cells, beside which a .vtp gets the parcels; None: `octree.vtu` in
            the run's folder.
        node: number of the spectral node; None: the one with most of the light.
        own_frame: True: cldit's own coordinates also for a spray from CFD, instead of the case's.
    """
    if target is None and run.folder is None:
        raise RunFolderError("the run is not stored; give the file to write")
    path = target or (run.folder or Path()) / "octree.vtu"
    medium = rebuilt(run, device, cache, node=node, say=say)
    for remark in medium.remarks:
        if say is not None:
            say(remark)
    fields = CellFields.of(medium, run.quadrature, device)
    blocks = _blocks(medium, fields, None if own_frame else case_frame(run.info.spray))
    make_folder(path.parent)
    written = [path]
    write_xml(path, blocks["octree"])
    if "parcels" in blocks:
        written.append(path.with_name(f"{path.stem}_parcels.vtp"))
        write_xml(written[-1], blocks["parcels"])
    return written


def case_frame(notes: dict[str, float]) -> InjectorFrame | None:
    """Frame of a CFD case's nozzle and axis, from notes of its spray; None: cldit's own spray."""
    if not all(f"{name}_m" in notes or name in notes for name in _FRAME):
        return None
    nozzle = [notes[f"nozzle_{letter}_m"] for letter in "xyz"]
    axis = np.array([notes[f"axis_{letter}"] for letter in "xyz"])
    return InjectorFrame(np.array(nozzle), axis / np.linalg.norm(axis), ())


def _blocks(
    medium: Rebuilt, fields: CellFields, frame: InjectorFrame | None
) -> dict[str, Grid | Points]:
    def placed(points_m: Floats) -> Floats:
        return points_m if frame is None else points_m @ frame.rotation + frame.nozzle_m

    cube = medium.tree.frame
    points, nodes = fields.leaves.nodes(cube.cells)
    about = {
        "wavelength_um": np.array([fields.wavelength_um]),
        "node": np.array([medium.number]),
    }
    corners_m = np.asarray(cube.lower_m) + points * cube.cell_m
    blocks: dict[str, Grid | Points] = {
        "octree": Grid(placed(corners_m), nodes, HEXAHEDRON, fields.values, about)
    }
    if medium.spray.parcels is not None:
        parcels = parcel_points(medium.spray.parcels)
        blocks["parcels"] = Points(placed(parcels.points_m), parcels.fields)
    return blocks
