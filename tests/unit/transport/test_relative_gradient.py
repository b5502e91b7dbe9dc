"""Gradients of coefficients in cells: by definition, conserved, nothing below 0."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.medium.frame import Cube
from cldit.medium.limiter import limited
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.transport.cells import OpticalCells
from cldit.transport.linear_coefficients import LEAST
from tests.kernels.cell_twin import RecordsTwin, linear_of, middles_of, relative_gradient

CELLS = 64
FRAME = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.64, depth=6)


def tree_of(place: NDArray[np.int64], values: Floats, *, split: float = 1e-9) -> Octree:
    """Vapour of optical depth `values` (N,) in the cells `place` (N, 3; x, y, z)."""
    lower = np.asarray(place * FRAME.cell_m, np.float64)
    nothing = np.zeros(len(place))
    source = CellSource(
        lower_m=lower,
        upper_m=np.asarray(lower + FRAME.cell_m, np.float64),
        vapour_absorption=values / FRAME.cell_m,
        vapour_emission=nothing,
        droplet_absorption=nothing,
        droplet_scattering=nothing,
        droplet_emission=nothing,
    )
    return build_octree(FRAME, None, [source], optical_depth_split=split)


def leaf_at(tree: Octree, place: NDArray[np.int64]) -> tuple[int, int]:
    """Address of the leaf or stored cell at a place (x, y, z), and its edge in finest cells."""
    entry = int(tree.directory[tuple(place[::-1] // 8)])
    x, y, z = place % 8
    if entry >= 0:
        return entry * 512 + (z * 8 + y) * 8 + x, 1
    return tree.slots * 512 - 1 - entry, CELLS >> int(tree.coarse_level[-1 - entry])


def gradient_of(cells: OpticalCells) -> NDArray[np.float32]:
    return relative_gradient(cells.tree, cells.depth.astype(np.float32))


def slope_at(cells: OpticalCells, place: NDArray[np.int64], axis: int) -> float:
    """The limiter's definition at one stored cell, in plain numbers."""
    values, distances = [], []
    for side in (-1, 1):
        near = place.copy()
        near[axis] += side
        if near[axis] < 0 or near[axis] >= CELLS:
            values.append(0.0)
            distances.append(1.0)
            continue
        address, edge = leaf_at(cells.tree, near)
        values.append(float(cells.depth[address]))
        distances.append((1 + edge) / 2 if values[-1] else 1.0)
    mine = float(cells.depth[leaf_at(cells.tree, place)[0]])
    down, up = (mine - values[0]) / distances[0], (values[1] - mine) / distances[1]
    if down * up <= 0:
        return 0.0
    central = (down * distances[1] + up * distances[0]) / sum(distances)
    most = 2 * min(abs(mine - values[0]), abs(values[1] - mine))
    return float(np.sign(central)) * min(abs(central), most)


def test_by_definition() -> None:
    """In random cells, at sides of the cube and beside coarse leaves, empty or not."""
    rng = np.random.default_rng(5)
    place = np.argwhere(rng.random((CELLS, CELLS, CELLS)) < 0.7)
    block = np.all((place >= [0, 8, 16]) & (place < [24, 40, 32]), axis=1)
    even = np.all((place >= [32, 0, 0]) & (place < 64), axis=1)
    values = np.where(block, rng.uniform(0.02, 0.5, len(place)), 1e-9)
    tree = tree_of(place[block | even], values[block | even], split=1e-6)
    cells = OpticalCells.of(tree)
    assert 0 < tree.slots < 512 and np.any(tree.coarse_level[FRAME.depth + 1 :] < 3)
    found = gradient_of(cells)
    checked = 0
    for place_ in place[block][::7]:
        address, _ = leaf_at(tree, place_)
        mean = float(cells.depth[address])
        slopes = np.array([slope_at(cells, place_, axis) for axis in range(3)]) / mean
        slopes /= max(np.abs(slopes).sum() / 2 / (1 - LEAST), 1.0)
        np.testing.assert_allclose(found[address], slopes, atol=2e-6)
        checked += int(np.count_nonzero(slopes))
    assert checked > 300


