"""Which cells a medium of boxes needs, and which fit: independent of how trees are built."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.errors import MediumError
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, Octree, PointSource, Sources, build_octree
from cldit.medium.resolution import (
    ACROSS,
    candidates,
    divided_voxels,
    in_whole_cells,
    needed_edge_m,
    on_grid,
    within,
)
from cldit.spray.extent import Box, Cloud, Extent
from cldit.spray.result import Cells

EDGE = 0.2
CUBE = Cube(lower_m=(-0.1, -0.1, -0.1), edge_m=EDGE, depth=0)


def source(lower: Floats, upper: Floats, extinction: Floats, albedo: float = 0.8) -> CellSource:
    none = np.zeros(len(lower))
    absorbed = (1 - albedo) * extinction
    return CellSource(lower, upper, none, none, absorbed, albedo * extinction, absorbed)


def voxels(
    shape: tuple[int, int, int], spacing_m: tuple[float, float, float], depth: float = 0.1
) -> Sources:
    """A grid about the middle whose voxels have this optical depth along their shortest edge."""
    spacing = np.array(spacing_m)
    cells = Cells.regular(origin_m=-np.array(shape) * spacing / 2, spacing_m=spacing, shape=shape)
    extinction = np.full(len(cells.lower_m), depth / spacing.min())
    return None, [source(cells.lower_m, cells.upper_m, extinction)]


def droplets(place: Floats, extent: Extent | None = None) -> PointSource:
    one = np.ones(len(place))
    return PointSource(place, one, one, one, extent)


def tree_of(frame: Cube, sources: Sources, device: Device | None = None) -> Octree:
    return build_octree(frame, *sources, optical_depth_split=1e-5, device=device)


@pytest.mark.parametrize(
    ("shape", "spacing", "cell", "cells"),
    [
        ((24, 24, 24), (4e-3,) * 3, 4e-3, 32),
        ((64, 64, 64), (0.2 / 64,) * 3, 0.2 / 64, 64),
        ((7, 5, 3), (1e-3,) * 3, 1e-3, 8),
        ((1, 1, 1), (0.01,) * 3, 0.01, 1),
        ((1, 1, 1), (0.2, 0.2 / 64, 0.2), 0.2 / 64, 64),
        ((10, 10, 10), (2e-3, 3e-3, 4e-3), 1e-3, 64),
    ],
)
def test_the_cube_is_laid_on_the_grid(
    shape: tuple[int, int, int], spacing: tuple[float, float, float], cell: float, cells: int
) -> None:
    frame = on_grid(CUBE, voxels(shape, spacing))
    assert frame is not None
    assert frame.cells == cells
    assert frame.cell_m == pytest.approx(cell, rel=1e-12)
    np.testing.assert_allclose(frame.lower_m, -np.array(shape) * np.array(spacing) / 2)
    needed = needed_edge_m(CUBE, voxels(shape, spacing))
    few = max(np.array(shape) * np.array(spacing)) / frame.cell_m < ACROSS
    assert needed < frame.cell_m if few else needed == frame.cell_m


def test_voxels_of_the_grid_are_the_leaves() -> None:
    """24^3 random voxels: every one is a leaf of its own value, and nothing else is stored."""
    rng = np.random.default_rng(1)
    (_, (grid,)) = voxels((24, 24, 24), (4e-3,) * 3)
    values = rng.uniform(5, 125, 24**3)
    sources: Sources = (None, [source(grid.lower_m, grid.upper_m, values, 1.0)])
    frame = on_grid(CUBE, sources)
    assert frame is not None
    tree = tree_of(frame, sources)
    assert tree.slots == 27
    found = np.sort(tree.fields["droplet_scattering"][: 27 * 512])
    np.testing.assert_allclose(found, np.sort(values), rtol=1e-6)


def through(tree: Octree, start: Floats, toward: Floats, name: str) -> float:
    """A field along a line through the cube, cell by cell from the faces that it crosses."""
    frame = tree.frame
    place, step = frame.to_cells(start[None])[0], toward / frame.cell_m
    faces = (np.arange(frame.cells + 1)[:, None] - place) / step
    cuts = np.unique(faces[np.isfinite(faces)])
    middle = place + (cuts[1:] + cuts[:-1])[:, None] / 2 * step
    inside = np.all((middle > 0) & (middle < frame.cells), axis=1)
    x, y, z = np.floor(middle[inside]).astype(int).T
    slot = tree.directory[z // 8, y // 8, x // 8].astype(int)
    local = ((z % 8) * 8 + y % 8) * 8 + x % 8
    address = np.where(slot >= 0, slot * 512 + local, tree.slots * 512 - 1 - slot)
    return float(np.sum(tree.fields[name][address].astype(float) * np.diff(cuts)[inside]))


def exactly(sources: Sources, start: Floats, toward: Floats) -> float:
    """Scattering along the same line, box by box: its way in each by the slabs' three intervals."""
    total = 0.0
    for each in sources[1]:
        near, far = (each.lower_m - start) / toward, (each.upper_m - start) / toward
        way = np.maximum(near, far).min(axis=1) - np.minimum(near, far).max(axis=1)
        total += float(np.sum(each.droplet_scattering * np.maximum(way, 0.0)))
    return total


