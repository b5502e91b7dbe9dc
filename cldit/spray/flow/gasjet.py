"""Gas velocity inside a plume near its hole, where the grid is too coarse for it.

A steady gas jet of the same momentum (J. Abraham, SAE 970051; N. Abani and R. D. Reitz, Phys.
Fluids 19, 125102 (2007)): with d_eq = d sqrt(rho_l/rho_g) and K = 0.457, on the axis the gas moves
with U min(1, 3 d_eq/(K x)), off the axis with that over (1 + 12 r^2/(K x)^2)^2. Droplets feel this
instead of the grid's slower gas.

Where the jet is narrower than a cell, so that neighbouring plumes share cells, the grid would turn
their momenta into one jet along the injector's axis. There the jet that the grid does not see
carries along its own axis what droplets give it, momentum, vapour and heat, and hands that over
where it is as wide as a cell; and the gas there is what the droplets see.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ENTRAINMENT = 0.457  # K
HALF_WIDTH = 0.085  # of the distance: where the profile has fallen to one half
HANDED_OVER_CELLS = 0.5  # half width, in cells, at which the grid takes over
RESOLVED_CELLS = 1.5  # a jet whose half width is as many cells is left to the grid


def jet_speed_m_s(
    along_m: Floats,
    radius_m: Floats,
    *,
    speed_m_s: Floats,
    diameter_m: Floats,
    density_ratio: float,
    time_s: float,
    end_s: float,
    spacing_m: float,
) -> tuple[Floats, Floats]:
    """Speed of the gas along the axis (N,), and how much of it counts, 0..1 (N,).

    It counts once the jet's head has passed, which takes twice as long as fluid on the axis of the
    steady jet (gradually, from 1.5 to 2.5 times); ends when the last fluid has passed; and fades
    out in the last third before the distance at which the grid resolves the jet.

    Args:
        along_m, radius_m: from the hole, and from the axis. speed_m_s, diameter_m: at the hole.
        density_ratio: of liquid to gas. time_s, end_s: now, and the injection's end, since start.
    """
    core = 3 * diameter_m * np.sqrt(density_ratio) / ENTRAINMENT
    x = np.maximum(along_m, 1e-9)
    axis = speed_m_s * np.minimum(1.0, core / x)
    speed = axis / (1 + 12 * (radius_m / (ENTRAINMENT * x)) ** 2) ** 2
    beyond = np.maximum(x - core, 0.0)
    travel = np.minimum(x, core) / speed_m_s + beyond * (1 + beyond / (2 * core)) / speed_m_s
    weight = np.clip(time_s / travel - 1.5, 0.0, 1.0) * (time_s - end_s < travel)
    reach = RESOLVED_CELLS * spacing_m / HALF_WIDTH
    weight = weight * np.clip(3 * (1 - along_m / reach), 0.0, 1.0) * (along_m > 0)
    return speed, weight
