"""A parcel as a small cloud of points, so that its droplets do not all lie in one voxel."""

from __future__ import annotations

import numpy as np

from cldit.spray.result import Parcels


def spread_parcels(parcels: Parcels, *, radius_m: float, points: int, seed: int) -> Parcels:
    """Shares the droplets of every parcel evenly among places in a ball about it.

    Places come in opposite pairs (and the middle, for an odd number), so that mass, centre of mass,
    diameters and temperatures of each parcel stay as they are. Uniform in the ball; the same seed
    gives the same places.

    Args:
        parcels: to be shared.
        radius_m: of the ball.
        points: number of places.
        seed: of their draw.
    """
    count = len(parcels.diameter_m)
    random = np.random.default_rng(seed)
    way = random.normal(size=(count, points // 2, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    way *= radius_m * np.cbrt(random.uniform(size=(count, points // 2, 1)))
    middle = np.zeros((count, points % 2, 3))
    shift = np.concatenate([way, -way, middle], axis=1)
    return Parcels(
        (parcels.position_m[:, None] + shift).reshape(-1, 3),
        np.repeat(parcels.diameter_m, points),
        np.repeat(parcels.droplets / points, points),
        np.repeat(parcels.temperature_K, points),
        np.repeat(parcels.density_kg_m3, points),
    )