@pytest.mark.parametrize("shape", [(24, 24, 24), (20, 17, 13)])
def test_lines_see_the_boxes_exactly(shape: tuple[int, int, int]) -> None:
    """Cells that are the boxes have their integrals along any line, to float32's 6e-8 a cell; cells
    of the domain's own cube that are nearly as large are off by a hundredfold of that and more."""
    rng = np.random.default_rng(2)
    _, (grid,) = voxels(shape, (4e-3,) * 3)
    values = rng.uniform(5, 125, len(grid.lower_m)) * (rng.random(len(grid.lower_m)) < 0.7)
    sources: Sources = (None, [source(grid.lower_m, grid.upper_m, values)])
    frame = on_grid(CUBE, sources)
    assert frame is not None
    laid, anyhow = tree_of(frame, sources), tree_of(Cube(CUBE.lower_m, EDGE, 6), sources)
    off = []
    for _ in range(60):
        start, toward = rng.uniform(-0.02, 0.02, 3), rng.normal(size=3)
        toward /= np.linalg.norm(toward)
        true = exactly(sources, start, toward)
        assert through(laid, start, toward, "droplet_scattering") == pytest.approx(true, rel=1e-6)
        off.append(abs(through(anyhow, start, toward, "droplet_scattering") / true - 1))
    assert np.median(off) > 1e-4


def test_a_grid_of_two_levels_is_a_grid() -> None:
    """Large boxes among small ones, as adaptive codes write them."""
    _, (fine,) = voxels((4, 4, 4), (1e-3,) * 3)
    _, (coarse,) = voxels((1, 1, 1), (4e-3,) * 3)
    apart = np.array([4e-3, 0.0, 0.0])
    far = source(coarse.lower_m + apart, coarse.upper_m + apart, np.ones(1))
    frame = on_grid(CUBE, (None, [fine, far]))
    assert frame is not None and frame.cell_m == pytest.approx(1e-3)


def test_boxes_on_no_grid_get_cells_of_half_their_edge() -> None:
    rng = np.random.default_rng(3)
    lower = rng.uniform(-0.09, 0.07, (200, 3))
    sources: Sources = (None, [source(lower, lower + 4e-3, np.full(200, 10.0))])
    assert on_grid(CUBE, sources) is None
    assert needed_edge_m(CUBE, sources) == pytest.approx(2e-3, rel=1e-6)
    frames = [each.frame for each in candidates(CUBE, sources, None, limit=10**6)]
    assert all((frame.lower_m, frame.edge_m) == (CUBE.lower_m, EDGE) for frame in frames)


