"""Coefficients that are linear in cells: by definition, conserved, nothing below 0."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.limiter import limited
from cldit.medium.octree import Octree, build_octree
from cldit.transport.cells import OpticalCells
from cldit.transport.linear_coefficients import LEAST, thick_albedo

from .cell_twin import LinearCoefficients
from .medium import cells_source

CELLS = 64
FRAME = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.64, depth=6)


def tree_of(place: NDArray[np.int64], values: Floats, *, split: float = 1e-9) -> Octree:
    """Vapour of optical depth `values` (N,) in the cells `place` (N, 3; x, y, z)."""
    source = cells_source(FRAME, place, vapour_absorption=values / FRAME.cell_m)
    return build_octree(FRAME, None, [source], optical_depth_split=split)


def leaf_at(tree: Octree, place: NDArray[np.int64]) -> tuple[int, int]:
    """Address of the leaf or stored cell at a place (x, y, z), and its edge in finest cells."""
    entry = int(tree.directory[tuple(place[::-1] // 8)])
    x, y, z = place % 8
    if entry >= 0:
        return entry * 512 + (z * 8 + y) * 8 + x, 1
    return tree.slots * 512 - 1 - entry, CELLS >> int(tree.coarse_level[-1 - entry])


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


def test_by_definition(device: Device) -> None:
    """In random cells, at sides of the cube and beside coarse leaves, empty or not."""
    rng = np.random.default_rng(5)
    place = np.argwhere(rng.random((CELLS, CELLS, CELLS)) < 0.7)
    block = np.all((place >= [0, 8, 16]) & (place < [24, 40, 32]), axis=1)
    even = np.all((place >= [32, 0, 0]) & (place < 64), axis=1)
    values = np.where(block, rng.uniform(0.02, 0.5, len(place)), 1e-9)
    tree = tree_of(place[block | even], values[block | even], split=1e-6)
    cells = OpticalCells.of(tree)
    assert 0 < tree.slots < 512 and np.any(tree.coarse_level[FRAME.depth + 1 :] < 3)
    found = LinearCoefficients.of(device, cells).extinction
    checked = 0
    for place_ in place[block][::7]:
        address, _ = leaf_at(tree, place_)
        mean = float(cells.depth[address])
        slopes = np.array([slope_at(cells, place_, axis) for axis in range(3)]) / mean
        slopes /= max(np.abs(slopes).sum() / 2 / (1 - LEAST), 1.0)
        np.testing.assert_allclose(found[address], slopes, atol=2e-6)
        checked += int(np.count_nonzero(slopes))
    assert checked > 300


def test_never_below_zero(device: Device) -> None:
    """At no corner of any cell, whatever the neighbours; and in empty cells it is 0."""
    rng = np.random.default_rng(6)
    place = np.argwhere(rng.random((CELLS, CELLS, CELLS)) < 0.02)
    cells = OpticalCells.of(tree_of(place, 10.0 ** rng.uniform(-8, 2, len(place))))
    gradient = LinearCoefficients.of(device, cells).extinction
    corner = 1 - np.abs(gradient).sum(axis=1) / 2
    assert corner.min() > 0.9 * LEAST  # rounding of three numbers
    assert corner.min() < 0.1  # it was needed
    assert not gradient[cells.depth == 0].any()


def test_linear_fields_are_exact(device: Device) -> None:
    """In stored cells within, whatever the direction: of the extinction of vapour, and of albedo
    and emission where the extinction of droplets is even."""
    place = np.argwhere(np.ones((16, 16, 16), bool)) + 24
    rise = np.array([0.003, -0.007, 0.002])
    share = 0.5 + (place - 32) @ rise
    even = cells_source(
        FRAME,
        place,
        droplet_absorption=(1 - share) / FRAME.cell_m,
        droplet_scattering=share / FRAME.cell_m,
        droplet_emission=2 * share / FRAME.cell_m,
    )
    droplets = build_octree(FRAME, None, [even], optical_depth_split=1e-9)
    inner = place[np.all((place > 24) & (place < 39), axis=1)]
    for tree in (tree_of(place, share), droplets):
        cells = OpticalCells.of(tree)
        linear = LinearCoefficients.of(device, cells)
        address = [leaf_at(tree, one)[0] for one in inner]
        steep: list[NDArray[np.floating]]
        steep = [linear.extinction[address] * cells.depth[address, None]]
        if tree is droplets:
            assert np.abs(steep).max() < 1e-6
            steep = [linear.albedo[address], cells.scale / 2 * linear.emission[0, address]]
        for gradient in steep:
            expected = np.broadcast_to(rise, gradient.shape)
            np.testing.assert_allclose(gradient, expected, atol=4e-7)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coarse_leaves_of_a_linear_field(device: Device, axis: int) -> None:
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
    found = LinearCoefficients.of(device, cells).extinction[address] * cells.depth[address]
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
    some = rng.random((3, len(place))) < 0.7
    gas, absorbing, scattering = 10.0 ** rng.uniform(-2, 2, (3, len(place))) * some
    hot = np.ones((2, len(place))) if isothermal else rng.uniform(0.01, 1.0, (2, len(place)))
    source = cells_source(
        frame,
        place,
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


def middles(linear: LinearCoefficients) -> NDArray[np.float64]:
    """The same in the middles of cells."""
    return np.stack([linear.middle_albedo, *linear.middle_emission])


def test_albedo_and_emission_are_never_below_zero(device: Device) -> None:
    """At any corner, with what is taken from the middle; and no more is scattered than is taken."""
    cells = random_cells(1)
    linear = LinearCoefficients.of(device, cells)
    gradients = np.stack([linear.albedo, *linear.emission])
    corners = middles(linear)[..., None] + gradients @ CORNERS.T
    assert corners.min() > -1e-6
    assert corners[0].max() < 1 + 1e-6
    assert np.mean(np.abs(gradients).max(axis=2) > 0) > 0.1
    assert (1 + linear.extinction @ CORNERS.T).min() > 0
    assert np.abs(middles(linear) - planes(cells)).max() > 0.01


def test_a_cell_emits_and_scatters_what_its_means_say(device: Device) -> None:
    """By Gauss's rule of two points an axis, which is exact for products of linear functions."""
    cells = random_cells(2)
    points = CORNERS / 3**0.5
    linear = LinearCoefficients.of(device, cells)
    extinction = 1 + linear.extinction @ points.T
    np.testing.assert_allclose(extinction.mean(axis=1), 1.0, atol=1e-6)
    gradients = np.stack([linear.albedo, *linear.emission])
    values = middles(linear)[..., None] + gradients @ points.T
    found = np.mean(extinction * values, axis=2)
    np.testing.assert_allclose(found, planes(cells), atol=2e-7)


def test_isothermal_medium_stays_so(device: Device) -> None:
    """Emission and albedo change oppositely: in a cavity nothing shows."""
    cells = random_cells(3, isothermal=True)
    linear = LinearCoefficients.of(device, cells)
    changes = linear.albedo + cells.scale * linear.emission.sum(axis=0)
    assert np.abs(linear.albedo).max() > 0.2
    np.testing.assert_allclose(changes, 0.0, atol=1e-6)


def test_albedos_of_some_cells(device: Device) -> None:
    """Listed cells have that of their middles, all others 0."""
    cells = random_cells(4)
    thick = np.arange(0, len(cells.address), 3)
    some = thick_albedo(device, cells, thick, np.float32, linear=True)
    found = download(device, some, np.empty(len(cells.depth), np.float32))
    address = cells.address[thick]
    albedo = LinearCoefficients.of(device, cells, np.float32).middle_albedo
    np.testing.assert_array_equal(found[address], albedo[address])
    assert np.count_nonzero(found) == np.count_nonzero(albedo[address])
