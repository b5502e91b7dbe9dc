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
    1, (N,). mass, surface: running sums over the classes, by rising size, of the mass that is left
    and of that mass over its diameter (1/m), at the liquid's first density, (N, classes + 1).
    """

    loss_m2: Floats
    evaporated: Floats
    mass: Floats
    surface: Floats

    def kinetic(self, age_s: ArrayLike, *, rate_m2_s: float) -> Floats:
        """Evaporated share after `age_s`, any shape, in hot gas where d^2 falls at `rate_m2_s`."""
        known, first = self.loss_m2, np.searchsorted(self.loss_m2, 0.0, side="right") - 1
        loss = np.asarray(age_s, dtype=float) * rate_m2_s
        return np.interp(loss, known[first:], self.evaporated[first:])

    def diameters_m(self, evaporated: ArrayLike, count: int) -> Floats:
        """Droplet diameters (N, count), rising, one for each of `count` equal shares of the mass
        that is left when a share `evaporated` (N,), 0..1, of it has gone.

        Each has the surface per mass of its share, as `strata_m`, so that D32 is kept.

        Args:
            evaporated: (N,), 0..1.
            count: classes.

        Returns:
            (N, count) in m.
        """
        edges = np.linspace(0.0, 1.0, count + 1)
        rows = len(self.evaporated) - 1  # the last has nothing left
        table = np.empty((rows, count))
        for row in range(rows):
            bounds = np.interp(edges * self.mass[row, -1], self.mass[row], self.surface[row])
            table[row] = self.mass[row, -1] / count / np.diff(bounds)
        state = np.searchsorted(self.evaporated, np.asarray(evaporated, dtype=float))
        return np.asarray(table[np.minimum(state, rows - 1)])


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
    # Where a class has gone nothing is added to either sum.
    over = np.divide(mass, classes_m * np.sqrt(left), out=np.zeros_like(mass), where=left > 0)
    sums = [np.pad(np.cumsum(each, axis=1), ((0, 0), (1, 0))) for each in (mass, over)]
    return D2Law(loss, 1 - total / len(squares), sums[0], sums[1])
