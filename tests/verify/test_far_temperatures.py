"""Media far hotter or colder than the backgrounds, and backgrounds that hardly differ.

A simulated run has no noise: that of the camera gives standard errors, and hides no T_app.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.run import Run

EDGE_M = 0.1
SCENE: dict[str, Any] = {
    "size_m": (EDGE_M,) * 3,
    "domain": {"edge_m": 0.2, "leaf_edge_m": 0.026},
    "camera": {"model": "orthographic", "pixels": [4, 4], "field_m": [0.05, 0.05]},
    "background": {"radius_m": 0.09, "temperatures_K": [350.0, 450.0]},
    "walls": {"temperature_K": 300.0},
}


def medium(temperature_K: float, depth: float, albedo: float = 0.0) -> dict[str, float]:
    return {
        "droplet_absorption_per_m": (1 - albedo) * depth / EDGE_M,
        "droplet_scattering_per_m": albedo * depth / EDGE_M,
        "droplet_temperature_K": temperature_K,
    }


@pytest.mark.parametrize("depth", [2.0, 30.0])
@pytest.mark.parametrize("temperature_K", [120.0, 1200.0, 5000.0])
def test_temperature_of_a_uniform_absorber(
    run_block: Callable[..., Run], temperature_K: float, depth: float
) -> None:
    """It is that of the medium, to the single precision of weights and maps."""
    run = run_block(medium(temperature_K, depth), **SCENE)
    assert run.maps.has_temperature.all()
    found = run.maps.apparent_temperature_K.astype(float)
    np.testing.assert_allclose(found, temperature_K, rtol=3e-6)


@pytest.mark.parametrize("depth", [2.0, 30.0])
@pytest.mark.parametrize("temperature_K", [1.0, 25.0, 40.0])
def test_no_light_has_no_temperature(
    run_block: Callable[..., Run], temperature_K: float, depth: float
) -> None:
    """At 40 K a black body has 1e-37 of the background's light: a fit has 16 digits."""
    run = run_block(medium(temperature_K, depth), **SCENE)
    assert np.isnan(run.maps.apparent_temperature_K).all()
    assert "no emission above zero" in run.maps.causes


def test_an_emissivity_of_the_background_changes_no_temperature(
    run_block: Callable[..., Run],
) -> None:
    """At 1e-3 backgrounds differ by 1e-3 of what black ones do: less than the camera resolves."""
    background = {**SCENE["background"], "temperatures_K": [413.0, 533.0]}
    runs = [
        run_block(
            medium(370.0, 1.0, albedo=0.5),
            **{**SCENE, "background": {**background, "emissivity": emissivity}},
            transport={"phase": "isotropic"},
        )
        for emissivity in (1e-3, 1.0)
    ]
    faint, black = (run.maps.apparent_temperature_K.astype(float) for run in runs)
    assert runs[0].maps.has_temperature.all()
    # Weights have 24 bits, and those of the background cancel to 1e-3 of the walls' light.
    np.testing.assert_allclose(faint, black, rtol=1e-5)
