"""Shares of the boundary that pixels see, against the NumPy twin of lines and boundary."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import build_octree
from cldit.scene import parse_scene
from cldit.transport.boundary import boundary_seen
from cldit.transport.cells import OpticalCells
from cldit.transport.view import View

PATCHES = [
    {"name": "window", "shape": "rectangle", "centre_m": [-0.05, 0.05, 0.0], "size_m": [0.04, 0.06],
     "facing": [1.0, -1.0, 0.0], "temperature_K": 400.0},
    {"name": "nozzle", "shape": "disc", "centre_m": [0.01, -0.03, 0.01], "radius_m": 0.008,
     "facing": [0.0, -1.0, 0.2], "temperature_K": 350.0},
]  # fmt: skip


@pytest.mark.parametrize("across", [1, 3])
@pytest.mark.parametrize("shape", ["disc", "enclosure"])
@pytest.mark.parametrize("camera", [{"model": "pinhole"}, {"model": "orthographic"},
                                    {"lens": {}}])  # fmt: skip
def test_shares_are_those_of_the_twin(
    device: Device, across: int, shape: str, camera: dict[str, Any]
) -> None:
    scene = parse_scene(
        {
            "name": "boundary",
            "spray": {"model": "none"},
            "camera": {"field_m": [0.16, 0.12], "pixels": [41, 31], **camera},
            "background": {"shape": shape, "radius_m": 0.05},
            "patches": PATCHES,
        }
    )
    frame = Cube((-0.032, -0.032, -0.032), 0.064, 6)
    cells = OpticalCells.of(build_octree(frame, None, [], optical_depth_split=1.0),
                            patches=("window", "nozzle"))  # fmt: skip
    view = View.of(scene, cells, device)
    pixels = np.arange(41 * 31)[::2]
    shares = view.boundary_shares(pixels, np.full(len(pixels), across))
    row, column = np.divmod(pixels, 41)
    right, down, *lens = view.places(across).T
    plane = np.zeros((len(pixels), across**2, 3))
    plane[..., 0] = (column[:, None] + right - 0.5 * 41) * view.pitch[0]
    plane[..., 2] = (0.5 * 31 - (row[:, None] + down)) * view.pitch[1]
    toward = np.zeros_like(plane) + np.array([0.0, view.distance, 0.0])
    if camera.get("model") != "orthographic":
        toward += plane
        toward[..., 0] -= lens[0]
        toward[..., 2] -= lens[1]
    toward /= np.linalg.norm(toward, axis=2, keepdims=True)
    start = view.middle[:3] + plane - view.distance / toward[..., 1:2] * toward
    centre, radius = view.disc[:3], float(view.disc[3]) ** 0.5
    if shape == "enclosure":  # behind every patch
        centre, radius = np.array([0.0, 1e12, 0.0]), np.inf
    seen = boundary_seen(
        start.reshape(-1, 3), toward.reshape(-1, 3), centre=centre, radius=radius,
        patches=view.patches,
    ).reshape(len(pixels), -1)  # fmt: skip
    expected = np.array([(seen == part).mean(axis=1) for part in range(4)])
    if not device.info.float64:  # a line may pass an edge on the other side
        assert np.mean(shares != expected) < 0.01
        return
    np.testing.assert_array_equal(shares, expected)
    assert np.all(shares[0 if shape == "enclosure" else 1].sum() > 0) and np.all(
        shares[2:].sum(axis=1) > 0
    )
