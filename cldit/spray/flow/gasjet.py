"""Gas jets of the plumes near the holes, where they are narrower than the cells of the grid.

Each plume has an unresolved gas jet along the axis of its hole, with the profile and width of a
free turbulent jet (J. Abraham, SAE 970051; N. Abani and R. D. Reitz, Phys. Fluids 19, 125102
(2007)): u = U / (1 + a r^2)^2, a = 12/(K x)^2, K = 0.457. In these models the jet has the momentum
of the liquid from the hole on; here it has the momentum received from the droplets. With m the
momentum per length,

    dm/dt + dJ/dx = force of the droplets per length,
    J = a m^2 / (3 pi rho),   U = a m / (pi rho),

so that jet and droplets together have the momentum of the liquid, and start, head and end of the
injection need no further model. Droplets are exposed to the jet instead of the slower gas of the
grid.

Where the jet is narrower than a cell, so that neighbouring plumes share cells, the grid would merge
their momenta into one jet along the injector's axis. There the jet transports momentum, vapour and
heat of the droplets along its own axis and merges with the grid where it is as wide as a cell; the
gas at that place surrounds the droplets.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ENTRAINMENT = 0.457  # K
HALF_WIDTH = 0.085  # of the profile, over the distance
HANDED_OVER_CELLS = 0.5  # half width, in cells, at which the jet merges with the grid
RESOLVED_CELLS = 1.5  # half width, in cells, from which the grid resolves the jet
_BIN_M = 0.5e-3


class Jets:
    """Jets of the holes, up to where the grid resolves them.

    `holes` is their number, `speed_m_s` that of the liquid at the hole, `density_kg_m3` that of the
    surrounding gas, and `spacing_m` that of the grid.
    """

    def __init__(
        self, holes: int, *, speed_m_s: float, density_kg_m3: float, spacing_m: float
    ) -> None:
        self.reach_m = RESOLVED_CELLS * spacing_m / HALF_WIDTH
        count = math.ceil(self.reach_m / _BIN_M)
        self._edges = _BIN_M * np.arange(1, count + 1)  # far ends
        self._fastest = speed_m_s
        self._per = 12 / (ENTRAINMENT * self._edges) ** 2 / (np.pi * density_kg_m3)
        self._line = np.zeros((holes, count))

    def speed_m_s(self, hole: Ints, along_m: Floats, radius_m: Floats) -> Floats:
        """Speed (N,) of the gas in jets, at distances along the axis and from it (N,)."""
        axis = np.minimum(self._per * self._line, self._fastest)
        place = along_m / _BIN_M - 1.0  # values belong to the far ends of bins
        low = np.clip(np.floor(place).astype(np.int64), 0, axis.shape[1] - 2)
        part = np.clip(place - low, 0.0, 1.0)
        centre = (1 - part) * axis[hole, low] + part * axis[hole, low + 1]
        x = np.maximum(along_m, 1e-9)
        profile = (1 + 12 * (radius_m / (ENTRAINMENT * x)) ** 2) ** 2
        return np.where(along_m > 0, centre / profile, 0.0)

    def weight(self, along_m: Floats) -> Floats:
        """Weight of a jet at a distance (N,); it decreases to 0 in the last third of `reach_m`."""
        fading = np.clip(3 * (1 - along_m / self.reach_m), 0.0, 1.0)
        return np.asarray(fading * (along_m > 0))

    def push(self, hole: Ints, along_m: Floats, momentum: Floats, step_s: float) -> None:
        """Advances the jets by a step, with the momentum (N,) [kg m/s] of droplets along the axes.

        `hole` (N,) is the number of the jet, and `along_m` (N,) the distance along its axis.
        """
        inside = (along_m > 0) & (along_m < self._edges[-1])
        count = self._line.shape[1]
        place = hole[inside] * count + (along_m[inside] / _BIN_M).astype(np.int64)
        given = np.bincount(place, momentum[inside], self._line.size).reshape(self._line.shape)
        steps = math.ceil(2 / 3 * self._fastest * step_s / (0.5 * _BIN_M))
        for _ in range(steps):
            m = np.maximum(self._line + given / (steps * _BIN_M), 0.0)
            passing = m * np.minimum(self._per * m, self._fastest) / 3
            passing = passing * (step_s / steps / _BIN_M)
            m = m - passing
            m[:, 1:] += passing[:, :-1]
            self._line = m
