"""How far another seed moves T_app of a computed spray."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.spray.flow.simulate import simulate_spray

pytestmark = pytest.mark.slow


def test_seeds_of_gdi_flow_differ_by_3_kelvin_at_most(tmp_path: Path) -> None:
    """RMS over the pixels of emissivity above 0.05, cells of 0.39 mm: 2.4 to 2.7 K were measured,
    of it some 2 K by the gas; with the paper's 1e4 droplets a parcel it is 6 K."""
    data = cldit.load_scene("gdi-flow").model_dump(mode="json")
    data["camera"]["pixels"] = [150, 150]
    data["domain"]["leaf_edge_m"] = 0.5e-3
    data["transport"] |= {"accuracy_K": 0.3, "audit": False}
    pictures = []
    for seed in (1, 2, 3):
        data["spray"]["seed"] = seed
        scene = cldit.parse_scene(data)
        spray, _, _ = simulate_spray(scene.spray, cache=tmp_path)  # type: ignore[arg-type]
        maps = cldit.simulate(scene, spray=spray, cache=tmp_path).maps
        kelvin = np.asarray(maps.apparent_temperature_K, float)
        pictures.append(np.where(np.asarray(maps.emissivity) > 0.05, kelvin, np.nan))
    apart = [np.sqrt(np.nanmean((one - other) ** 2)) for one, other in combinations(pictures, 2)]
    assert max(apart) < 3.0
