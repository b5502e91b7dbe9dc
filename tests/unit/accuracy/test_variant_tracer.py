"""Earlier images that serve a tracer, and errors that its images show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.sources import SOURCES, pixel_sampling
from cldit.accuracy.sources.base import Measurement
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature
from cldit.radiance.weights import Weights
from cldit.scene import load_scene
from cldit.transport.trace import settings_for

NOTHING: Any = None
PIXELS = {"camera.pixels": [90, 60]}


def tracer_of(
    *, node: Any = 0, key: Any = "alike", every: int = 1, asked_K: float = 1.0
) -> VariantTracer:
    cube = Frame((0.0, 0.0, 0.0), edge_m=0.2, depth=0)
    prepared: Any = SimpleNamespace(on_lattice=True, node=node, cube=cube)
    settings: Any = SimpleNamespace(accuracy_K=asked_K, visible=0.05)
    levels: Any = {7: "coarse", 8: "fine"}
    scene = load_scene("gdi-cone").with_(**{"camera.rays_per_pixel": 1})
    return VariantTracer(scene, NOTHING, settings, prepared, every, NOTHING, levels=levels, key=key)


def test_other_lattices_serve_in_the_same_light() -> None:
    """Wavelengths are chosen for each spray: T_app in another light is no error of the cells."""
    before = tracer_of()
    assert before._serves("alike", tracer_of().prepared)
    assert not before._serves("alike", tracer_of(node=1).prepared)
    assert not before._serves("other ordinates", tracer_of().prepared)


def test_grids_that_an_error_is_extrapolated_from() -> None:
    """Half of the cells and twice their edge, if both are there; else twice and four times."""
    levels: Any = {5: "5", 6: "6", 7: "7", 8: "8"}
    tracer: Any = replace(tracer_of(), levels=levels)
    assert tracer.grids(8) == [(1.0, "8"), (2.0, "7"), (4.0, "6")]
    assert tracer.grids(7) == [(0.5, "8"), (1.0, "7"), (2.0, "6")]
    cell_m = 0.2 / 2**7
    earlier = {0.6 * cell_m: "near", 1.6 * cell_m: "twice", 3.2 * cell_m: "four"}
    tracer = replace(tracer, levels={7: "7"}, earlier=earlier)
    assert [image for _, image in tracer.grids(7)] == ["7", "twice", "four"]
    assert [size for size, _ in tracer.grids(7)] == pytest.approx([1.0, 1.6, 3.2])


@pytest.mark.parametrize("every", [1, 2])
def test_an_image_shows_noise_and_pixels(every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One wavelength has a tolerance of its own; the noise of all is scaled to that of the trace.

    Pixels that lie far apart show nothing of the pixel sampling.
    """
    pixels = Estimate(Cause("pixel sampling", 0.2, "known"))
    monkeypatch.setattr(pixel_sampling, "pixel_error", lambda *_, **__: pixels)
    monkeypatch.setattr(pixel_sampling, "temperature_of", lambda *_, **__: None)
    monkeypatch.setattr(ImagePair, "error_K", lambda *_: 0.8)
    image = ImagePair(Weights(*(np.zeros((4, 4), np.float32),) * 4))
    resolution: Any = SimpleNamespace(ordinates_K=0.5)
    tracer = tracer_of(every=every, asked_K=2.0)
    at = Measurement(tracer.scene, tracer, NOTHING, 8, 7, resolution=resolution)
    found = {source.name: source.of_image(at, image) for source in SOURCES}
    known = {name: error_K for name, error_K in found.items() if error_K is not None}
    assert known == {"trace": 0.2} | ({"pixel sampling": 0.2} if every == 1 else {})


def test_every_third_pixel_stands_for_its_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle of each block of 3 x 3: its images are those of fewer pixels, and a map of their
    difference is of the whole image. The RMS of a smooth difference is that of all pixels."""
    tracer: Any = replace(tracer_of(every=3), scene=load_scene("gdi-cone").with_(**PIXELS))
    y, x = np.mgrid[:60, :90] / 30.0
    true_K = 3.0 * np.sin(x) * np.cos(y)
    image = ImagePair(Weights(*(true_K.astype(np.float32),) * 4))
    picked = tracer.picked(SimpleNamespace(weights=image.weights, weights_difference=None,
        middle=image.weights, middle_difference=None, subpixels=None, rays=None))  # fmt: skip
    np.testing.assert_array_equal(picked.weights.wall, image.weights.wall[1::3, 1::3])
    step = ImageDifference(float(np.sqrt(np.mean(picked.weights.wall**2))), picked.weights.wall)
    monkeypatch.setattr(ImageDifference, "between", lambda *_: (step, step))
    difference, _ = tracer.difference(picked, picked)
    known = np.isfinite(difference.map_K)
    assert known.sum() == 20 * 30
    np.testing.assert_array_equal(difference.map_K[known], image.weights.wall[known])
    assert difference.error_K == pytest.approx(float(np.sqrt(np.mean(true_K**2))), rel=0.01)


@pytest.mark.parametrize(("pixels", "every"), [(300, 1), (301, 2), (600, 2), (1000, 4)])
def test_at_most_90_000_pixels_are_traced(pixels: int, every: int, device: Device) -> None:
    scene = load_scene("gdi-cone").with_(**{"camera.pixels": [pixels, pixels]})
    cube = Frame((-0.1, -0.1, -0.1), edge_m=0.2, depth=3)
    node = Quadrature.grey(scene_filter(scene), reference_K=400.0).nodes[0]
    prepared: Any = SimpleNamespace(cube=cube, device=device, node=node)
    tracer = VariantTracer.of(scene, device, settings_for(scene), prepared)
    assert tracer.every == every
    assert tracer.temperature.sees_background.size <= 90_000
