"""How a size distribution evaporates: the d^2 law of every size class, small droplets first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.spray.cone.wet_bulb import WetBulb

Floats = NDArray[np.float64]

_STEPS = 500


@dataclass(frozen=True)
class D2Law:
    """States of the distribution, from whole to gone.

    loss_m2: K t, by which d^2 has fallen, (N,); evaporated: share of the mass, rising from 0 to
    1, (N,); diameter_m: sqrt(s) d0 for equal shares of the mass that is left, by rising size, at
    the liquid's first density, (N, classes).
    """

    loss_m2: Floats
    evaporated: Floats
    diameter_m: Floats

    def kinetic(self, age_s: ArrayLike, *, rate_m2_s: float) -> Floats:
        """Evaporated share after `age_s`, any shape, in hot gas where d^2 falls at `rate_m2_s`."""
        known, first = self.loss_m2, np.searchsorted(self.loss_m2, 0.0, side="right") - 1
        loss = np.asarray(age_s, dtype=float) * rate_m2_s
        return np.interp(loss, known[first:], self.evaporated[first:])

    def diameters_m(self, evaporated: ArrayLike, rank: ArrayLike) -> Floats:
        """Droplet diameters when a share of the mass has evaporated.

        Args:
            evaporated: (N,), 0..1.
            rank: (N, M), 0..1: share of the mass left that is in smaller droplets.

        Returns:
            (N, M).
        """
        state = np.searchsorted(self.evaporated, np.asarray(evaporated, dtype=float))
        state = np.minimum(state, len(self.evaporated) - 2)  # the last has nothing left
        place = (np.asarray(rank) * self.diameter_m.shape[1]).astype(np.int64)
        return np.asarray(self.diameter_m[state[:, None], place])


def d2_law(classes_m: Floats, bulb: WetBulb | None) -> D2Law:
    """Evaporation of droplets of `classes_m` (C,), rising, each an equal share of the mass.

    Without `bulb` nothing evaporates, and the two states are the whole and the end.
    """
    squares = classes_m**2
    if bulb is None:
        begin, loss = np.ones(2), np.array([0.0, squares[-1]])
    else:
        # Warm liquid first loses the same share of every droplet, then as the d^2 law has it.
        at_once = np.linspace(1.0, bulb.start, 40)[:-1] if bulb.start < 1 else np.empty(0)
        later = bulb.start * squares[-1] * np.linspace(0.0, 1.0, _STEPS) ** 2
        begin = np.append(at_once, np.full(_STEPS, bulb.start))
        loss = np.append(np.zeros(len(at_once)), later)
    left = np.clip(begin[:, None] - loss[:, None] / squares, 0.0, 1.0)
    mass = left**1.5
    total = mass.sum(axis=1)
    middles = (np.arange(len(squares)) + 0.5) / len(squares)
    diameter = np.empty_like(mass)
    for row in range(len(loss)):
        within = np.cumsum(mass[row])
        chosen = np.searchsorted(within, middles * within[-1]) if within[-1] > 0 else -1
        diameter[row] = classes_m[chosen] * np.sqrt(left[row, chosen])
    return D2Law(loss, 1 - total / len(squares), diameter)