def test_never_below_zero() -> None:
    """At no corner of any cell, whatever the neighbours; and in empty cells it is 0."""
    rng = np.random.default_rng(6)
    place = np.argwhere(rng.random((CELLS, CELLS, CELLS)) < 0.02)
    cells = OpticalCells.of(tree_of(place, 10.0 ** rng.uniform(-8, 2, len(place))))
    gradient = gradient_of(cells).astype(float)
    corner = 1 - np.abs(gradient).sum(axis=1) / 2
    assert corner.min() > 0.9 * LEAST  # rounding of three numbers
    assert corner.min() < 0.1  # it was needed
    assert not gradient[cells.depth == 0].any()


def test_linear_field_is_exact() -> None:
    """In stored cells within, whatever the direction."""
    place = np.argwhere(np.ones((16, 16, 16), bool)) + 24
    wanted = np.array([0.003, -0.007, 0.002])
    cells = OpticalCells.of(tree_of(place, 0.5 + (place - 32) @ wanted))
    inner = place[np.all((place > 24) & (place < 39), axis=1)]
    address = [leaf_at(cells.tree, one)[0] for one in inner]
    found = gradient_of(cells)[address] * cells.depth[address, None]
    np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), atol=2e-7)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coarse_leaves_of_a_linear_field(axis: int) -> None:
    """Leaves of a brick: the slope between their means, per finest cell. Its other axes have
    none, at the sides of the cube too."""
    place = np.argwhere(np.ones((CELLS, CELLS, CELLS), bool))
    values = 1e-7 * (1 + place[:, axis] / CELLS)
    cells = OpticalCells.of(tree_of(place, values, split=1.65e-6))
    tree = cells.tree
    assert tree.slots == 0
    level = tree.coarse_level[FRAME.depth + 1 :]
    assert np.all(level == 3) and len(level) == 512
    middle = np.full(3, 12)
    middle[axis] = 35
    address, edge = leaf_at(tree, middle)
    assert edge == 8
    found = gradient_of(cells)[address] * cells.depth[address]
    wanted = np.zeros(3)
    wanted[axis] = 1e-7 / CELLS
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-12)


def test_limited_against_its_bounds() -> None:
    """The value at either side lies between the cell's and the neighbour's."""
    rng = np.random.default_rng(3)
    below, middle, above = rng.exponential(size=(3, 5000))
    down, up = rng.uniform(1, 4, (2, 5000))
    slope = limited(middle, below, above, down=down, up=up)
    for side, neighbour in ((-0.5, below), (0.5, above)):
        value = middle + side * slope
        assert np.all(value >= np.minimum(middle, neighbour) - 1e-12)
        assert np.all(value <= np.maximum(middle, neighbour) + 1e-12)
    assert np.count_nonzero(slope) > 1500


CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


def random_cells(seed: int, *, isothermal: bool = False) -> OpticalCells:
    """Coefficients over four decades, each phase here and there."""
    rng = np.random.default_rng(seed)
    frame = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.32, depth=5)
    place = np.argwhere(rng.random((32, 32, 32)) < 0.4)
    lower = np.asarray(place * frame.cell_m, np.float64)
    some = rng.random((3, len(place))) < 0.7
    gas, absorbing, scattering = 10.0 ** rng.uniform(-2, 2, (3, len(place))) * some
    hot = np.ones((2, len(place))) if isothermal else rng.uniform(0.01, 1.0, (2, len(place)))
    source = CellSource(
        lower_m=lower,
        upper_m=np.asarray(lower + frame.cell_m, np.float64),
        vapour_absorption=gas,
        vapour_emission=hot[0] * gas,
        droplet_absorption=absorbing,
        droplet_scattering=scattering,
        droplet_emission=hot[1] * absorbing,
    )
    return OpticalCells.of(build_octree(frame, None, [source], optical_depth_split=1e-9))


