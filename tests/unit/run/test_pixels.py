"""The error by pixel sampling, on pictures that are known between the pixels."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.radiance.weights import Weights
from cldit.run import pixels
from cldit.run.node_temperature import NodeTemperature
from cldit.run.picture import Picture
from cldit.scene import Scene, load_scene, parse_scene

FINE = 30  # points along a pixel's edge
COUNT = 60  # pixels


def smooth(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.3 + 0.1 * np.sin(9 * x) * np.cos(7 * z))


def edges(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Blocks of 2.7 pixels."""
    column, row = (np.floor(axis * COUNT / 2.7).astype(int) for axis in (x, z))
    return np.asarray(0.2 + 0.2 * np.random.default_rng(3).random((80, 80))[row, column])


def weights(emitted: NDArray[np.float64]) -> Weights:
    image = emitted.astype(np.float32)
    return Weights(np.full_like(image, 0.5), np.zeros_like(image), np.zeros_like(image), image)


def scene_of(rays: int) -> Scene:
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"].update(pixels=[COUNT, COUNT], rays_per_pixel=rays)
    return parse_scene(data)


@pytest.mark.parametrize("light", [smooth, edges])
@pytest.mark.parametrize("rays", [1, 4, 16])
def test_stated_and_true(light: Any, rays: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a factor of two. Temperature is ten times what is emitted, to have no curve."""
    scene = scene_of(rays)
    temperature = NodeTemperature(
        scene,
        np.linspace(1.0, 50.0, 1000),
        np.linspace(0.01, 3.0, 1000),
        np.ones((COUNT, COUNT), bool),
    )
    monkeypatch.setattr(pixels, "temperature_of", lambda *_: temperature)

    def of(across: int) -> Weights:
        """Means over so many points across each pixel."""
        points = (np.arange(COUNT * across) + 0.5) / (COUNT * across)
        fine = light(*np.meshgrid(points, points)).reshape(COUNT, across, COUNT, across)
        return weights(fine.mean(axis=(1, 3)))

    mean, seen, middle = of(FINE), of(int(rays**0.5)), of(1)
    probed: Any = SimpleNamespace()
    picture = Picture(seen, middle=None if rays == 1 else middle)
    cause, step = pixels.pixel_error(scene, probed, picture)
    true = float(np.sqrt(np.mean((temperature(seen) - temperature(mean)) ** 2)))
    assert step is not None and step.map_K.shape == (COUNT, COUNT)
    assert cause.error_K is not None
    assert 0.5 < cause.error_K / true < 2.0
