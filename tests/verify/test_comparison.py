"""Comparison of runs with recordings of the simulated rig: p is as often small as it should be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.comparison import difference, open_shown
from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import load_scene
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}


@pytest.fixture(scope="module")
def gdi(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The shipped scene with pixels of 1 mm, as by `cldit run gdi --quick`."""
    scene = load_scene("gdi").with_(**SENSOR, **{"transport.accuracy_K": 4.0})
    return simulate(scene, tmp_path_factory.mktemp("gdi"), device=device)


@pytest.mark.slow
def test_a_run_explains_its_own_recording(gdi: Run) -> None:
    """Of 100 seeds 5 have p below 0.05, give or take 2.2 (1 sigma); chi-square is 1.

    One chi-square scatters by 0.05, with 1700 effective pixels and variances from 5 shots each.
    """
    found = [difference(open_shown(gdi), recording(gdi, seed=n), resample=True) for n in range(100)]
    chances = np.array([one.regions["all"].p_value for one in found])
    reduced = np.array([one.regions["all"].chi2_reduced for one in found])
    assert 1 <= np.sum(chances < 0.05) <= 9
    # 1 of 100 is meant to differ; variances from 5 shots have longer tails (6 here).
    assert sum(not one.within for one in found) <= 10
    assert np.mean(reduced) == pytest.approx(1.0, abs=0.05)
    assert np.mean((reduced > 0.9) & (reduced < 1.1)) >= 0.9
    for name in ("root", "plumes", "tips", "halo"):
        inside = np.array([one.regions[name].p_value for one in found])
        assert np.sum(inside < 0.05) <= 20, name  # tails of variances from 5 shots each


@pytest.mark.slow
def test_order_1_and_warmer_fuel_differ(gdi: Run, device: Device, tmp_path: Path) -> None:
    """Against a recording of all orders, and of fuel that is 10 K colder."""
    seen = recording(gdi, seed=1)
    first = simulate(gdi.scene.with_(**{"transport.order": 1}), tmp_path / "one", device=device)
    found = difference(seen, open_shown(first), resample=True)
    assert not found.within and "root" in found.where
    assert found.tested == ("orders of scattering",)
