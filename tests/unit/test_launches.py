"""Which stages of a sweep go together in one launch."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from cldit.transport.directions import Directions, isotropic
from cldit.transport.layout import layouts
from cldit.transport.routes import Route, _launches


def test_the_end_of_a_layer_and_the_start_of_the_next_go_together() -> None:
    """But in the middle, where directions of either sense would meet in a layer."""
    expected = [(0, 1), (1, 3), (3, 5), (5, 6), (6, 7), (7, 9), (9, 11), (11, 12)]
    assert _launches(np.ones(12, bool)).tolist() == [list(each) for each in expected]


def test_stages_without_steps_are_left_out() -> None:
    steps = np.arange(12) % 2 == 0
    assert all(steps[first:end].any() for first, end in _launches(steps))
    assert len(_launches(np.zeros(2, bool))) == 0


@pytest.mark.parametrize("shape", [(8, 16, 24), (24, 8, 8), (1, 8, 16)])
def test_launches_of_directions(shape: tuple[int, int, int]) -> None:
    """Every stage once, in order; no ray changes its row within a launch, not along diagonals from
    corner to corner of cells either; and no two senses are in one layer."""
    rng = np.random.default_rng(3)
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) / 3**0.5
    unit = np.concatenate([isotropic(40, rng).unit, corners, corners[:, [1, 2, 0]]])
    starts = rng.random((len(unit), 2))
    starts[20:] = 0.0
    directions = Directions(unit, np.full(len(unit), 1 / len(unit)))
    main = np.argmax(np.abs(unit), axis=1)
    for axis, layout in layouts(shape).items():
        layers = layout.size[2]
        number = np.flatnonzero(main == axis)
        if layers == 1:  # as `routes` has it
            number = number[unit[number, axis] < 0]
        route = Route.of(layout, number, directions, starts)
        through = [stage for first, end in route.launches for stage in range(first, end)]
        assert through == sorted(set(through))
        steps = np.diff(route.stages)
        assert steps[:, through].sum() == len(route.part) == steps.sum()
        for first, end in route.launches:
            met: list[set[int]] = []
            for sense, begins in enumerate(route.stages):
                some = [stage // 2 for stage in range(first, end) if steps[sense, stage]]
                met.append({layers - 1 - layer if sense else layer for layer in some})
                launched = slice(begins[first], begins[end])
                for ray in np.unique(route.direction[launched]):
                    its = np.flatnonzero(route.direction[launched] == ray) + launched.start
                    assert not np.any(np.abs(route.shifts[its[1:], 3]) == 1)
            assert not met[0] & met[1]
