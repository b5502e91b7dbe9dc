"""Extinction that is linear in cells: convergence to a smooth medium, and one medium for all methods."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.scene import Scene, parse_scene
from cldit.transport.trace import Settings, Trace, trace

EDGE_M = 0.16
SIGMA_M = 0.012
CENTRE_M = np.array([0.0013, -0.0021, 0.0017])  # nowhere a centre of cells
DEPTH = 1.5  # through the middle
SETTINGS = Settings(
    directions=16,
    final_directions=96,
    tolerance=1e-4,
    order=None,
    cutoff=1e-6,
    precision="float32",
    seed=1,
    accuracy_K=0.1,
)


def gaussian_tree(cells: int, *, albedo: float = 0.0, coarse: bool = False) -> Octree:
    """Exact cell means of a Gaussian extinction; `coarse` divides only where it varies."""
    frame = Frame(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=cells.bit_length() - 1)
    edges = -EDGE_M / 2 + frame.cell_m * np.arange(cells + 1)
    x, y, z = (np.diff(ndtr((edges - at) / SIGMA_M)) for at in CENTRE_M)
    whole = DEPTH * (2 * np.pi) * SIGMA_M**2  # integral of the extinction
    mean = whole * x[:, None, None] * y[:, None] * z / frame.cell_m**3
    place = np.argwhere(mean * frame.cell_m > 1e-9)
    mean = mean[tuple(place.T)]
    lower = -EDGE_M / 2 + place * frame.cell_m
    nothing = np.zeros(len(place))
    gas = coarse or albedo == 0.0
    source = CellSource(
        lower_m=lower,
        upper_m=lower + frame.cell_m,
        vapour_absorption=mean if gas else nothing,
        vapour_emission=nothing,
        droplet_absorption=nothing if gas else (1 - albedo) * mean,
        droplet_scattering=albedo * mean,
        droplet_emission=nothing,
    )
    split = 2e-4 if coarse else 1e-9
    return build_octree(frame, None, [source], optical_depth_split=split)


def scene(**camera: Any) -> Scene:
    """A camera so near that most lines of sight run across the axes, before a black wall."""
    return parse_scene(
        {
            "name": "gaussian",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 127},
            "spray": {"model": "none"},
            "camera": {
                "distance_m": 0.2,
                "field_m": [0.08, 0.08],
                "pixels": [37, 37],
                **camera,
            },
            "background": {"radius_m": 0.5, "centre_m": [0.0, 0.081, 0.0]},
        }
    )


def exact_transmission(pixels: int = 37) -> NDArray[np.float64]:
    """exp(-depth) of every line of sight."""
    place = (np.arange(pixels) + 0.5 - pixels / 2) * 0.08 / pixels
    x, z = np.meshgrid(place, -place)
    along = np.stack([x, np.full_like(x, 0.2), z], axis=2)
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    off = np.array([0.0, -0.2, 0.0]) - CENTRE_M
    square = np.sum(off**2) - (along @ off) ** 2
    return np.asarray(np.exp(-DEPTH * np.exp(-square / (2 * SIGMA_M**2))))


def errors(device: Device, *, linear: bool, coarse: bool) -> list[float]:
    out = []
    for cells in (16, 32, 64, 128):
        settings = Settings(**{**vars(SETTINGS), "linear_coefficients": linear})
        got = trace(gaussian_tree(cells, coarse=coarse), scene(), device, settings)
        out.append(float(np.sqrt(np.mean((got.weights.background - exact_transmission()) ** 2))))
    return out


@pytest.mark.parametrize("coarse", [False, True])
def test_second_order(device: Device, coarse: bool) -> None:
    for linear in (False, True):
        found = errors(device, linear=linear, coarse=coarse)
        print(coarse, linear, found, -np.diff(np.log2(found)))