@pytest.mark.parametrize("depth", [0.3, 1e6])
def test_voxels_of_any_optical_depth_are_their_own_cells(depth: float) -> None:
    """The estimated error divides them, no rule does; few along the medium are divided."""
    sources = voxels((10, 10, 10), (8e-3,) * 3, depth=depth)
    assert needed_edge_m(CUBE, sources) == pytest.approx(8e-3)
    opaque = voxels((1, 1, 1), (8e-3,) * 3, depth=depth)
    assert needed_edge_m(CUBE, opaque) == pytest.approx(8e-3 / ACROSS)
    _, (grid,) = voxels((4, 4, 4), (8e-3,) * 3)
    black = source(grid.lower_m, grid.upper_m, np.full(len(grid.lower_m), 1e4), albedo=0.0)
    assert needed_edge_m(CUBE, (None, [black])) == pytest.approx(8e-3)


@pytest.mark.parametrize(
    ("leaf_m", "cell_m"), [(4e-3, 4e-3), (3.9e-3, 2e-3), (2e-3, 2e-3), (1.1e-3, 1e-3), (9e-3, 8e-3)]
)
def test_a_leaf_divides_or_joins_whole_voxels(leaf_m: float, cell_m: float) -> None:
    sources = voxels((24, 24, 24), (4e-3,) * 3)
    frame = divided_voxels(CUBE, sources, leaf_m=leaf_m)
    assert frame is not None and frame.cell_m == pytest.approx(cell_m, rel=1e-9)
    assert in_whole_cells(frame, sources) == (cell_m <= 4e-3)


def test_a_box_that_nobody_sees_asks_for_no_cells() -> None:
    """1e-6 m beside 0.1 m: no cube has such cells, and it dims 1e-10 of what the other does."""
    lower = np.array([[-0.1, -0.05, -0.05], [0.0501, 0.0302, 0.0403]])
    upper = lower + np.array([[0.1], [1e-6]])
    sources: Sources = (None, [source(lower, upper, np.array([10.0, 1e12]), 0.0)])
    assert on_grid(CUBE, sources) is None
    assert needed_edge_m(CUBE, sources) == pytest.approx(0.05)
    tree = tree_of(Cube(CUBE.lower_m, EDGE, 4), sources)
    assert tree.integral("droplet_absorption") == pytest.approx(10.0 * 1e-3 + 1e-6, rel=2e-7)


def test_candidates_go_from_one_cell_to_the_finest_that_fits() -> None:
    """What they say is stored is what a tree stores, but for thin bricks that it merges."""
    rng = np.random.default_rng(4)
    points = droplets(rng.normal(0, 0.01, (300, 3)))
    for sources in ((points, []), voxels((24, 24, 24), (4e-3,) * 3)):
        found = list(candidates(CUBE, sources, None, limit=200_000))
        assert found[0].frame.depth == 0
        assert all(b.frame.depth == a.frame.depth + 1 for a, b in pairwise(found))
        assert found[-1].memory_cells <= 200_000
        following = Cube(found[-1].frame.lower_m, found[-1].frame.edge_m, len(found))
        assert tree_of(following, sources).slots * 512 > 200_000 / 2
        for each in found:
            tree = tree_of(each.frame, sources)
            assert tree.slots * 512 == each.stored
            assert each.stored <= each.swept or each.frame.cells < 8


def test_droplets_in_the_boxes_of_a_lattice_are_on_a_grid_too() -> None:
    rng = np.random.default_rng(5)
    index = np.repeat(rng.choice(20, (50, 3)), 2, axis=0)
    points = droplets(np.asarray((index - 9.5) * 2e-3), Box(np.full(3, 2e-3)))
    gas = voxels((10, 10, 10), (2e-3,) * 3)[1]
    frame = on_grid(CUBE, (points, gas))
    assert frame is not None and frame.cell_m == pytest.approx(2e-3)


