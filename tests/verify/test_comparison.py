"""Comparison of runs with recordings of the simulated rig: p is as often small as it should be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.comparison import difference, open_shown
from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import load_scene
from tests.small_scenes import WHOLE_KEYS
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128], **WHOLE_KEYS}


@pytest.fixture(scope="module")
def gdi(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The shipped scene with pixels of 1 mm, as by `cldit run gdi --quick`."""
    scene = load_scene("gdi-cone").with_(**SENSOR, **{"transport.accuracy_K": 4.0})
    return simulate(scene, tmp_path_factory.mktemp("gdi"), device=device)


@pytest.fixture(scope="module")
def fine(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The same at 1 K: the error of cells for 2 K explains 10 K in the fuel."""
    pixels = {"camera.sensor.pixels": [100, 100], "camera.pixels": [100, 100], **WHOLE_KEYS}
    scene = load_scene("gdi-cone").with_(**pixels, **{"transport.accuracy_K": 1.0})
    return simulate(scene, tmp_path_factory.mktemp("fine"), device=device)


@pytest.mark.slow
def test_a_run_explains_its_own_recording(gdi: Run) -> None:
    """Of 100 seeds 5 have p below 0.05, give or take 2.2 (1 sigma); chi-square is 1.

    One chi-square scatters by 0.05, with 1700 effective pixels and variances from 5 shots each.
    """
    found = [difference(open_shown(gdi), recording(gdi, seed=n)) for n in range(100)]
    chances = np.array([one.regions["all"].p_value for one in found])
    reduced = np.array([one.regions["all"].chi2_reduced for one in found])
    assert 1 <= np.sum(chances < 0.05) <= 9
    assert sum(not one.within for one in found) <= 5  # 1 of 100 is meant to differ
    assert np.mean(reduced) == pytest.approx(1.0, abs=0.05)
    assert np.mean((reduced > 0.9) & (reduced < 1.1)) >= 0.9
    for name in ("root", "plumes", "tips", "halo"):
        inside = np.array([one.regions[name].p_value for one in found])
        assert np.sum(inside < 0.05) <= 12, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"transport.order": 1}, {"plumes"}),
        ({"spray.fuel_temperature_K": 380.0}, {"plumes", "tips"}),
    ],
    ids=["order 1", "fuel + 10 K"],
)
def test_another_model_is_named(
    fine: Run, device: Device, tmp_path: Path, values: dict[str, Any], parts: set[str]
) -> None:
    """In the parts of the spray where it changes T_app most, with 5 shots per background."""
    model = simulate(fine.scene.with_(**values), tmp_path / "one", device=device)
    found = difference(recording(fine, seed=1), open_shown(model))
    assert not found.within and parts <= set(found.where)
    assert found.tested == (("orders of scattering",) if "transport.order" in values else ())


@pytest.mark.slow
def test_exposure_missing_in_the_model_is_named_if_long(
    fine: Run, device: Device, tmp_path: Path
) -> None:
    """100 us change T_app by 1.9 K, more than its error; 25 us by 0.1 K, less."""
    values = {"camera.exposure": "times", "camera.sensor.integration_time_s": 100e-6}
    exposed = simulate(fine.scene.with_(**values), tmp_path / "one", device=device)
    found = difference(recording(exposed, seed=1), open_shown(fine))
    assert not found.within and "tips" in found.where
