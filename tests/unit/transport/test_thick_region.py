"""The region around thick cells, and the order in which sweeps go through a box."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from cldit.medium.frame import Cube
from cldit.medium.octree import build_octree
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.axis_order import axis_orders
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.discrete_ordinates.segments import Segments
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule, kba_tiles
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning
from tests.kernels.medium import cells_source


def scattered_cells(seed: int) -> OpticalCells:
    """Cells of optical depth 0 to 1 here and there in a cube of 32, at its sides too."""
    rng = np.random.default_rng(seed)
    frame = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.32, depth=5)
    place = np.argwhere(rng.random((32, 32, 32)) < 0.02)
    half = rng.uniform(0.0, 0.5, len(place)) / frame.cell_m
    source = cells_source(
        frame, place, droplet_absorption=half, droplet_scattering=half, droplet_emission=half
    )
    return OpticalCells.of(build_octree(frame, None, [source], optical_depth_split=1e-5))


def test_faces_of_the_region() -> None:
    """It holds the thick cells and what shares a face with them. Every face to another cell of the
    box has a number, and those that one direction goes through have different ones."""
    cells = scattered_cells(3)
    box = cells.box()
    thick = ThickRegion.of(cells, box, deeper_than=0.6, tuning=Tuning())
    assert thick is not None
    at = {tuple(place) for place in cells.positions(cells.address[thick.listed]) - box.low}
    beside = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    inside = {
        tuple(near)
        for place in at
        for near in (np.array(place), *(np.array(place) + beside))
        if np.all(near >= 0) and np.all(near < box.shape)
    }
    assert {tuple(place) for place in thick.at} == inside
    for place, faces in zip(thick.at, thick.faces, strict=True):
        for side, number in enumerate(faces):
            step = np.zeros(3, int)
            step[side // 2] = 2 * (side % 2) - 1
            near = place + step
            there = np.all(near >= 0) and np.all(near < box.shape)
            assert (number >= 0) == (there and tuple(near) not in inside)
    number_of = {tuple(place): number for number, place in enumerate(thick.at)}
    for place, faces, next_ in zip(thick.at, thick.faces, thick.beside, strict=True):
        for side in range(6):  # the next cell; else a face; else the side of the box
            near = place.copy()
            near[side // 2] += 2 * (side % 2) - 1
            face = -2 - faces[side] if faces[side] >= 0 else -1
            assert next_[side] == number_of.get(tuple(near), face)
    for signs in np.ndindex(2, 2, 2):
        met = thick.faces[:, [2 * axis + up for axis, up in enumerate(signs)]]
        met = met[met >= 0]
        assert len(np.unique(met)) == len(met)
        assert met.max() < thick.interfaces
    assert thick.faces.max() == thick.interfaces - 1
    stored = thick.address >= 0
    np.testing.assert_array_equal(
        cells.positions(thick.address[stored]) - box.low, thick.at[stored]
    )


def test_no_thick_cell() -> None:
    cells = scattered_cells(3)
    assert ThickRegion.of(cells, cells.box(), deeper_than=2.0, tuning=Tuning()) is None


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.37, -0.81), (-1.0, 1.0), (1e-9, 0.5)])
def test_where_rays_leave_cells(slopes: tuple[float, float], backwards: bool) -> None:
    """The last segment of a layer leaves along l, and along u and v at least one does: where rays
    enter the next cell, if they do."""
    start = np.array([[0.21, 0.64]])
    rays = Segments.of(np.array([slopes]), start, layers=40, backwards=np.array([backwards]))
    last = np.diff(rays.layer, append=-9) != 0
    np.testing.assert_array_equal(rays.exits[:, 2], last)
    for moved, leaves in zip(rays.shift.T, rays.exits.T[:2], strict=True):
        goes = np.diff(moved, append=moved[-1]) != 0
        np.testing.assert_array_equal(leaves[~last], goes[~last])
        assert np.all(
            np.bincount(rays.layer, leaves) == np.maximum(np.bincount(rays.layer, goes & ~last), 1)
        )


QUADRANTS = np.array([[0, 3], [3, 4], [4, 4], [4, 9]])


@pytest.mark.parametrize("rows, layers", [(1, 1), (1, 9), (7, 2), (16, 16), (13, 40)])
@pytest.mark.parametrize("edge", [1, 4, 100])
def test_tiles(rows: int, layers: int, edge: int) -> None:
    """Along each direction every cell once, after those that light comes from: the rows before it
    in its own layer, and its own row and that before in the layer before, whichever the tile goes
    through first: in the same tile or an earlier launch. No cell twice in a launch."""
    table, launches = kba_tiles(rows, layers, QUADRANTS, edge)
    assert table.min(initial=1) >= -1 and table[:, [1, 3]].max() <= edge
    np.testing.assert_array_equal(launches[:, 0], [0, *launches[:-1, 1]])
    assert launches[-1, 1] == len(table) and np.all(np.diff(launches) > 0)
    when, tile = np.full((2, 9, layers, rows), -1)
    for launch, (first, end) in enumerate(launches):
        touched = np.zeros((layers, rows), int)
        for number in range(first, end):
            row, count, met, deep, one, last, sense, step = table[number]
            v = row + step * np.arange(count)
            layer = np.arange(met, met + deep)
            layer = layers - 1 - layer if sense else layer
            touched[np.ix_(layer, v)] += 1
            assert np.all(when[one:last][:, layer][:, :, v] == -1)
            when[np.ix_(np.arange(one, last), layer, v)] = launch
            tile[np.ix_(np.arange(one, last), layer, v)] = number
        assert touched.max() == 1
    assert when.min() >= 0
    for number, (first, end) in enumerate(QUADRANTS):
        way = np.s_[first:end, :: -1 if number >= 2 else 1, :: -1 if number % 2 else 1]
        for earlier, later in (
            (np.s_[:, :, :-1], np.s_[:, :, 1:]),
            (np.s_[:, :-1], np.s_[:, 1:]),
            (np.s_[:, :-1, :-1], np.s_[:, 1:, 1:]),
        ):
            before = when[way][earlier] < when[way][later]
            assert np.all(before | (tile[way][earlier] == tile[way][later]))


@pytest.mark.parametrize("shape", [(8, 16, 24), (24, 8, 8), (1, 8, 16)])
def test_steps_of_directions(shape: tuple[int, int, int]) -> None:
    """Each direction's steps are those of its way, in its quadrant: rays go from row to row once a
    layer at most, along diagonals from corner to corner of cells too, and the way that their tiles
    go, so that those that come into a row have crossed the one before."""
    rng = np.random.default_rng(3)
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) / 3**0.5
    unit = np.concatenate([isotropic(40, rng).unit, corners, corners[:, [1, 2, 0]]])
    starts = rng.random((len(unit), 2))
    starts[20:] = 0.0
    directions = Ordinates(unit, np.full(len(unit), 1 / len(unit)))
    main = np.argmax(np.abs(unit), axis=1)
    for axis, layout in axis_orders(shape).items():
        numbers = np.flatnonzero(main == axis)
        schedule = SweepSchedule.of(layout, numbers, directions, starts, edge=4)
        ordinate, begins = schedule.tables["origins"][:, 2], schedule.tables["begins_at"]
        assert sorted(ordinate) == list(numbers)
        for first, end, sense, step in np.unique(schedule.tables["tiles"][:, 4:], axis=0):
            for k in range(first, end):
                run = -unit[ordinate[k]][list(layout.axes)]
                assert (run[2] < 0) == sense and run[1] * step >= 0
                segments = Segments.of(
                    run[None, :2] / abs(run[2]),
                    starts[ordinate[k], None],
                    layers=layout.size[2],
                    backwards=np.array([bool(sense)]),
                )
                its = slice(begins[k, 0], begins[k, -1])
                np.testing.assert_array_equal(schedule.tables["shifts"][its], segments.shifts())
                for met, (one, other) in enumerate(pairwise(begins[k] - its.start)):
                    assert one < other and np.all(segments.layer[one:other] == met)
                    moved = segments.shifts()[one:other, 3]
                    assert np.all(np.isin(moved, (0, step, 2))) and np.sum(moved == step) <= 1
