"""What a run states of the cells of a computed gas, against the spray on cells half as large."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.accuracy.sources.gas_grid import ORDER
from cldit.prepare.spray_factory import make_spray
from cldit.scene import Scene

pytestmark = pytest.mark.long

SEEDS = (1, 2, 3)
H = 1e-3


def plume(seed: int, spacing_m: float, *, audit: bool) -> Scene:
    """One plume of gdi-flow, straight down, at 0.4 ms."""
    data: dict[str, Any] = cldit.load_scene("gdi-flow").model_dump(mode="json")
    data["spray"] |= {
        "plumes": [{"inclination_deg": 0.0, "azimuth_deg": 0.0}],
        "injected_mass_kg": 1.25e-6,
        "time_s": 0.4e-3,
        "seed": seed,
    }
    data["spray"]["box"]["spacing_m"] = spacing_m
    data["camera"] |= {"pixels": [60, 60], "field_m": [0.03, 0.045]}
    data["domain"] = {"edge_m": 0.096, "centre_m": [0.0, 0.0, -0.04], "leaf_edge_m": 0.5e-3}
    data["transport"] |= {"accuracy_K": 1.0, "audit": audit}
    data["optics"]["compare_paper"] = False
    return cldit.parse_scene(data)


def apart_K2(one: Any, other: Any) -> float:
    return float(np.nanmean((one - other) ** 2))


def test_stated_gas_grid_is_within_twice_the_truth(tmp_path: Path) -> None:
    """By first order the error at h is C h, and the step from h to h / 2 is C h / 2: the truth is
    twice that step. It is taken between means over three seeds, and a third of what seeds of
    either differ by, which is chance, off its square.

    `stated` is what each seed says from its own step from 2 h to h, a lower bound unless the step
    from 4 h shows an order. With an error of order p, the step over this truth is (2^p - 1) /
    (2 - 2^(1 - p)) = 2^(p - 1): orders of 0 to 2 make it 0.5 to 2. Measured were 1.34 to 1.40.
    """

    def picture(seed: int, spacing_m: float) -> Any:
        scene = plume(seed, spacing_m, audit=False)
        maps = cldit.simulate(scene, cache=tmp_path).maps
        return np.where(maps.has_temperature, maps.apparent_temperature_K, np.nan)

    pictures = {h: [picture(seed, h) for seed in SEEDS] for h in (H, H / 2)}
    chance_K2 = sum(
        np.mean([apart_K2(a, b) / 2 for a, b in combinations(each, 2)])
        for each in pictures.values()
    )
    one, other = (np.mean(each, axis=0) for each in pictures.values())
    true_K = 2 * float(apart_K2(one, other) - chance_K2 / len(SEEDS)) ** 0.5
    stated = []
    for seed in SEEDS:
        run = cldit.simulate(plume(seed, H, audit=True), cache=tmp_path)
        assert run.errors is not None
        stages = [one.name for one in run.info.stages]
        assert "spray on cells of gas twice as large" in stages
        assert "spray on cells of gas four times as large" in stages
        (cause,) = (one for one in run.errors.causes if one.name == "gas grid")
        assert cause.error_K is not None
        assert ("correlation" in cause.how) == (ORDER not in run.errors.unknown)
        assert set(run.errors.unknown) <= {ORDER, "gas of few parcels"}  # a plume has an eighth
        stated.append(cause.error_K)
        assert run.errors.total_K is not None and run.errors.total_K >= cause.error_K
    assert all(0.5 < each / true_K < 2.0 for each in stated), (stated, true_K)


def test_the_further_sprays_are_kept(tmp_path: Path) -> None:
    """A second run, and a run on the larger cells, take both from the cache."""
    cldit.simulate(plume(1, H, audit=True), cache=tmp_path)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "sprays").glob("*.npz")}
    assert len(kept) == 3
    make_spray(plume(1, 2 * H, audit=False).spray, cache=tmp_path)
    cldit.simulate(plume(1, H, audit=True), cache=tmp_path)
    again = {path: path.stat().st_mtime_ns for path in (tmp_path / "sprays").glob("*.npz")}
    assert again == kept
