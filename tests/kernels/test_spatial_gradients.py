"""Spatial gradients of sources: their effect on the image, and how neighbours give them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import Octree, build_octree
from cldit.scene import parse_scene
from cldit.transport.cells import OpticalCells
from cldit.transport.image import FormalSolution
from cldit.transport.view import View

from .cell_twin import spatial_gradients
from .medium import cells_source

EDGE_M = 0.16
CELLS = 16
DEPTH = 0.1  # of a cell


def block(shape: tuple[int, int, int] = (8, 8, 8), times: float = 1.0) -> Octree:
    """So many cells, from the fifth of 16 on along each axis, that scatter and absorb alike; along
    x each is so many times as deep as the one before."""
    frame = Cube(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=4)
    place = np.argwhere(np.ones(shape, bool)) + 4
    even = np.asarray(DEPTH / 2 / frame.cell_m * times ** (place[:, 0] - 4.0), np.float64)
    source = cells_source(frame, place, droplet_absorption=even, droplet_scattering=even)
    return build_octree(frame, None, [source], optical_depth_split=1e-5)


@pytest.fixture(scope="module")
def cells() -> OpticalCells:
    return OpticalCells.of(block())


def test_a_source_that_is_linear_is_seen_so(device: Device, cells: OpticalCells) -> None:
    """Along y, through cells whose source rises along x and z: each pixel sees it where it is."""
    scene = parse_scene(
        {
            "name": "block",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 15.9},
            "spray": {"model": "none"},
            "camera": {"model": "orthographic", "field_m": [0.078, 0.078], "pixels": [39, 39]},
        }
    )
    view = View.of(scene, cells, device)
    defines: dict[str, Any] = {**cells.needs.defines}
    formal_solution = FormalSolution.of(
        cells, view, scene, device, defines, cutoff=1e-6, linear=True
    )
    rise = np.array([0.03, 0.0, -0.02])
    at = cells.positions(cells.address) + 0.5 - CELLS / 2
    parts = len(cells.needs.components)
    source = np.zeros((parts, len(at)), np.float32)
    source[1] = 0.4 + at @ rise
    across = np.zeros((3, parts, len(at)), np.float32)
    across[:, 1] = rise[:, None] / cells.albedo  # of the radiance
    known = np.arange(len(at)), across
    rays = formal_solution.with_sources([source], np.zeros(len(at)), known=known)
    planes = rays.middle().reshape(1, -1, 39, 39)
    cell_m = EDGE_M / CELLS
    side = ((np.arange(39) + 0.5) / 39 - 0.5) * 0.078 / cell_m
    expected = 0.4 + side[None, :] * rise[0] - side[:, None] * rise[2]
    absorbed = -np.expm1(-8 * DEPTH)
    straight = planes[0][0] + planes[0][1] - absorbed * expected  # what is seen through the block
    np.testing.assert_allclose(straight, np.exp(-8 * DEPTH), atol=2e-6)
    np.testing.assert_allclose(planes[0][-1], absorbed * (1 - expected), atol=2e-6)


def test_change_of_light(cells: OpticalCells) -> None:
    """Of light that is linear in space it is exact, at the edge of the medium too; of a cell alone
    it is none; and it leaves no cell with less than no light of any component."""
    at = cells.positions(cells.address)
    rise = np.array([0.03, -0.01, 0.02])
    light = np.stack([0.5 + at @ rise, 0.1 + 0 * at[:, 0]])
    found = spatial_gradients(light, cells, cells.box())
    np.testing.assert_allclose(found[:, 0], np.broadcast_to(rise[:, None], found[:, 0].shape))
    assert not found[:, 1].any()
    rng = np.random.default_rng(2)
    steep = rng.exponential(size=(3, len(at))) ** 4
    limited = spatial_gradients(steep, cells, cells.box())
    lowest = steep - np.abs(limited).sum(axis=0) / 2
    assert lowest.min() > -1e-12
    assert (lowest < 1e-9).any()  # the bound is met


def test_change_between_unequal_cells() -> None:
    """Two cells, one nine times as deep: at the face between them light is the same from either
    side, and a quarter of the difference away from the thinner one's mean; it changes as much on
    their other sides."""
    two = OpticalCells.of(block((2, 1, 1), times=9.0))
    thin, deep = np.argsort(two.depth[two.address])
    light = np.zeros((1, 2))
    light[0, thin], light[0, deep] = 0.5, 0.7
    along_x = spatial_gradients(light, two, two.box())[0, 0]
    assert light[0, thin] + along_x[thin] / 2 == pytest.approx(0.55, abs=1e-7)
    assert light[0, deep] - along_x[deep] / 2 == pytest.approx(0.55, abs=1e-7)
    assert not spatial_gradients(light, two, two.box())[1:].any()
