"""T_app of weights and of their mean: one formula by every way to it, and its error."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.dit.evaluate import evaluate_radiance
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.radiance.apparent_temperature import (
    NodeTemperature,
    TraceTemperature,
    result_errors_K,
)
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights, compose, mean
from cldit.scene import Scene, parse_scene

COUNT = 200
SCENE = parse_scene(
    {
        "name": "grey",
        "spray": {"model": "none"},
        "walls": {"temperature_K": 410.0},
        "background": {"temperatures_K": [430.0, 480.0, 560.0], "emissivity": 0.9},
        "patches": [
            {
                "name": "flange",
                "centre_m": [0.06, 0.0, -0.05],
                "facing": "-x",
                "radius_m": 0.03,
                "temperature_K": 600.0,
                "emissivity": 0.6,
            }
        ],
    }
)


def components(scene: Scene, seed: int = 1) -> Floats:
    """(5, N): background, wall, flange, and what vapour and droplets emit at 350 K."""
    rng = np.random.default_rng(seed)
    through = rng.uniform(0.0, 0.9, COUNT)
    scattered, flange = rng.uniform(0.0, 0.3, (2, COUNT)) * (1.0 - through)
    glow = (1.0 - through - scattered - flange) * float(
        band_radiance(350.0, filter_um=scene_filter(scene))
    )
    return np.array([through, scattered, flange, 0.3 * glow, 0.7 * glow])


def images(planes: Floats) -> Weights:
    """(1, N) weights of components."""
    background, wall, flange, vapour, liquid = planes.astype(np.float32)[:, None, :]
    return Weights(background, wall, vapour, liquid, patches={"flange": flange})


def bare() -> Weights:
    """(1, N) weights without a medium."""
    one = np.zeros((5, COUNT))
    one[0] = 1.0
    return images(one)


def evaluated_K(scene: Scene, planes: Floats) -> Floats:
    """(N,) T_app by the evaluation."""
    maps = evaluate_radiance(
        images(planes),
        bare(),
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=Surroundings.from_scene(scene),
        filter_um=scene_filter(scene),
        sensor=None,
        shots=1,
        references=1,
    )
    return maps.apparent_temperature_K.reshape(-1).astype(float)


def test_every_way_gives_the_same_temperature() -> None:
    """The evaluation's maps are float32, 3e-5 K at 500 K; so are the weights, whose emissivity may
    lose a digit. A node's table is interpolated over steps of 2.8e-4 in T."""
    planes = components(SCENE)
    filter_um = scene_filter(SCENE)
    at_K = reference_temperature_K(SCENE.background.temperatures_K)
    (node,) = Quadrature.grey(filter_um, reference_K=at_K).nodes
    traced = TraceTemperature.of(SCENE, [1.0, 1.0]).temperature_K(planes)
    tabulated = NodeTemperature.of(SCENE, node, np.ones((1, COUNT), bool))(images(planes))[0]
    assert np.ptp(traced) > 20.0
    np.testing.assert_allclose(traced, evaluated_K(SCENE, planes), rtol=1e-6)
    np.testing.assert_allclose(traced, tabulated, rtol=1e-6)


def test_units_and_patches_count() -> None:
    """Emission over twice its unit is the same; a flange that reflects half shines less."""
    planes = components(SCENE)
    one = TraceTemperature.of(SCENE, [1.0, 1.0]).temperature_K(planes)
    scaled = planes / np.array([1.0, 1.0, 1.0, 2.0, 2.0])[:, None]
    np.testing.assert_allclose(TraceTemperature.of(SCENE, [2.0, 2.0]).temperature_K(scaled), one)
    black = SCENE.with_(**{"patches[0].emissivity": 1.0})
    assert np.all(TraceTemperature.of(black, [1.0, 1.0]).temperature_K(planes) > one)


def test_error_to_first_order() -> None:
    """Central differences of 1e-4, which over an emissivity of 0.1 or more leave 1e-6."""
    planes = components(SCENE)
    error = 1e-4 * components(SCENE, seed=2)
    temperature = TraceTemperature.of(SCENE, [1.0, 1.0])
    more, less = (temperature.temperature_K(planes + sign * error) for sign in (1.0, -1.0))
    found = temperature.error_K(planes, error)
    np.testing.assert_allclose(found, (more - less) / 2, rtol=1e-5)
    assert np.all(found != temperature.error_K(planes, error, outside=0.0))


