"""Images of a lens of finite aperture, against discs, edges, and images from points of the lens.

A point at the distance s from the camera is imaged as a disc; in the target plane, at the distance
D, its radius is R |D / s - D / F|, for an aperture of radius R in focus at F.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.errors import SceneError, TransportError
from cldit.gpu.device import Device
from cldit.run import Run
from cldit.scene.camera import Camera
from cldit.transport.view import View

DISTANCE, FIELD, PIXELS = 1.0, 0.016, 64
PITCH = FIELD / PIXELS
LENS = {"diffraction": False}
# A pitch of PITCH / 19 has the image 1 / 19 m behind the lens: a focal length of 0.05 m.
WIDE = {"f_number": 0.8, "pixels": [PIXELS, PIXELS], "pitch_m": PITCH / 19}
BLACK = 2e4  # per metre: nothing is seen through the blocks below

# Where the block is, and where the lens is focused: before, in and behind focus.
PLACES = [(0.04, None), (-0.05, None), (0.0, 1.1), (0.0, 0.93), (0.04, 1.04)]


def seen(run_block: Callable[..., Run], size_m: tuple[float, float, float], **given: Any) -> Run:
    """A black block at the origin; everything else is the background."""
    nearer_m, camera = given.pop("nearer_m"), given.pop("camera")
    shape = given.pop("filled", np.ones((1, 1, 1)))
    return run_block(
        {"droplet_absorption_per_m": BLACK * shape, "droplet_temperature_K": 350.0},
        size_m=size_m,
        domain={"edge_m": 0.2, "leaf_edge_m": 0.2 / 512},
        camera={
            "distance_m": DISTANCE,
            "field_m": [FIELD, FIELD],
            "pixels": PIXELS,
            "target_m": [0.0, -nearer_m, 0.0],
            **camera,
        },
        background={"shape": "enclosure", "temperatures_K": [400.0, 500.0]},
    )


def blur_m(camera: Camera, nearer_m: float) -> float:
    away_m = DISTANCE + nearer_m
    return camera.aperture_m / 2 * abs(DISTANCE / away_m - DISTANCE / camera.focus_m)


def beyond_edge(x: np.ndarray, radius: float) -> np.ndarray:
    """Share of a disc's area on the right of a line, whose middle is x to the right of it."""
    u = np.clip(x / radius, -1.0, 1.0)
    return 0.5 + (u * np.sqrt(1 - u**2) + np.arcsin(u)) / np.pi


@pytest.mark.parametrize(
    ("nearer_m", "focus_m"),
    [*(pytest.param(*p, marks=pytest.mark.slow) for p in PLACES[:3]), *PLACES[3:]],
)
@pytest.mark.parametrize("rays", [16, pytest.param(64, marks=pytest.mark.slow)])
def test_edge(run_block: Callable[..., Run], nearer_m: float, focus_m: Any, rays: int) -> None:
    """A black half plane, 0.4 mm thick, with an aperture of 62.5 mm."""
    lens = {**LENS, "focus_m": focus_m}
    run = seen(
        run_block,
        (0.08, 0.0004, 0.08),
        filled=np.array([1.0, 0.0]).reshape(2, 1, 1),
        nearer_m=nearer_m,
        camera={"rays_per_pixel": rays, "lens": lens, "sensor": WIDE},
    )
    radius = blur_m(run.scene.camera, nearer_m)
    assert (radius < 1e-12) == (nearer_m == 0.04 and focus_m == 1.04)
    # Places in the target plane are seen smaller in the block's.
    fine = (np.arange(32 * PIXELS) + 0.5) / 32 * PITCH - FIELD / 2
    profile = beyond_edge(fine, max(radius, 1e-12)).reshape(PIXELS, 32).mean(axis=1)
    got = run.weights.background.astype(float)
    # A profile by n rays on the plane and on the disc: steps of 1 / n and a discrepancy of
    # n^-5/8, of which an edge sees the one of its direction.
    within = 0.6 * rays ** (-5 / 8)
    np.testing.assert_allclose(got, np.broadcast_to(profile, got.shape), atol=within)
    assert np.abs(got.mean(axis=0) - profile).mean() < within / 4


