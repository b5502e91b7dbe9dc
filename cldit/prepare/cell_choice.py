"""Cells of a run without a choice by error, and the number of cells that fit the memory."""

from cldit.gpu.device import Device
from cldit.io.free_memory import free_bytes
from cldit.medium.frame import Cube
from cldit.medium.octree import Sources
from cldit.medium.resolution import (
    MOST_CELLS,
    candidates,
    divided_voxels,
    in_whole_cells,
    known_in_boxes,
    needed_edge_m,
    on_grid,
    refuse_outside,
)
from cldit.scene.vessel import Domain

# Bytes of a cell in which droplets scatter, at the peak of a run of a full cube of 128^3 cells: 440
# where they scatter evenly, 1090 with a phase function. Trees hold 60 for each further wavelength;
# three gradients of four components in double precision are a device's largest buffer.
_CELL_BYTES, _PHASE_BYTES, _WAVELENGTH_BYTES, _BUFFER_BYTES = 500, 1200, 60, 96
# Of a droplet parcel in a box, at the peak of its making (370 for one wavelength, 1170 for 16),
# with its cross sections at each wavelength.
_PARCEL_BYTES, _PARCEL_WAVELENGTH_BYTES = 320, 55
_SHARE = 0.7  # of the memory there is, which a run may take


def cells_that_fit(device: Device, *, wavelengths: int, phase: bool, sweeps: bool = True) -> int:
    """Number of stored cells that fit the memory of device and host, at most `MOST_CELLS`.

    Trees of all `wavelengths` are in memory together. `phase`: droplets have a phase function.
    `sweeps`: the method has gradients in cells, its largest buffers.
    """
    room = _SHARE * memory_bytes(device)
    fits = min(MOST_CELLS, room / cell_bytes(wavelengths=wavelengths, phase=phase))
    if sweeps:
        fits = min(fits, device.info.largest_buffer_bytes / _BUFFER_BYTES)
    return int(fits)


def memory_bytes(device: Device) -> float:
    """Memory that is free on host and device."""
    free = free_bytes()
    return float(min(device.info.memory_bytes, *(() if free is None else (free,))))


def cell_bytes(*, wavelengths: int, phase: bool) -> int:
    """Bytes of a stored cell at the peak of a run."""
    return (_PHASE_BYTES if phase else _CELL_BYTES) + _WAVELENGTH_BYTES * (wavelengths - 1)


def finest_lattice_m(spacing_m: float, *, parcels: float, wavelengths: int) -> float:
    """The finest lattice whose parcels fit the memory; 0 if the free memory is unknown.

    `parcels` are on a lattice of `spacing_m`, in the classes of size of the one asked for; sources
    of all `wavelengths` are in memory together.
    """
    free = free_bytes()
    if free is None:
        return 0.0
    limit = _SHARE * free / (_PARCEL_BYTES + _PARCEL_WAVELENGTH_BYTES * wavelengths)
    return float(spacing_m * (parcels / limit) ** (1 / 3))


def chosen_frame(
    domain: Domain, sources: Sources, device: Device | None, *, limit: int, voxels: bool = False
) -> tuple[Cube, tuple[str, ...]]:
    """The cube with its finest cells, and remarks.

    Cells that the scene fixes stay; where the medium is a user's `voxels`, these are halved or
    doubled to at most that edge. Otherwise a medium of boxes gets the coarsest cells that hold it,
    one with parcels in points or as clouds at most the paper's leaf; if these exceed `limit` cells,
    both get the finest that fit.
    """
    centre_m, edge_m = domain.centre_m, domain.edge_m
    if domain.leaf_edge_m is not None or domain.rule == "paper":
        cube = Cube.around(centre_m=centre_m, edge_m=edge_m, leaf_edge_m=domain.leaf_m)
        if voxels and domain.leaf_edge_m is not None and not in_whole_cells(cube, sources):
            cube = divided_voxels(cube, sources, leaf_m=domain.leaf_m) or cube
        return cube, ()
    cube = Cube.around(centre_m=centre_m, edge_m=edge_m, leaf_edge_m=2 * edge_m)
    wanted_m = domain.leaf_m
    if known_in_boxes(sources):
        wanted_m = needed_edge_m(cube, sources)
    candidate = None
    for candidate in candidates(cube, sources, device, limit=limit):
        if candidate.frame.cell_m <= wanted_m * (1 + 1e-9):
            return candidate.frame, ()
    assert candidate is not None
    return candidate.frame, (
        f"cells: {candidate.frame.cell_m * 1e3:.3g} mm are the finest that fit the memory, "
        f"{candidate.stored:.3g} cells; the medium needs {wanted_m * 1e3:.3g} mm. Their error is "
        "stated as `cells`; domain.leaf_edge_m sets others",
    )


def lattice_frames(
    domain: Domain, sources: Sources, *, edge_m: float, spacing_m: float
) -> tuple[Cube, Cube]:
    """The domain's cube in cells of a lattice, and the cube that is aligned with the boxes on it.

    `edge_m` of the first is at least that of the domain, and `spacing_m` times a power of 2.
    """
    undivided = Cube.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=2 * domain.edge_m
    )
    refuse_outside(undivided, sources)
    cube = Cube.around(centre_m=domain.centre_m, edge_m=edge_m, leaf_edge_m=spacing_m * (1 + 1e-9))
    return cube, on_grid(cube, sources, voxel_m=spacing_m) or cube