def test_errors_of_maps() -> None:
    """The same of maps; 0 where there is no temperature, or hardly an emissivity."""
    planes = components(SCENE)
    error = 1e-3 * components(SCENE, seed=2)
    temperature = TraceTemperature.of(SCENE, [1.0, 1.0])
    emissivity, known_K = 1.0 - planes[0], temperature.temperature_K(planes)
    emissivity[:3], known_K[3:5] = 0.04, np.nan
    of = partial(
        result_errors_K,
        images(error),
        emissivity=emissivity,
        scene=SCENE,
    )
    found, of_emissivity = of(temperature_K=known_K)
    assert not found[:5].any()
    np.testing.assert_allclose(found[5:], temperature.error_K(planes, error)[5:], rtol=1e-5)
    per_K = kelvin_per_emissivity(SCENE)
    np.testing.assert_allclose(of_emissivity, -per_K * error[0], rtol=1e-5)


def test_kelvin_of_an_emissivity() -> None:
    """The change of T_app by an emissivity that is 1e-4 too large, of an opaque medium as warm as
    the coldest background, by the inverse of Planck's law; or the ratio of given tolerances."""
    filter_um, at_K = scene_filter(SCENE), 430.0
    light = band_radiance(at_K, filter_um=filter_um)
    changed_K = float(temperature_of_radiance(np.array([light / 1.0001]), filter_um=filter_um)[0])
    # By the curve of B over T the difference is 1e-4 of itself times a few.
    assert kelvin_per_emissivity(SCENE) == pytest.approx((at_K - changed_K) / 1e-4, rel=1e-3)
    given = SCENE.with_(**{"transport.accuracy_K": 2.0, "transport.accuracy_emissivity": 0.01})
    assert kelvin_per_emissivity(given) == 200.0


def test_no_temperature() -> None:
    """Off the background, and where there is no medium, a node's T_app is NaN."""
    (node,) = Quadrature.grey(scene_filter(SCENE), reference_K=500.0).nodes
    before = np.arange(COUNT)[None, :] >= 10
    temperature = NodeTemperature.of(SCENE, node, before)
    assert np.array_equal(np.isnan(temperature(images(components(SCENE)))), ~before)
    assert np.isnan(temperature(bare())).all()
    thin = components(SCENE)
    thin[0] = 0.96
    assert np.isnan(TraceTemperature.of(SCENE, [1.0, 1.0]).error_K(thin, 1e-3 * thin)).all()


@pytest.mark.parametrize("picked", [[0, 3, 7], [5]])
def test_picked_pixels(picked: list[int]) -> None:
    (node,) = Quadrature.grey(scene_filter(SCENE), reference_K=500.0).nodes
    temperature = NodeTemperature.of(SCENE, node, np.arange(COUNT).reshape(20, 10) % 2 == 0)
    weights = images(components(SCENE)).map(lambda image: image.reshape(20, 10))
    some = weights.map(lambda image: image.reshape(1, -1)[:, picked])
    whole = temperature(weights).reshape(1, -1)[:, picked]
    np.testing.assert_array_equal(temperature.picked(np.array(picked))(some), whole)


def _some(seed: int) -> Weights:
    images = np.random.default_rng(seed).random((5, 3, 4)).astype(np.float32)
    return Weights(*images[:4], patches={"port": images[4]})


def test_its_light_is_the_mean_of_the_light() -> None:
    """Transfer is linear: to the rounding of float32, 6e-8 of each of five terms up to 300."""
    every = [_some(seed) for seed in range(7)]

    def light(weights: Weights) -> np.ndarray:
        return compose(weights, background=300.0, wall=200.0, patches={"port": 100.0})

    expected = np.mean([light(one) for one in every], axis=0)
    assert light(mean(iter(every))) == pytest.approx(expected, abs=5 * 300 * 6e-8)


def test_of_none_is_refused() -> None:
    with pytest.raises(ValueError, match="allowed: one or more"):
        mean([])