@pytest.mark.parametrize(("nearer_m", "focus_m"), PLACES)
def test_point(run_block: Callable[..., Run], nearer_m: float, focus_m: Any) -> None:
    """A black square of 4 x 4 cells: its light is kept, in a disc of the right radius."""
    size_m = 0.2 / 128
    lens = {**LENS, "focus_m": focus_m}
    run = seen(
        run_block,
        (size_m, size_m / 4, size_m),
        nearer_m=nearer_m,
        camera={"rays_per_pixel": 64, "lens": lens, "sensor": WIDE},
    )
    dark = 1.0 - run.weights.background.astype(float)
    radius = blur_m(run.scene.camera, nearer_m)
    magnified = DISTANCE / (DISTANCE + nearer_m)
    # 64 rays count whole pixels, of which the square has six in a row.
    assert dark.sum() * PITCH**2 == pytest.approx((magnified * size_m) ** 2, rel=0.03)
    place = (np.arange(PIXELS) + 0.5) * PITCH - FIELD / 2
    along = np.hypot(*np.meshgrid(place, place))
    reach = radius + magnified * size_m / 2**0.5 + PITCH / 2**0.5
    assert np.all(dark[along > 1.03 * reach] == 0.0)
    for across in (dark.sum(axis=0), dark.sum(axis=1)):
        assert (across @ place) / across.sum() == pytest.approx(0.0, abs=0.15 * PITCH)
        variance = radius**2 / 4 + (magnified * size_m) ** 2 / 12 + PITCH**2 / 12
        # Sheppard's correction does not hold for edges in focus, which lie on those of pixels.
        sharp = PITCH**2 / 6 if radius < PITCH else 0.0
        got = (across @ place**2) / across.sum()
        assert got == pytest.approx(variance, abs=0.03 * variance + sharp)


