"""A medium by chance, and its box on the device."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Program, build
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.scene import Scene, parse_scene
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.trace import TraceSettings

EDGE_M = 0.16
DISC = np.array([8.0, 17.0, 9.0, 16.0])
ENCLOSURE = np.array([0.0, 0.0, 0.0, np.inf])


def cells_source(
    frame: Cube, place: NDArray[np.integer], **coefficients: NDArray[np.float64]
) -> CellSource:
    """Finest cells (N, 3; x, y, z) of a cube with these coefficients (N,); the others are 0."""
    lower = np.asarray(frame.lower_m + place * frame.cell_m, np.float64)
    names = ("vapour_absorption", "vapour_emission", "droplet_absorption", "droplet_scattering",
             "droplet_emission")  # fmt: skip
    full = {name: np.zeros(len(place)) for name in names} | coefficients
    return CellSource(lower_m=lower, upper_m=lower + frame.cell_m, **full)


def random_tree(
    seed: int, *, cells: int = 16, scattering: float = 1.0, hollow: bool = False
) -> Octree:
    """A block of random coefficients in part of the cube, with empty cells among them.

    hollow: bricks from 8 to 16 along x are empty, and therefore coarse leaves, between others.
    """
    rng = np.random.default_rng(seed)
    frame = Cube(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=cells.bit_length() - 1)
    filled = rng.random((cells // 2, cells - 3, cells // 2)) < 0.7
    if hollow:
        filled[5:13] = False
    place = np.argwhere(filled) + np.array([3, 1, 5])
    values = rng.uniform(0.0, 0.6, (5, len(place))) / frame.cell_m
    return build_octree(
        frame,
        None,
        [
            cells_source(
                frame,
                place,
                vapour_absorption=values[0],
                vapour_emission=values[0] * rng.random(len(place)),
                droplet_absorption=values[2],
                droplet_scattering=scattering * values[3],
                droplet_emission=values[2] * rng.random(len(place)),
            )
        ],
        optical_depth_split=1e-5,
    )


def source_planes(cells: OpticalCells) -> NDArray[np.float64]:
    """Thermal source (C, P) of all stored cells; what comes from outside begins in none."""
    outside = np.zeros((cells.needs.boundaries, len(cells.depth)))
    return np.concatenate([outside, cells.thermal_planes(np.float64)])


def sweep_program(device: Device, cells: OpticalCells, defines: dict[str, Any]) -> Program:
    """sweep.cl with these beside what the cells need; the device's packets unless `defines` has
    other ones."""
    packets = simd_defines(device)
    return build(device, "sweep.cl", {**cells.needs.defines, **packets, **defines})


def sweeper_of(
    device: Device,
    cells: OpticalCells,
    defines: dict[str, Any] | None = None,
    disc: NDArray[np.float64] = DISC,
    **more: Any,
) -> Sweeper:
    """The tree's box on the device, by `sweep_program`; `more` are arguments of the sweeper."""
    program = sweep_program(device, cells, defines or {})
    update = build(device, "source_update.cl", program.defines)
    return Sweeper(device, cells, program, update, disc=disc, **more)


def scene_of(**camera: Any) -> Scene:
    """A camera and a disc before the medium; of the scene's own there is none."""
    return parse_scene(
        {
            "name": "random",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 15.9},
            "spray": {"model": "none"},
            "camera": {"distance_m": 0.3, "field_m": [0.15, 0.12], "pixels": [9, 7], **camera},
            "background": {"radius_m": 0.03},
        }
    )


def settings_of(**changes: Any) -> TraceSettings:
    """Settings of a trace along few ordinates, without gather and audit."""
    few: dict[str, Any] = {
        "directions": 8,
        "final_directions": 16,
        "tolerance": 1e-3,
        "order": None,
        "cutoff": 1e-4,
        "precision": "float32",
        "seed": 1,
        "gather": False,
        "audit": False,
    }
    return TraceSettings(**{**few, **changes})