def test_parcels_beside_the_gas_have_room(device: Device) -> None:
    """Points and clouds lie on no grid: gas keeps its own, and the cube reaches to all of them."""
    gas = voxels((10, 10, 10), (2e-3,) * 3)[1]
    place = np.array([[0.0, 0.0, -0.05], [0.03, 0.0, 0.0]])
    spread = Cloud(np.eye(3)[None] * np.array([1e-6, 4e-6])[:, None, None])
    for extent in (None, spread):
        sources: Sources = (droplets(place, extent), gas)
        frame = on_grid(CUBE, sources)
        assert frame is not None and frame.cell_m == pytest.approx(2e-3)
        bricks = (np.array([-0.01] * 3) - np.array(frame.lower_m)) / (8 * frame.cell_m)
        np.testing.assert_allclose(bricks, np.rint(bricks), atol=1e-9)
        tree = tree_of(frame, sources, device)
        assert tree.integral("droplet_scattering") == pytest.approx(
            2.0 + 0.8 * 0.1 / 2e-3 * 8e-6, rel=1e-6
        )
        assert frame.lower_m[2] <= -0.05
        assert np.all(np.array(frame.lower_m) + frame.edge_m >= [0.03, 0.01, 0.01])


def test_a_medium_in_whole_cells() -> None:
    """On voxels or parts of them; not on cells that are larger, or lie across, or with parcels."""
    sources = voxels((24, 24, 24), (4e-3,) * 3)
    laid = on_grid(CUBE, sources)
    assert laid is not None and in_whole_cells(laid, sources)
    assert in_whole_cells(laid.at(laid.depth + 1), sources)
    assert not in_whole_cells(laid.at(laid.depth - 3), sources)
    assert not in_whole_cells(CUBE.at(6), sources)
    assert not in_whole_cells(laid, (droplets(np.zeros((1, 3))), sources[1]))
    assert in_whole_cells(CUBE, (None, []))


def test_nothing_and_what_cannot_be() -> None:
    empty: Sources = (None, [])
    assert on_grid(CUBE, empty) is None
    assert needed_edge_m(CUBE, empty) == EDGE
    assert next(candidates(CUBE, empty, None)).stored == 0
    _, (grid,) = voxels((2, 2, 2), (0.01,) * 3)
    none = source(grid.lower_m, grid.upper_m, np.zeros(8))
    assert needed_edge_m(CUBE, (None, [none])) == pytest.approx(0.01)
    assert not tree_of(CUBE, (None, [none])).has_droplets
    outside = source(grid.lower_m + 0.1, grid.upper_m + 0.1, np.ones(8))
    with pytest.raises(MediumError, match=r"is outside the domain.*domain\.edge_m"):
        next(candidates(CUBE, (None, [outside]), None))
    with pytest.raises(MediumError, match="no boxes"):
        needed_edge_m(CUBE, (droplets(np.zeros((1, 3))), []))
    with pytest.raises(MediumError, match="allowed: 100"):
        next(candidates(CUBE, (None, [grid]), None, limit=100))


def test_what_lies_outside_is_cut_off() -> None:
    """A quarter of one of three cells, and one of four parcels; the octree takes the rest."""
    edge_m = 8e-3
    cube = Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=0.064, leaf_edge_m=2e-3)
    # The last one touches the cube from outside.
    lower = np.array([[0.0, 0.0, 0.0], [-0.034, 0.0, 0.0], [0.0, 0.0, 0.032]])
    gas = source(lower, lower + edge_m, np.ones(3), albedo=0.0)
    points = droplets(np.array([[0, 0, 0], [0.03, 0, 0], [0, 0, -0.03], [0.04, 0, 0]]))
    (parcels, (cells,)), lost = within(cube, (points, [gas]))
    assert lost == pytest.approx((0.25 + 1) / 3)  # of the gas, which is more than 1/4
    assert parcels is not None and len(parcels.position_m) == 3
    assert len(cells.lower_m) == 2 and cells.lower_m[1, 0] == pytest.approx(-0.032)
    with pytest.raises(MediumError):
        tree_of(cube, (points, [gas]))
    assert tree_of(cube, (None, [cells])).integral("droplet_absorption") == pytest.approx(
        1.75 * edge_m**3
    )
    (_, (same,)), none = within(cube, (None, [source(lower[:1], lower[:1] + edge_m, np.ones(1))]))
    assert none == 0.0 and np.array_equal(same.upper_m, lower[:1] + edge_m)