def test_small_apertures_are_a_pinhole(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """50 nm moves rays by 1e-9 m, so only rays that touch an edge may differ from a pinhole's."""

    def image() -> np.ndarray:
        camera = {"rays_per_pixel": 16, "lens": {"diffraction": False}}
        run = seen(run_block, (0.004,) * 3, nearer_m=0.05, camera=camera)
        return run.weights.background.astype(float)

    large = image()
    monkeypatch.setattr(Camera, "aperture_m", 5e-8)
    small = image()
    monkeypatch.setattr(Camera, "aperture_m", 0.0)
    pinhole = image()
    # A rounded corner or two: each ray counts a 16th.
    assert np.count_nonzero(np.abs(small - pinhole) > 1e-6) <= 2
    assert np.count_nonzero(np.abs(large - pinhole) > 1 / 32) > 100


@pytest.mark.slow
def test_lens_is_the_mean_of_pinholes(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four points of the aperture, against whole solutions for cameras in their places.

    These have sources to their own place. The light of a scattering block to the lens' middle, in
    their stead, differs in the second order of 2 degrees.
    """
    shift = 40  # pixels
    at_m = shift * 0.04 / 48
    points = [(right, up) for right in (-1, 1) for up in (-1, 1)]
    block = {
        "droplet_absorption_per_m": 40.0,
        "droplet_scattering_per_m": 60.0,
        "droplet_temperature_K": 350.0,
    }
    common: dict[str, Any] = {
        "size_m": (0.015, 0.012, 0.018),
        "domain": {"edge_m": 0.1, "leaf_edge_m": 0.1 / 30},
        "background": {"radius_m": 0.02, "temperatures_K": [400.0, 500.0]},
        "transport": {"phase": {"henyey_greenstein": 0.8}, "accuracy_K": 0.3},
    }

    def image(columns: int, field_m: float, **camera: Any) -> dict[str, np.ndarray]:
        run = run_block(
            block,
            camera={"pixels": columns, "field_m": [field_m, field_m], **camera},
            **common,
        )
        return {name: each.astype(float) for name, each in run.weights.images.items()}

    wide, field_m = 48 + 2 * shift, 0.04 * (48 + 2 * shift) / 48
    expected: dict[str, np.ndarray] = {}
    for right, up in points:
        there = image(wide, field_m, target_m=[right * at_m, 0.01, up * at_m], rays_per_pixel=1)
        first, down = shift - right * shift, shift + up * shift
        for name, one in there.items():
            part = one[down : down + 48, first : first + 48] / len(points)
            expected[name] = expected.get(name, 0.0) + part

    def places(view: View, across: int) -> np.ndarray:
        if across == 1:
            return np.array([[0.5, 0.5, 0.0, 0.0]])
        cells = shift * np.array(points) * view.pitch
        return np.hstack([np.full((4, 2), 0.5), cells])

    monkeypatch.setattr(View, "places", places)
    got = image(48, 0.04, target_m=[0.0, 0.01, 0.0], rays_per_pixel=4, lens={"diffraction": False})
    total = sum(got[name] for name in ("background", "wall"))
    assert np.all(total <= 1.0 + 1e-6)
    for name, one in expected.items():
        scale = max(float(one.max()), 1.0)
        assert np.abs(got[name] - one).max() < 0.02 * scale, name
        assert np.abs(got[name] - one).mean() < 0.003 * scale, name


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"model": "orthographic"}, r"lens: given with model orthographic; allowed: model pinhole"),
        ({"rays_per_pixel": 1}, r"rays_per_pixel: 1 with a lens; allowed: auto, 4, 16 or 64"),
        ({"lens": {"f_number": 2.5}}, r"camera\.lens: f_number: no key .*camera\.sensor\.f_number"),
    ],
)
def test_refused(run_block: Callable[..., Run], camera: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        seen(run_block, (0.01,) * 3, nearer_m=0.0, camera={"lens": {}, **camera})


def test_only_source_has_a_lens(run_block: Callable[..., Run]) -> None:
    with pytest.raises(TransportError, match=r"camera\.lens: given with method path"):
        run_block(
            {"droplet_scattering_per_m": 10.0},
            size_m=(0.1,) * 3,
            domain={"edge_m": 0.2, "leaf_edge_m": 0.02},
            camera={"pixels": 4, "lens": {}},
            transport={"method": "path"},
        )


@pytest.mark.slow
def test_stated_effect_of_a_lens(device: Device, tables: Path) -> None:
    """The change that a pinhole's run states, against a run with the lens.

    The estimate blurs the pinhole's image by the discs of all depths alike, which moves a square by
    up to a third where one side of the spray is nearer.
    """
    scene = cldit.load_scene("gdi-cone").with_(
        **{
            "camera.pixels": [100, 100],
            "camera.field_m": [0.12, 0.12],
            "camera.target_m": None,
            "camera.sensor.f_number": 1.5,
            "transport.accuracy_K": 3.0,
            "transport.order": 0,
        }
    )
    lenses: tuple[Any, ...] = (None, {})
    pinhole, lens = (
        cldit.simulate(scene.with_(**{"camera.lens": one}), device=device, cache=tables)
        for one in lenses
    )
    assert pinhole.errors is not None and lens.errors is not None
    (stated,) = (one for one in pinhole.errors.model if one.name == "lens")
    assert not [one for one in lens.errors.model if one.name == "lens"]
    both = pinhole.maps.has_temperature & lens.maps.has_temperature
    apart = lens.maps.apparent_temperature_K - pinhole.maps.apparent_temperature_K
    rms_K = float(np.sqrt(np.mean(apart[both].astype(float) ** 2)))
    assert stated.error_K == pytest.approx(rms_K, rel=0.3)
    assert rms_K > 0.3
    assert "f/1.5" in stated.how
