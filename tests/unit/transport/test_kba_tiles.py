"""The order in which sweeps go through a box."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from cldit.transport.discrete_ordinates.axis_order import axis_orders
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.discrete_ordinates.segments import Segments
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule, kba_tiles

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
        assert sorted(schedule.number) == list(numbers)
        for first, end, sense, step in np.unique(schedule.tiles[:, 4:], axis=0):
            for k in range(first, end):
                run = -unit[schedule.number[k]][list(layout.axes)]
                assert (run[2] < 0) == sense and run[1] * step >= 0
                segments = Segments.of(
                    run[None, :2] / abs(run[2]),
                    starts[schedule.number[k], None],
                    layers=layout.size[2],
                    backwards=np.array([bool(sense)]),
                )
                its = slice(schedule.begins[k, 0], schedule.begins[k, -1])
                np.testing.assert_array_equal(schedule.shifts[its], segments.shifts())
                for met, (one, other) in enumerate(pairwise(schedule.begins[k] - its.start)):
                    assert one < other and np.all(segments.layer[one:other] == met)
                    moved = segments.shifts()[one:other, 3]
                    assert np.all(np.isin(moved, (0, step, 2))) and np.sum(moved == step) <= 1
