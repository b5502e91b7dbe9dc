"""A medium by chance, and its box on the device."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import build
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
    lower = -EDGE_M / 2 + place * frame.cell_m
    values = rng.uniform(0.0, 0.6, (5, len(place))) / frame.cell_m
    return build_octree(
        frame,
        None,
        [
            CellSource(
                lower_m=lower,
                upper_m=lower + frame.cell_m,
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


def sweeper_of(
    device: Device,
    cells: OpticalCells,
    defines: dict[str, Any] | None = None,
    disc: NDArray[np.float64] = DISC,
) -> Sweeper:
    """The tree's box on the device, compiled with these beside what the cells need."""
    common = {**cells.needs.defines, **(defines or {})}
    return Sweeper(
        device,
        cells,
        build(device, "sweep.cl", {**common, **simd_defines(device)}),
        build(device, "source_update.cl", {**common, **simd_defines(device)}),
        disc=disc,
    )


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