def planes(cells: OpticalCells) -> NDArray[np.float64]:
    """Albedo and emission (3, P) of a medium."""
    albedo = np.zeros(len(cells.depth))
    albedo[cells.address] = cells.albedo
    return np.stack([albedo, *(cells.emitted[name] for name in cells.needs.emitters)])


def test_albedo_and_emission_are_never_below_zero() -> None:
    """At any corner, with what is taken from the middle; and no more is scattered than is taken."""
    cells = random_cells(1)
    gradients = np.stack([linear_of(cells).albedo, *linear_of(cells).emission]).astype(float)
    corners = planes(middles_of(cells))[..., None] + gradients @ CORNERS.T
    assert corners.min() > -1e-6
    assert corners[0].max() < 1 + 1e-6
    assert np.mean(np.abs(gradients).max(axis=2) > 0) > 0.1
    assert (1 + linear_of(cells).extinction.astype(float) @ CORNERS.T).min() > 0


def test_a_cell_emits_and_scatters_what_its_means_say() -> None:
    """By Gauss's rule of two points an axis, which is exact for products of linear functions."""
    cells = random_cells(2)
    points = CORNERS / 3**0.5
    extinction = 1 + linear_of(cells).extinction.astype(float) @ points.T
    np.testing.assert_allclose(extinction.mean(axis=1), 1.0, atol=1e-6)
    gradients = np.stack([linear_of(cells).albedo, *linear_of(cells).emission]).astype(float)
    values = planes(middles_of(cells))[..., None] + gradients @ points.T
    found = np.mean(extinction * values, axis=2)
    np.testing.assert_allclose(found, planes(cells), atol=2e-7)


def test_isothermal_medium_stays_so() -> None:
    """Emission and albedo change oppositely: in a cavity nothing shows."""
    linear = random_cells(3, isothermal=True)
    changes = linear_of(linear).albedo + linear.scale * linear_of(linear).emission.sum(axis=0)
    assert np.abs(linear_of(linear).albedo).max() > 0.2
    np.testing.assert_allclose(changes, 0.0, atol=1e-6)


def test_sources_of_the_image() -> None:
    """Mean over a cell, weighted by extinction, as given; none below 0 at a corner. Thick cells
    have the gradients of the medium's own emission, and of what it leaves to the gather."""
    cells = random_cells(4)
    made = RecordsTwin.of(cells, linear=True)
    rng = np.random.default_rng(5)
    count, inner = len(cells.address), cells.needs.boundaries
    light = rng.random((2, 4, count))
    light /= light[:, :inner].sum(axis=1, keepdims=True)
    thermal = cells.thermal_source()
    given = [(thermal + cells.albedo * one).astype(np.float32) for one in light]
    gradient = rng.normal(size=(3, 4, count)).astype(np.float32) * 0.1
    thick = np.arange(0, count, 7)
    sources, table = made.linear_sources(list(given), gradient, thick)
    steep = table.reshape(len(made.at), 3, 4)
    own = linear_of(cells)
    at = cells.address[thick]
    np.testing.assert_array_equal(steep[thick][:, :, 0], own.albedo[at])
    assert not steep[thick][:, :, 1:inner].any()
    emission = steep[thick][:, :, inner:].transpose(2, 0, 1)
    np.testing.assert_array_equal(emission, own.emission[:, at])
    points = CORNERS / 3**0.5
    extinction = 1 + linear_of(cells).extinction[cells.address].astype(float) @ points.T
    for source, before in zip(sources, given, strict=True):
        assert source is not None and source is not before
        change = np.einsum("pic,ki->cpk", steep[:count].astype(float), points)
        found = np.mean((source[..., None] + change) * extinction, axis=2)
        plain = np.setdiff1d(np.arange(count), thick)
        np.testing.assert_allclose(found[:, plain], before[:, plain], atol=1e-6)
    mean = np.mean([one for one in sources if one is not None], axis=0)
    corners = mean[..., None] + np.einsum("pic,ki->cpk", steep[:count].astype(float), CORNERS)
    assert corners[:, np.setdiff1d(np.arange(count), thick)].min() > -1e-6
