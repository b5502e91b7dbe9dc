"""A small OpenFOAM case of several times: a cone of parcels that goes down from (0, 11 mm, 0)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.unit.cfd.conftest import Block, write_case

NOZZLE = (0.0, 11e-3, 0.0)


def write_times(root: Path, times: dict[str, float], *, vapour: bool = True) -> Path:
    """Times, by the names of their folders, with the age of the oldest parcel, s.

    An age of 0 has neither parcels nor fuel, and one below 0 an empty cloud beside vapour.
    """
    edges = [np.linspace(*span) for span in ((-6e-3, 6e-3, 7), (0.0, 12e-3, 7), (-6e-3, 6e-3, 7))]
    block = Block((edges[0], edges[1], edges[2]))
    for name, oldest_s in times.items():
        random = np.random.default_rng(3)
        count = 200 if oldest_s > 0 else 0
        velocity = random.normal((0.0, -80.0, 0.0), 4.0, (count, 3))
        age = random.uniform(1e-6, max(oldest_s, 2e-6), count)
        cloud: dict[str, Any] = {
            "position": np.array(NOZZLE) + velocity * age[:, None],
            "U": velocity,
            "age": age,
            "d": random.uniform(2e-6, 2e-5, count),
            "nParticle": np.full(count, 1e3),
            "T": np.full(count, 370.0),
            "rho": np.full(count, 610.0),
        }
        gas: dict[str, Any] = {"T": 570.0, "p": 6e5, "rho": 3.6}
        if oldest_s != 0 and vapour:
            inside = np.linalg.norm(block.centre[:, [0, 2]], axis=1) < 3e-3
            gas["C7H16"] = np.where(inside, 0.05, 0.0)
        write_case(root, block, gas=gas, cloud=cloud if oldest_s != 0 else None, time=name)
    return root
