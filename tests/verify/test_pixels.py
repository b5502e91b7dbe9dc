"""Several rays a pixel, and several devices a picture.

Expected: the mean over a pixel's area, where something sharp crosses it; the same picture however
many devices share it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.sources.pixel_sampling import pixel_error
from cldit.bench.case import changed
from cldit.errors import DeviceError, TransportError
from cldit.gpu import buffers
from cldit.gpu.device import Device, open_device, split
from cldit.medium.frame import Cube
from cldit.medium.octree import build_octree
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.run import Run
from cldit.scene import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.image import Rays
from cldit.transport.trace import trace
from cldit.transport.view import View
from tests.bench.case import Case
from tests.small_scenes import of_whole_field

EDGE = 0.2
PIXELS = 40
CUBE = Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=EDGE, leaf_edge_m=2 * EDGE)

WARM = {"droplet_temperature_K": 350.0}


def vessel(device: Device, rays: Any, **camera: Any) -> Run:
    """An empty one: the picture is the disc."""
    data = {
        "name": "disc",
        "spray": {"model": "none"},
        "camera": {
            "model": "orthographic",
            "pixels": [PIXELS, PIXELS],
            "field_m": [0.16, 0.16],
            "rays_per_pixel": rays,
            **camera,
        },
        "background": {"radius_m": 0.0503},
        "transport": {"audit": False},
    }
    return cldit.simulate(cldit.Scene.from_dict(data), device=device)


def block(
    run_block: Callable[..., Run],
    asked: dict[str, Any] | None = None,
    radius_m: float = 0.05,
    **camera: Any,
) -> Run:
    """Cells with droplets beside empty ones, thick enough for edges."""
    rng = np.random.default_rng(1)
    filled = rng.random((8, 8, 8)) < 0.3
    return run_block(
        {
            "droplet_absorption_per_m": 60.0 * filled,
            "droplet_scattering_per_m": 60.0 * filled,
            "vapour_absorption_per_m": 3.0 * filled,
            "droplet_temperature_K": np.full(filled.shape, 350.0),
            "vapour_temperature_K": np.full(filled.shape, 500.0),
        },
        size_m=(EDGE / 2,) * 3,
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 16},
        camera={"pixels": [50, 46], "field_m": [0.16, 0.16], **camera},
        background={"temperatures_K": [400.0, 500.0], "radius_m": radius_m},
        transport=asked or {},
    )


@pytest.mark.parametrize("rays", [1, 4, 16])
def test_shares_of_the_boundary(device: Device, rays: int) -> None:
    """Of a vessel without a medium they are its picture, up to rays that touch the rim."""
    run = vessel(device, rays)
    cells = OpticalCells.of(build_octree(CUBE, None, [], optical_depth_split=1.0))
    view = View.of(run.scene, cells, device)
    shares = view.boundary_shares(np.arange(PIXELS**2), np.full(PIXELS**2, int(rays**0.5)))
    np.testing.assert_allclose(shares.sum(axis=0), 1.0)
    for share, seen in zip(shares, (run.weights.background, run.weights.wall), strict=True):
        assert np.count_nonzero(np.abs(share - seen.ravel()) > 1e-6) <= 2
    assert np.all(run.weights.background.ravel()[shares[0] == 1.0] == 1.0)


@pytest.mark.parametrize(
    ("rays", "share"), [pytest.param(1, 1.0, marks=pytest.mark.slow), ("auto", 0.8)]
)
def test_paths_begin_anywhere_in_a_pixel(
    run_block: Callable[..., Run], rays: Any, share: float
) -> None:
    """A block ends at 0.8 of a column of pixels, whose middles it hides."""
    pitch_m = 0.005 / 3.3
    camera = {"model": "orthographic", "pixels": [9, 40], "field_m": [9 * pitch_m, 0.005]}
    run = run_block(
        {"droplet_absorption_per_m": 300.0, "droplet_scattering_per_m": 200.0, **WARM},
        size_m=(0.01, 0.005, 0.02),
        domain={"edge_m": 0.04, "leaf_edge_m": 0.00125},
        background={"radius_m": 0.018, "temperatures_K": [400.0, 500.0]},
        camera={**camera, "rays_per_pixel": rays},
        transport={"method": "path", "phase": "isotropic", "accuracy_K": 0.3, "audit": True},
    )
    hidden = 1.0 - run.weights.background.astype(float).mean(axis=0)
    # At least 4 places in each of 80 pixels: a standard error of 0.4 / 320^0.5 = 0.022.
    assert hidden[[1, 7]].mean() / hidden[4] == pytest.approx(share, abs=0.066)


@pytest.mark.parametrize(
    "camera", [pytest.param({}, marks=pytest.mark.slow), {"rays_per_pixel": 4}]
)
def test_an_image_beyond_one_buffer(
    run_block: Callable[..., Run], camera: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In parts of 100 pixels it is the image in one, to the bit."""
    asked = {"directions": 8, "audit": False}
    whole = block(run_block, asked, **camera).weights
    monkeypatch.setattr(Rays, "_most_pixels", 100)
    parts = block(run_block, asked, **camera).weights
    for name, image in whole.images.items():
        np.testing.assert_array_equal(parts.images[name], image)


