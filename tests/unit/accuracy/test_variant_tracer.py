"""Earlier images that serve a tracer, and errors that its images show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.sources import SOURCES, pixel_sampling
from cldit.accuracy.sources.base import Measurement
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.medium.frame import Frame
from cldit.radiance.weights import Weights
from cldit.scene import load_scene

NOTHING: Any = None


def tracer_of(
    *, node: Any = 0, key: Any = "alike", drawn: Any = None, asked_K: float = 1.0
) -> VariantTracer:
    cube = Frame((0.0, 0.0, 0.0), edge_m=0.2, depth=0)
    prepared: Any = SimpleNamespace(on_lattice=True, node=node, cube=cube)
    settings: Any = SimpleNamespace(accuracy_K=asked_K, visible=0.05)
    levels: Any = {7: "coarse", 8: "fine"}
    scene = load_scene("gdi-cone").with_(**{"camera.rays_per_pixel": 1})
    return VariantTracer(scene, NOTHING, settings, prepared, drawn, NOTHING, levels=levels, key=key)


def test_other_lattices_serve_in_the_same_light() -> None:
    """Wavelengths are chosen for each spray: T_app in another light is no error of the cells."""
    before = tracer_of()
    served: Any = before._reusable("alike", tracer_of().prepared)
    assert served == {0.2 / 2**7: "coarse", 0.2 / 2**8: "fine"}
    assert not before._reusable("alike", tracer_of(node=1).prepared)
    assert not before._reusable("other ordinates", tracer_of().prepared)


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


@pytest.mark.parametrize("drawn", [None, "some"])
def test_an_image_shows_noise_and_pixels(drawn: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """One wavelength has a tolerance of its own; the noise of all is scaled to that of the trace.

    Pixels that lie far apart show nothing of the pixel sampling.
    """
    pixels = Estimate(Cause("pixel sampling", 0.2, "known"))
    monkeypatch.setattr(pixel_sampling, "pixel_error", lambda *_, **__: pixels)
    monkeypatch.setattr(pixel_sampling, "temperature_of", lambda *_, **__: None)
    monkeypatch.setattr(ImagePair, "error_K", lambda *_: 0.8)
    image = ImagePair(Weights(*(np.zeros((4, 4), np.float32),) * 4))
    resolution: Any = SimpleNamespace(ordinates_K=0.5)
    tracer = tracer_of(drawn=drawn, asked_K=2.0)
    at = Measurement(tracer.scene, tracer, NOTHING, 8, 7, resolution=resolution)
    found = {source.name: source.of_image(at, image) for source in SOURCES}
    known = {name: error_K for name, error_K in found.items() if error_K is not None}
    assert known == {"trace": 0.2} | ({"pixel sampling": 0.2} if drawn is None else {})
