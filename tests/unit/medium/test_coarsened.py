"""An octree on larger cells has the same integrals, and the same medium at every place."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.medium.coarsened import coarsened
from cldit.medium.frame import Frame
from cldit.medium.octree import FIELDS, CellSource, Octree, PointSource, build_octree

CUBE = Frame((0.0, 0.0, 0.0), edge_m=0.1, depth=6)


def medium(depth: int) -> Octree:
    """Droplets of two classes of size in a part of the cube, and thin vapour about them."""
    rng = np.random.default_rng(3)
    amount, second = rng.uniform(1e-8, 1e-6, (2, 3000))
    place = rng.uniform(0.021, 0.049, (3000, 3))
    droplets = PointSource(
        place, amount, 2 * amount + second, 3 * amount, class_scattering_m2=(second,)
    )
    lower = np.array([[0.0, 0.0, 0.0], [0.0125, 0.05, 0.025], [0.03, 0.03, 0.03]])
    edge, none = np.array([[0.1], [0.0125], [0.02]]), np.zeros(3)
    vapour = np.array([1e-6, 0.5, 20.0])
    gas = CellSource(lower, lower + edge, vapour, 3 * vapour, none, none, none)
    return build_octree(CUBE.at(depth), droplets, [gas], optical_depth_split=1e-2)


def dense(tree: Octree, values: np.ndarray) -> np.ndarray:
    """A field (n, n, n) of every finest cell."""
    at = np.indices((tree.frame.cells,) * 3)
    slot = tree.directory[tuple(at // 8)].astype(np.int64)
    z, y, x = at % 8
    stored = slot * 512 + (z * 8 + y) * 8 + x
    return np.asarray(values[np.where(slot >= 0, stored, tree.slots * 512 - 1 - slot)], float)


@pytest.mark.parametrize("halvings", [1, 2, 3])
def test_every_cell_is_the_mean_of_its_parts(halvings: int) -> None:
    """Sums of 8 to 512 numbers in single precision: 1e-6 of the largest."""
    tree = medium(6)
    large, fold = coarsened(tree, halvings), 1 << halvings
    count = large.frame.cells
    assert large.frame == CUBE.at(6 - halvings)
    for name in FIELDS:
        fine, coarse = dense(tree, tree.fields[name]), dense(large, large.fields[name])
        means = fine.reshape(count, fold, count, fold, count, fold).mean(axis=(1, 3, 5))
        np.testing.assert_allclose(coarse, means, rtol=0, atol=1e-6 * fine.max())
        assert large.integral(name) == pytest.approx(tree.integral(name), rel=1e-6)
    filled = dense(large, np.ones_like(large.fields[FIELDS[0]])) > 0
    assert filled.all() and np.all(np.diff(large.coarse_level[: large.frame.depth + 1]) == 1)


def test_shares_of_size_classes_are_weighted_by_scattering() -> None:
    """Stored in 255ths: both roundings are at most 1 together."""
    tree = medium(6)
    large = coarsened(tree, 1)
    assert tree.shares is not None and large.shares is not None
    name = "droplet_scattering"
    part = dense(tree, tree.fields[name] * tree.shares[0]).reshape(32, 2, 32, 2, 32, 2)
    whole = dense(large, large.fields[name])
    there = whole > 0
    share = part.mean(axis=(1, 3, 5))[there] / whole[there]
    assert np.abs(dense(large, large.shares[0])[there] - share).max() <= 0.51


def test_a_cube_keeps_a_brick() -> None:
    tree = medium(4)
    assert coarsened(tree, 5).frame.depth == 3
    assert coarsened(medium(3), 1).frame.depth == 3 and coarsened(tree, 0) is tree