@pytest.mark.parametrize("rays", [4, 16, 64])
def test_area_of_a_disc(device: Device, rays: Any) -> None:
    """n^2 rays err by at most the boundary's length in cells of 1/n pixel; the sum by far less.

    At the edge a pixel's share is a multiple of 1 / n^2, within 1 / n of the true one.
    """
    run = vessel(device, rays)
    seen = run.weights.background.astype(float)
    across = int(rays**0.5)
    fine = (np.arange(PIXELS * 32) + 0.5) / 32 * 0.004 - 0.08
    inside = (fine[:, None] ** 2 + fine[None, :] ** 2 < 0.0503**2).astype(float)
    truth = inside.reshape(PIXELS, 32, PIXELS, 32).mean(axis=(1, 3))
    assert np.abs(seen - truth).max() < 1.0 / across
    assert np.any((seen > 0.1) & (seen < 0.9))
    area = seen.sum() * 0.004**2
    assert area == pytest.approx(np.pi * 0.0503**2, rel=5e-3)
    one = vessel(device, 1).weights.background
    assert set(np.unique(one)) == {0.0, 1.0}


@pytest.mark.parametrize("way", [{"method": "path"}, {"method": "branching", "order": 1}])
def test_rays_go_with_source_alone(run_block: Callable[..., Run], way: dict[str, Any]) -> None:
    with pytest.raises(
        TransportError, match=r"camera\.rays_per_pixel: 4 with .* allowed: 1 or auto"
    ):
        run_block(
            {"droplet_scattering_per_m": 10.0},
            size_m=(0.1,) * 3,
            domain={"edge_m": EDGE, "leaf_edge_m": 0.02},
            camera={"pixels": 4, "rays_per_pixel": 4},
            transport=way,
        )


@pytest.mark.parametrize("rays", [1, 4, "auto"])
def test_two_devices_make_one_picture(device: Device, rays: Any) -> None:
    """Two halves of the CPU, each with its rows; equal to the last bit, odd sizes and all."""
    if not device.is_cpu or device.info.compute_units < 2:
        pytest.skip("the device cannot be divided into two")
    both = split(device, [1, 1])
    assert len(both.others) == 1
    data = {"pixels": [37, 41], "field_m": [0.16, 0.16]}
    one, two = (vessel(used, rays, **data) for used in (device, both))
    for name, image in one.weights.images.items():
        np.testing.assert_array_equal(image, two.weights.images[name])
    # More devices than rows: some have nothing to do.
    few = {"pixels": [5, 1], "field_m": [0.16, 0.16]}
    assert vessel(both, rays, **few).weights.background.shape == (1, 5)


