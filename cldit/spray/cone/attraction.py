"""Paths of the plumes of an injector, which draw each other together.

A jet takes in gas along its way, so that it is a line of sinks, and the other jets are in the flow
towards it. A sink of strength e in a flow u is subject to the force e u (Lagally's theorem): the
gas that it takes in brings the momentum of that flow, which turns and slows the jet. The head of a
growing jet displaces as much gas as the jet takes in, so each tip is a source of the same strength.
e and u are those of the jets themselves: nothing is fitted. Sinks and tips are those of the time
at which the fuel was on its way, in open gas.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cldit.arrays import Floats
from cldit.spray.cone.jet import Jet

_POINTS = 120  # of a path, at equal times of travel; 240 move `gdi-cone`'s by 0.2 mm of 3 at most


def displaced_m(
    axes: Sequence[Floats], jets: Sequence[Jet], reach_m: Sequence[float]
) -> list[tuple[Floats, Floats]]:
    """Distances (P,) along each plume's axis, and displacement (P, 3) of its fuel from there."""
    along = [_equal_steps(jet, reach) for jet, reach in zip(jets, reach_m, strict=True)]
    lines = [at[:, None] * axis for at, axis in zip(along, axes, strict=True)]
    taken = [jet.gas_kg_s(at) for jet, at in zip(jets, along, strict=True)]
    displaced = []
    for i, jet in enumerate(jets):
        flow = np.zeros((_POINTS, _POINTS, 3))  # by point and by the others' tips
        for j, line in enumerate(lines):
            if j == i:
                continue
            way = line - lines[i][:, None]
            width = jets[j].spreading * np.tan(jets[j].half_angle_rad) * along[j]
            decay = (np.sum(way * way, axis=2) + width * width) ** -1.5
            drawn = way * (decay * np.diff(taken[j], prepend=0.0))[:, :, None]
            flow += np.cumsum(drawn, axis=1) - way * (decay * taken[j])[:, :, None]
        strength = np.diff(taken[i], prepend=0.0) / jet.momentum_N
        turn = flow * (strength / (4 * np.pi * jet.gas_kg_m3))[:, None, None]
        path = np.zeros((_POINTS, 3))
        step = np.diff(along[i], prepend=0.0)[:, None]
        for point in range(_POINTS):  # fuel that is there now, and the tips while it was on its way
            passed = np.arange(point + 1)
            slope = np.cumsum(turn[passed, _POINTS - 1 - point + passed], axis=0)
            path[point] = np.sum(slope * step[passed], axis=0)
        displaced.append((along[i], path))
    return displaced


def _equal_steps(jet: Jet, reach_m: float) -> Floats:
    fine = np.linspace(0.0, reach_m, 2000)
    travel = jet.travel_s(fine)
    return np.asarray(np.interp(np.arange(1, _POINTS + 1) / _POINTS * travel[-1], travel, fine))
