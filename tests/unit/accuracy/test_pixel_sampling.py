"""The error by pixel sampling, on images that are known between the pixels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.sources import pixel_sampling
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.radiance.weights import Weights
from cldit.scene import Scene, load_scene, parse_scene
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.ray_choice import contrasts
from cldit.transport.result import Subpixels
from cldit.transport.subpixels import important
from cldit.transport.tuning import Tuning

FINE = 32  # points along a pixel's edge
COUNT = 60  # pixels


def smooth(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.3 + 0.1 * np.sin(9 * x) * np.cos(7 * z))


def edges(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Blocks of e pixels: edges lie anywhere in pixels, not always on the same rays."""
    column, row = (np.floor(axis * COUNT / math.e).astype(int) for axis in (x, z))
    return np.asarray(0.2 + 0.2 * np.random.default_rng(3).random((80, 80))[row, column])


def plumes(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Six, some two pixels wide: from 3 x 3 pixels to 5 x 5 the error hardly grows."""
    away = [(x - (number + 0.37) / 6 - 0.1 * z) * COUNT for number in range(6)]
    return np.asarray(0.2 + 0.2 * sum(np.exp(-0.5 * (one / 0.5) ** 2) for one in away))


def weights(emitted: NDArray[np.float64], hidden: float = 0.0) -> Weights:
    """A medium that hides 0.5 of the background, and more by `hidden` times what it emits."""
    image, nothing = emitted.astype(np.float32), np.zeros(emitted.shape, np.float32)
    return Weights(np.float32(0.5) - np.float32(hidden) * image, nothing, nothing, image)


def scene_of(rays: int) -> Scene:
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"].update(pixels=[COUNT, COUNT], rays_per_pixel=rays)
    return parse_scene(data)


def kelvin(scene: Scene) -> NodeTemperature:
    """Temperature is ten times what is emitted, to have no curve."""
    before = np.ones((COUNT, COUNT), bool)
    grid = np.linspace(1.0, 50.0, 1000)
    around = Boundary.without_windows(
        Surroundings.from_scene(scene), lambda kelvin: np.asarray(kelvin, float) / 5.0
    )
    return NodeTemperature(grid, grid / 5.0, around.wall, around.patches, before)


@pytest.mark.parametrize("light", [smooth, edges, plumes])
@pytest.mark.parametrize(
    ("rays", "seed"), [(1, 1), (4, 2), pytest.param(16, 3, marks=pytest.mark.slow)]
)
def test_stated_and_true(light: Any, rays: int, seed: int) -> None:
    """Over seeds the root scatters by up to 8 %: three times that, and the standard error that is
    added, up to 16 %. By blocks of 3 x 3 and 5 x 5 pixels and an order from both the plumes seem
    to err by 2.6 times the truth."""
    scene = scene_of(rays)
    temperature = kelvin(scene)

    def of(across: int) -> Weights:
        """Means over so many points across each pixel."""
        points = (np.arange(COUNT * across) + 0.5) / (COUNT * across)
        fine = light(*np.meshgrid(points, points)).reshape(COUNT, across, COUNT, across)
        return weights(fine.mean(axis=(1, 3)), 0.5)

    across = int(rays**0.5)
    mean, seen, many = of(FINE), of(across), of(4 * across)
    square = contrasts(np.stack(temperature.results(seen))).reshape(2, -1) ** 2
    sample = important(square, tuning=Tuning(), seed=seed)
    assert len(sample.pixels) < COUNT**2 / 10
    some = many.map(lambda image: image.reshape(1, -1)[:, sample.pixels])
    many_across = np.full(len(sample.pixels), 4 * across)
    image = ImagePair(seen, subpixels=Subpixels(sample, many_across, some, None))
    found = pixel_sampling.pixel_error(temperature, image)
    apart = np.subtract(temperature.results(seen), temperature.results(mean))
    true = np.sqrt(np.mean(apart**2, axis=(1, 2)))
    assert np.all(true > 0.0) and len(found.maps_K) == 2
    for stated_K, true_K, map_K in zip(found.errors_K, true, found.maps_K, strict=True):
        assert stated_K is not None and map_K.shape == (COUNT, COUNT)
        assert 0.75 < stated_K / true_K < 1.4


def test_noise_is_no_error() -> None:
    """An image that is even but for the noise of its halves, 0.7 K each, which the sample does not
    share: their differences from it are of 1 K each, and their product of 1 K^2. In 400 pixels it
    has a doubt of 1 / 20, and by the noise of each as much again: 0.07 K^2. Three of them and
    the doubt that is added are less than the noise of the mean, 0.5 K^2.
    """
    scene = scene_of(1)
    temperature = kelvin(scene)
    rng = np.random.default_rng(5)

    def noisy(shape: tuple[int, int]) -> tuple[Weights, Weights]:
        """Their mean and half the difference, of halves of 0.7 K each."""
        one, other = (0.3 + 0.07 * rng.standard_normal(shape) for _ in range(2))
        half = weights((one - other) / 2)
        half.background[:] = 0.0
        return weights((one + other) / 2), half

    mean, half = noisy((COUNT, COUNT))
    count = 400
    sample = PixelSample(np.arange(count) * 9, np.full(count, 1 / 9))
    some, apart = noisy((1, count))
    image = ImagePair(mean, half, Subpixels(sample, np.full(count, 4), some, apart))
    error_K = pixel_sampling.pixel_error(temperature, image).error_K
    assert error_K is not None and error_K**2 < 4 * 0.07


def test_nothing_to_see_is_unknown() -> None:
    scene = scene_of(1)
    temperature = kelvin(scene)
    clear = Weights(*(np.ones((COUNT, COUNT), np.float32),) * 4)
    assert pixel_sampling.pixel_error(temperature, ImagePair(clear)).error_K is None