@pytest.mark.parametrize(
    "transport",
    [
        {"method": "path", "max_samples": 128},
        {"method": "branching", "order": 1},
        {"gather": True, "accuracy_K": 5.0, "max_samples": 128},
    ],
)
def test_two_devices_scatter_as_one(
    run_block: Callable[..., Run], device: Device, tables: Path, transport: dict[str, Any]
) -> None:
    """Chance goes by the pixel: its picture is the same to the last bit, whoever makes it."""
    if not device.is_cpu or device.info.compute_units < 2:
        pytest.skip("the device cannot be divided into two")
    one = run_block(
        {"droplet_scattering_per_m": 70.0, "droplet_absorption_per_m": 30.0, **WARM},
        size_m=(0.05, 0.07, 0.06),
        domain={"edge_m": EDGE, "leaf_edge_m": 0.01},
        camera={"pixels": [9, 11], "field_m": [0.1, 0.1]},
        transport=transport,
    )
    two = cldit.simulate(one.scene, device=split(device, [1, 1]), cache=tables)
    for name, image in one.weights.images.items():
        np.testing.assert_array_equal(image, two.weights.images[name])
    assert one.info.counts == two.info.counts


def test_devices_by_name(device: Device) -> None:
    with pytest.raises(DeviceError, match="more than once"):
        open_device(f"{device.info.index},{device.info.index}")
    with pytest.raises(DeviceError, match="does not exist"):
        open_device(f"{device.info.index}, 17:3")
    with pytest.raises(DeviceError, match="cannot be divided"):
        split(device, [10_000, 1])


def test_a_device_with_little_memory_says_so(run_block: Callable[..., Run], device: Device) -> None:
    """A buffer beyond the device's largest is refused by name, before anything is computed."""
    info = replace(device.info, largest_buffer_bytes=10_000)
    with pytest.raises(DeviceError, match=r"GB is more than .* takes in one buffer .*leaf_edge_m"):
        vessel(replace(device, info=info), 1, pixels=[400, 400])


