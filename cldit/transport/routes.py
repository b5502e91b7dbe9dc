"""Sets of directions as sweeps go along them: layer by layer, many directions together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cldit.transport.cells import Box
from cldit.transport.directions import Directions
from cldit.transport.layout import Layout, layouts
from cldit.transport.way import Way

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Route:
    """K directions whose layers lie alike; N steps of all of them, in the order of stages.

    A stage crosses, along every direction, the part of one layer before (even stages) or after (odd
    ones) rays go from row to row; half of the directions (sense 1) meet the last layer first.

    number (K,): of each direction in its set. stages (2, 2 layers + 1): where the steps of a
    sense's stages begin, and the end. launches (M, 2): the first of the stages that can be gone
    through at once, and the end. direction (N,): 0 to K - 1. shifts (N, 4): as in `Way`.
    part (N,): share of the layer that is crossed; middle (N, 3): of the step in the cells, 0 to 1.
    lever (N, 3), gain (K, 3): as in `Way`, along x, y, z.
    faces (N,): through which rays leave cells after the step, bits of the sides on which light
    comes from there: down and up along u, v, l.
    back (K, 3): where light comes from. stretch (K,): path in a layer / cell edge. weight (K,).
    rightwards (K,): rays move to larger u.
    """

    layout: Layout
    number: NDArray[np.int32]
    stages: NDArray[np.int32]
    launches: NDArray[np.int32]
    direction: NDArray[np.int32]
    shifts: NDArray[np.int32]
    part: Floats
    middle: Floats
    lever: Floats
    gain: Floats
    faces: NDArray[np.int32]
    back: Floats
    stretch: Floats
    weight: Floats
    rightwards: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.number)

    @classmethod
    def of(
        cls, layout: Layout, number: NDArray[np.int64], directions: Directions, starts: Floats
    ) -> Route:
        back = directions.unit[number]
        runs = -back[:, layout.axes]  # light runs away from where it comes from
        stretch = 1 / np.abs(runs[:, 2])
        sense = (runs[:, 2] < 0).astype(int)
        _, nv, nl = layout.size
        inverse = np.argsort(layout.axes)
        ways, stage, faces = [], [], []
        for i, k in enumerate(number):
            u, v = runs[i, :2] * stretch[i]
            way = Way.of(u, v, starts[k], layers=nl, backwards=bool(sense[i]))
            ways.append(way)
            met = nl - 1 - way.layer if sense[i] else way.layer
            opens = np.flatnonzero(np.diff(met, prepend=-1))  # a layer's first steps
            later = way.moved_v != np.repeat(way.moved_v[opens], np.bincount(met, minlength=nl))
            stage.append((sense[i] * nl + met) * 2 + later)
            side = 2 * np.arange(3) + (runs[i] < 0)
            faces.append((way.leaves << side[:, None]).sum(axis=0))
        stages = np.concatenate(stage)
        order = np.argsort(stages, kind="stable")
        begins = np.searchsorted(stages[order], np.arange(4 * nl + 1))
        begins = np.stack([begins[: 2 * nl + 1], begins[2 * nl :]])
        shifts = np.concatenate([way.shifts(nv) for way in ways])
        return cls(
            layout=layout,
            number=number.astype(np.int32),
            stages=begins.astype(np.int32),
            launches=_launches(np.any(np.diff(begins) > 0, axis=0)),
            direction=np.repeat(
                np.arange(len(number), dtype=np.int32), [len(way.part) for way in ways]
            )[order],
            shifts=shifts[order],
            part=np.concatenate([way.part for way in ways])[order],
            middle=np.concatenate([way.within for way in ways], axis=1).T[order][:, inverse],
            lever=np.concatenate([way.lever for way in ways], axis=1).T[order][:, inverse],
            gain=np.stack([way.gain for way in ways])[:, inverse],
            faces=np.concatenate(faces)[order].astype(np.int32),
            back=back,
            stretch=stretch,
            weight=directions.weight[number],
            rightwards=runs[:, 0] > 0,
        )


def _launches(steps: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(M, 2), see `Route`; steps (2 layers,): which of the stages have any.

    The stage after rays go from row to row, in a layer, and that before they do, in the next, go
    together: on a way as long as a layer no ray does so twice. Not where both senses would meet in
    a layer.
    """
    layers = len(steps) // 2
    out = []
    for layer in range(layers + 1):
        first, end = max(2 * layer - 1, 0), min(2 * layer + 1, 2 * layers)
        meet = end - first == 2 and abs(2 * layer - layers) <= 1
        cuts = (first, first + 1, end) if meet else (first, end)
        out += [each for each in pairwise(cuts) if steps[slice(*each)].any()]
    return np.array(out, np.int32).reshape(-1, 2)


def routes(box: Box, directions: Directions, starts: Floats, *, together: int) -> Iterator[Route]:
    """All directions, at most so many together.

    starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer.
    """
    main = np.argmax(np.abs(directions.unit), axis=1)
    for axis, layout in layouts(box.shape).items():
        number = np.flatnonzero(main == axis)
        # Those of either sense go through different layers at any time, unless there is but one.
        upwards = directions.unit[number, axis] < 0
        sets = [number] if layout.size[2] > 1 else [number[upwards], number[~upwards]]
        for some in sets:
            for first in range(0, len(some), together):
                yield Route.of(layout, some[first : first + together], directions, starts)
