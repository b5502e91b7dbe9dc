"""The image kernel as a whole, against the NumPy reference of the same physics."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells
from cldit.transport.trace import trace

from .medium import random_tree, scene_of, settings_of, source_planes
from .reference import march


@pytest.mark.parametrize(
    ("model", "edge"), [("pinhole", 16), ("orthographic", 16), ("pinhole", 32)]
)
def test_image_against_numpy(device: Device, model: str, edge: int) -> None:
    """Order 0 of a random medium, ray by ray, against independently computed cell crossings.

    edge: cells along that of the cube; with 32, rays cross coarse leaves on their way down in x.
    """
    tree = random_tree(6, cells=edge, hollow=edge == 32)
    scene = scene_of(model=model)
    got = trace(tree, scene, device, settings_of(order=0, cutoff=0.0))
    cells = OpticalCells.of(tree)
    planes = source_planes(cells)
    planes[1, cells.address] += cells.albedo
    whole = type(cells.box())(low=(0, 0, 0), shape=(edge,) * 3)
    source = np.stack([cells.dense(whole, plane) for plane in planes])
    depth = cells.dense(whole, cells.depth)
    cell = tree.frame.cell_m
    for row in range(7):
        for column in range(9):
            x = (column + 0.5 - 4.5) * 0.15 / 9
            z = (3.5 - row - 0.5) * 0.12 / 7
            point = np.array([x, 0.0, z]) / cell + edge / 2
            toward = np.array([x, 0.3, z]) if model == "pinhole" else np.array([0.0, 1.0, 0.0])
            toward = toward / np.linalg.norm(toward)
            light, left = march(depth, source, point=point, toward=toward)
            hit = point + (edge - point[1]) / toward[1] * toward
            on_disc = np.hypot(hit[0] - edge / 2, hit[2] - edge / 2) <= 0.03 / cell
            expected = light + left * np.array([on_disc, not on_disc, 0, 0])
            values = [
                got.weights.background[row, column],
                got.weights.wall[row, column],
                got.weights.vapour[row, column] / cells.scale,
                got.weights.liquid[row, column] / cells.scale,
            ]
            # 16 cells, each placed to 1e-6 of its edge and rounded a few times; or 32.
            np.testing.assert_allclose(values, expected, atol=3e-6 * edge / 16)
