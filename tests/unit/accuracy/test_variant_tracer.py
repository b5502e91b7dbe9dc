"""Earlier images that serve a tracer, and errors that its images show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
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
    cube = Cube((0.0, 0.0, 0.0), edge_m=0.2, depth=0)
    scene = load_scene("gdi-cone").with_(**{"camera.rays_per_pixel": 1, **PIXELS})
    prepared: Any = SimpleNamespace(on_lattice=True, node=node, cube=cube, scene=scene)
    settings: Any = SimpleNamespace(accuracy_K=asked_K, visible=0.05)
    levels: Any = {}
    return VariantTracer(prepared, settings, every, NOTHING, levels=levels, key=key)


def test_other_lattices_serve_in_the_same_light() -> None:
    """Wavelengths are chosen for each spray: T_app in another light is no error of the cells."""
    before = tracer_of()
    assert before._serves("alike", tracer_of().prepared)
    assert not before._serves("alike", tracer_of(node=1).prepared)
    assert not before._serves("other ordinates", tracer_of().prepared)


def test_grids_that_an_error_is_extrapolated_from() -> None:
    """Half of the cells and twice their edge, if both are there; else twice and four times."""
    m = {depth: float(f"{0.2 / 2**depth:.9g}") for depth in range(9)}
    levels: Any = {m[depth]: str(depth) for depth in (5, 6, 7, 8)}
    tracer: Any = replace(tracer_of(), levels=levels)
    assert tracer.grids(m[8]) == [(1.0, "8"), (2.0, "7"), (4.0, "6")]
    assert tracer.grids(m[7]) == [(0.5, "8"), (1.0, "7"), (2.0, "6")]
    levels = {m[7]: "7", 1.5 * m[7]: "near", 3.2 * m[7]: "far"}
    tracer = replace(tracer_of(), levels=levels)
    assert [image for _, image in tracer.grids(m[7])] == ["7", "near", "far"]
    assert tracer.coarser(m[7]) == 1.5 * m[7] and tracer.coarser(3.2 * m[7]) == 6.4 * m[7]


def test_cells_of_a_lattice_have_any_edge() -> None:
    """Their cube is the domain or up to twice as large; else the cube is halved."""
    tracer: Any = tracer_of()
    for cell_m in (0.2 / 64, 0.2 / 64 / 1.5, 0.2 / 64 / 2.25):
        frame = tracer.frame(cell_m)
        assert frame.cell_m == pytest.approx(cell_m) and 0.2 - 1e-9 <= frame.edge_m < 0.4
        assert np.add(frame.lower_m, frame.edge_m / 2) == pytest.approx(
            tracer.scene.domain.centre_m
        )
    tracer.prepared.on_lattice = False
    assert tracer.frame(0.2 / 64) == tracer.prepared.cube.at(6)


def test_every_third_pixel_stands_for_its_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle of each block of 3 x 3: its images are those of fewer pixels, and a map of their
    difference is of the whole image. The RMS of a smooth difference is that of all pixels."""
    tracer: Any = tracer_of(every=3)
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
    cube = Cube((-0.1, -0.1, -0.1), edge_m=0.2, depth=3)
    node = Quadrature.grey(scene_filter(scene), reference_K=400.0).nodes[0]
    prepared: Any = SimpleNamespace(scene=scene, cube=cube, device=device, node=node)
    tracer = VariantTracer.of(prepared, settings_for(scene))
    assert tracer.stride == every
    assert tracer.temperature.sees_background.size <= 90_000