@pytest.mark.parametrize("method", ["source", "path", "branching"])
def test_no_buffer_is_larger_than_a_device_takes(
    run_block: Callable[..., Run],
    device: Device,
    tables: Path,
    method: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of all buffers that a method makes the largest is as large as is allowed, and one byte less
    is refused, or makes that buffer smaller, as with sweeps: none is made without asking."""
    sizes: list[int] = []

    class Noted(buffers.Numbers):
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            sizes.append(self.size)

    monkeypatch.setattr(buffers, "Numbers", Noted)
    first = run_block(
        {"droplet_scattering_per_m": 30.0, "droplet_absorption_per_m": 10.0, **WARM},
        size_m=(0.05, 0.07, 0.06),
        domain={"edge_m": EDGE, "leaf_edge_m": 0.02},
        camera={"pixels": 9, "field_m": [0.1, 0.1]},
        transport={"method": method, "order": 1, "accuracy_K": 5.0, "max_samples": 128},
    )
    largest = max(sizes)
    for limit, refused in ((largest, False), (largest - 1, method != "source")):
        info = replace(device.info, largest_buffer_bytes=limit)
        context = pytest.raises(DeviceError, match="in one buffer") if refused else nullcontext()
        sizes.clear()
        with context:
            cldit.simulate(first.scene, device=replace(device, info=info), cache=tables)
        assert max(sizes, default=0) <= limit


@pytest.mark.parametrize(
    "method", ["source", *(pytest.param(m, marks=pytest.mark.slow) for m in ("path", "branching"))]
)
def test_small_work_groups(
    run_block: Callable[..., Run], device: Device, tables: Path, method: str
) -> None:
    """A device of work-groups of 20 gives the same picture: nothing relies on their size."""
    scene = {"camera": {"pixels": 9, "field_m": [0.1, 0.1]}}
    transport = {"method": method, "order": 1, "accuracy_K": 5.0, "max_samples": 128}
    first = run_block(
        {"droplet_scattering_per_m": 30.0, "droplet_absorption_per_m": 10.0, **WARM},
        size_m=(0.05, 0.07, 0.06),
        domain={"edge_m": EDGE, "leaf_edge_m": 0.007},
        transport=transport,
        **scene,
    )
    small = replace(device, info=replace(device.info, largest_group=20))
    second = cldit.simulate(first.scene, device=small, cache=tables)
    for name, image in first.weights.images.items():
        np.testing.assert_array_equal(image, second.weights.images[name])


@pytest.mark.parametrize(
    ("rays", "radius_m"), [(1, 0.15), pytest.param(4, 0.05, marks=pytest.mark.slow)]
)
def test_stated_error_of_the_pixels(
    run_block: Callable[..., Run], rays: int, radius_m: float
) -> None:
    """Of a block of droplets, against 64 rays on the same cells and ordinates.

    256 of some 600 pixels tell the error to a tenth, and a standard error is added. The square of
    what 64 rays err by is a 16th of that of 4. The rim of the smaller disc crosses 27 of the
    pixels, whose T_app by DIT holds what the medium adds before the wall: they make 2.9 K.
    """
    # Little noise of paths in the truth.
    asked = {"accuracy_K": 0.1, "directions": 32}
    run, true = (
        block(run_block, {**asked, "audit": audit}, radius_m, rays_per_pixel=number)
        for number, audit in ((rays, True), (64, False))
    )
    assert run.errors is not None
    stated = next(one for one in run.errors.causes if one.name == "pixel sampling")
    both = run.maps.has_temperature & true.maps.has_temperature
    apart = run.maps.apparent_temperature_K - true.maps.apparent_temperature_K
    true_K = float(np.sqrt(np.mean(apart[both].astype(float) ** 2)))
    assert stated.error_K is not None and 0.75 < stated.error_K / true_K < 1.4


def whole_field(name: str, *, leaf_m: float, order: int | None, **camera: Any) -> Scene:
    """The shipped scene with its whole field on these cells, at 1 K."""
    return changed(
        of_whole_field(name),
        domain={"leaf_edge_m": leaf_m},
        camera=camera,
        optics={"compare_paper": False},
        transport={"accuracy_K": 1.0, "directions": 32, "order": order, "audit": False},
    )


@pytest.mark.slow
@pytest.mark.parametrize("pixels", [50, 200])
def test_stated_error_of_a_thin_jet(device: Device, tables: Path, pixels: int) -> None:
    """A jet of vapour from one pixel to many wide: by blocks of pixels and an order from two of
    them, 0.33 of the truth were stated at 50 pixels, and 4.1 of it at 200."""
    square = {"pixels": [pixels, pixels], "rays_per_pixel": 1}
    scene = whole_field("methane-jet", leaf_m=1e-3, order=None, **square)
    one = Case.of(scene, device, cache=tables)
    most = one.seen(changed(scene, camera={"rays_per_pixel": 64}))
    result, _ = one.run(replace(one.settings(), subpixels=True))
    true = trace(most.tree, most.scene, device, most.settings()).weights
    apart_K = one.temperature_K(result.weights) - one.temperature_K(true)
    counted = np.isfinite(apart_K)
    for weights in (result.weights, true):
        counted &= 1.0 - weights.background > VISIBLE_EMISSIVITY
    stated_K = pixel_error(one._temperature, ImagePair.of(result)).error_K
    assert stated_K is not None
    assert 0.75 < stated_K / np.sqrt(np.mean(apart_K[counted] ** 2)) < 1.4


@pytest.mark.parametrize(
    ("name", "order", "rays"),
    [pytest.param("methane-jet", None, 4, marks=pytest.mark.slow), ("gdi-cone", 0, 1)],
)
def test_some_pixels_are_those_of_the_picture(
    device: Device, tables: Path, name: str, order: int | None, rays: int
) -> None:
    """By the very same rays, in any order of the pixels."""
    camera = {"pixels": [40, 30], "rays_per_pixel": rays}
    scene = whole_field(name, leaf_m=2e-3, order=order, **camera)
    case = Case.of(scene, device, cache=tables)
    settings = case.settings(gather=False)
    pixels = np.array([1100, 17, 379, 380, 381, 3])
    whole, some = (
        trace(case.tree, case.scene, device, settings, pixels=listed).weights
        for listed in (None, pixels)
    )
    for name, image in whole.images.items():
        assert some.images[name].shape == (1, len(pixels))
        np.testing.assert_allclose(some.images[name][0], image.flat[pixels], rtol=1e-6, atol=1e-9)
    assert 0.0 < whole.background.flat[380] < 1.0
