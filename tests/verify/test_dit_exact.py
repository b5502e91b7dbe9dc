"""Noise-free DIT.

Rationale: transfer is linear in its sources, so the evaluation of a trace must give 1 - w_bg back,
and the temperature of an isothermal absorber whatever the walls do; scattering makes the apparent
temperature a mean of the droplet's and the walls' radiance.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray

FILTER = (3.3, 3.5)


def _weights(**parts: NDArray[np.floating]) -> Weights:
    zero = np.zeros(next(iter(parts.values())).shape)
    names = ("background", "wall", "vapour", "liquid")
    return Weights.of({name: parts.get(name, zero).astype(np.float32) for name in names})


def _maps(
    spray: Weights,
    *,
    wall_K: float = 450.0,
    emissivity: float = 0.97,
    backgrounds_K: tuple[float, ...] = (400.0, 440.0, 480.0, 520.0, 560.0),
    sensor: SensorModel | None = None,
) -> Maps:
    disc = np.ones_like(spray.background)
    return evaluate_radiance(
        spray,
        _weights(background=disc),
        background_temperatures_K=backgrounds_K,
        surroundings=Surroundings(wall_temperature_K=wall_K, background_emissivity=emissivity),
        filter_um=FILTER,
        sensor=sensor,
        shots=5,
        references=5,
    )


def _random(wall_K: float, shape: tuple[int, int] = (40, 50)) -> Weights:
    """Any closed set of weights: shares of background, wall and two emitters sum to one."""
    rng = np.random.default_rng(11)
    share = rng.dirichlet([1.0, 1.0, 1.0, 1.0], shape)
    cold, warm = band_radiance([380.0, 430.0], filter_um=FILTER)
    return _weights(
        background=share[..., 0],
        wall=share[..., 1],
        vapour=share[..., 2] * warm,
        liquid=share[..., 3] * cold,
    )


@pytest.mark.parametrize("emissivity", [1.0, 0.8, 0.05])
@pytest.mark.parametrize("wall_K", [0.0, 300.0, 700.0])
@pytest.mark.parametrize("with_sensor", [False, True])
def test_one_minus_background_weight(emissivity: float, wall_K: float, with_sensor: bool) -> None:
    """1 - w_bg to 1e-4, asked for; float32 weights (6e-8) leave 1e-6 and carry it to the slope.

    The apparent temperature is that of (wall + emission) / (1 - w_bg), whatever background was
    used and whatever noise weighs the backgrounds.
    """
    sensor = SensorModel.from_scene(Scene(name="t", spray=EmptySpray())) if with_sensor else None
    spray = _random(wall_K)
    maps = _maps(spray, wall_K=wall_K, emissivity=emissivity, sensor=sensor)
    np.testing.assert_allclose(maps.emissivity, 1 - spray.background, atol=2e-6)
    wall = band_radiance(wall_K, filter_um=FILTER)
    own = (spray.wall * wall + spray.vapour + spray.liquid) / (1.0 - spray.background)
    # A disc of emissivity 0.05 before hot walls hardly changes: noise hides a weak spray there.
    from_own = (maps.reason == Reason.OK) & (maps.emissivity > 0.05)
    assert from_own.mean() > 0.6
    expected = band_radiance(maps.apparent_temperature_K[from_own], filter_um=FILTER)
    np.testing.assert_allclose(expected, own[from_own], rtol=1e-4)


@pytest.mark.parametrize("depth", [0.01, 0.3])
def test_droplet_six_per_cent_low(depth: float) -> None:
    """A droplet at 400 K with equal scattering and absorption before walls at 300 K.

    Half of its extinction emits at 400 K, the other half scatters the walls; at one wavelength,
    1 / expm1(x / T) = (1 / expm1(x / 400) + 1 / expm1(x / 300)) / 2 with x = h c / (lambda k) =
    4231.7 K at 3.4 um. The paper (Section "Wall Temperature") states 6 % below 400 K.
    """
    gone = np.full((2, 2), -np.expm1(-depth))
    spray = _weights(
        background=1 - gone,
        wall=gone / 2,
        liquid=gone / 2 * band_radiance(400.0, filter_um=FILTER),
    )
    got = _maps(spray, wall_K=300.0, emissivity=1.0).apparent_temperature_K
    x = 0.014387768775 / 3.4e-6
    mean = (1 / np.expm1(x / 400) + 1 / np.expm1(x / 300)) / 2
    closed = x / np.log1p(1 / mean)
    assert closed / 400 - 1 == pytest.approx(-0.06, abs=0.002)
    # the filter's 0.2 um instead of one wavelength: 0.05 K
    np.testing.assert_allclose(got, closed, atol=0.1)
