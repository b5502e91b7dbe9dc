"""Every helper function of the kernels, alone, against its NumPy twin in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.scene.vessel import Patch
from cldit.transport.boundary import boundary_seen, patch_rows, sees_disc
from cldit.transport.cells import mean_transmission

from .reference import absorbed

# exp of OpenCL 1.2 full profile is good to 3 ulp, and each sum or product adds half a one; the
# series is cut at t^5/120, 3e-9 of its value at the switch. 8 ulp of float32 bounds both branches,
# but for 1 - exp(-t) just above the switch, where exp's 3 ulp of 1 are 3 ulp / 0.05 of the value.
ULP = float(np.finfo(np.float32).eps)
RAY = ("px", "py", "pz", "dx", "dy", "dz", "start")
DEPTHS = np.concatenate(
    [[0.0], np.logspace(-12, 8, 400), np.nextafter(np.float32(0.05), [0, 1]), [0.05]]
).astype(np.float32)


def test_absorbed(apply: Any) -> None:
    got = apply("attenuation.h", "absorbed(a)", [DEPTHS])
    expected = absorbed(DEPTHS.astype(float))
    np.testing.assert_allclose(got, expected, rtol=4 * ULP / 0.05, atol=0)
    thick = DEPTHS > 0.5
    np.testing.assert_allclose(got[thick], expected[thick], rtol=12 * ULP)


def test_in_double_precision(apply: Any, device: Device) -> None:
    """What is left, and what is absorbed, to a few roundings."""
    if not device.info.float64:
        pytest.skip("the device has no double precision")
    depths = np.concatenate([[0.0], np.logspace(-20, 3, 4001)])
    double = "#define USE_FLOAT64 1"
    got = apply("attenuation.h", "absorbed(a)", [depths], defines=double)
    np.testing.assert_allclose(got, -np.expm1(-depths), rtol=2e-15, atol=0)
    seen = depths < 708
    left = apply("attenuation.h", "decay(a)", [depths], defines=double)
    np.testing.assert_allclose(left[seen], np.exp(-depths[seen]), rtol=1e-15)
    assert np.all(left[~seen] < 1e-300)


def test_mean_transmission(apply: Any) -> None:
    got = apply("attenuation.h", "mean_transmission(a, absorbed(a))", [DEPTHS])
    np.testing.assert_allclose(
        got, mean_transmission(DEPTHS.astype(float)), rtol=5 * ULP / 0.05, atol=0
    )
    assert got[0] == 1.0


def test_attenuation_conserves(apply: Any) -> None:
    """What a ray loses is what its mean deposits, t q(t) = 1 - exp(-t), to rounding."""
    got = apply("attenuation.h", "a * mean_transmission(a, absorbed(a)) - absorbed(a)", [DEPTHS])
    assert np.max(np.abs(got)) <= 2 * ULP


def test_in_map(apply: Any) -> None:
    """Bilinear interpolation, and the map's side beyond it."""
    rng = np.random.default_rng(3)
    side = 5
    map_ = rng.uniform(-0.2, 1.2, side * side).astype(np.float32)
    a, b = rng.uniform(-1.0, side, (2, 2000)).astype(np.float32)
    a[:25], b[:25] = np.tile(np.arange(5), 5), np.repeat(np.arange(5), 5)
    values = np.concatenate([map_, np.zeros(len(a) - len(map_), np.float32)])
    got = apply(
        "blurred_boundary.h", "in_map(c_, a, b)", [a, b, values],
        defines=f"#define BLURRED_BOUNDARY {side}",
    )  # fmt: skip
    places = np.clip([b, a], 0, side - 1).astype(float)
    expected = map_coordinates(map_.reshape(side, side).astype(float), places, order=1)
    np.testing.assert_allclose(got, expected, atol=8 * ULP)


@pytest.mark.parametrize("seed", [1, 2])
def test_sees_background(apply: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    point = rng.uniform(0, 64, (4000, 3)).astype(np.float32)
    toward = rng.normal(size=(4000, 3)).astype(np.float32)
    toward[:40, 1] = 0.0
    centre = np.array([30.0, 70.0, 33.0])
    got = apply(
        "boundary.h",
        "sees_background(a, b, c, d, e, f, (float4)(30.0f, 70.0f, 33.0f, 400.0f))",
        [*point.T, *toward.T],
    )
    expected = sees_disc(point.astype(float), toward.astype(float), centre=centre, radius=20.0)
    s = (70.0 - point[:, 1]) / np.where(toward[:, 1] > 0, toward[:, 1], 1)
    distance = np.hypot(point[:, 0] + s * toward[:, 0] - 30, point[:, 2] + s * toward[:, 2] - 33)
    edge = np.abs(distance - 20.0) < 1e-4 * (1 + np.abs(s))  # float32 may decide either way there
    assert 50 < expected.sum() < 4000
    np.testing.assert_array_equal(got[~edge] > 0.5, expected[~edge])


def test_boundary_seen(apply: Any) -> None:
    """Disc, two patches in its plane and one before it, and walls: the nearest is seen."""
    frame = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=64.0, depth=6)
    patches = patch_rows(
        (
            # The first lies in the disc's plane, over part of it and beside it: the disc is seen.
            _patch("beside", "rectangle", (50, 70, 33), (0, -1, 0), size_m=(36, 20)),
            _patch("under", "disc", (60, 70, 33), (0, -1, 0), radius_m=20),
            _patch("before", "disc", (22, 65, 40), (0.3, -1, 0.2), radius_m=8),
            _patch("wall", "rectangle", (-3, 30, 30), (1, 0, 0), size_m=(30, 50)),
        ),
        frame,
    )
    rng = np.random.default_rng(3)
    point = rng.uniform(8, 56, (20000, 3)).astype(np.float32)
    toward = rng.normal(size=point.shape)
    toward[:14000, 1] = np.abs(toward[:14000, 1]) + 1  # most of them towards the disc
    toward = (toward / np.linalg.norm(toward, axis=1)[:, None]).astype(np.float32)
    rows = ", ".join(
        f"(float4)({', '.join(f'{x:.9e}f' for x in row)})" for row in patches.reshape(-1, 4)
    )
    got = apply(
        "boundary.h",
        "boundary_seen(a, b, c, d, e, f, g, &boundary)",
        [*point.T, *toward.T, np.zeros(len(point), np.float32)],
        defines=f"#define N_PATCHES 4\n__constant float4 rows_[] = {{{rows}}};",
        setup="const Boundary boundary = {(float4)(30.0f, 70.0f, 33.0f, 400.0f), rows_};",
    )
    centre = np.array([30.0, 70.0, 33.0])
    expected = boundary_seen(
        point.astype(float), toward.astype(float), centre=centre, radius=20.0, patches=patches
    )
    assert np.all(np.bincount(expected, minlength=6) > 200)
    # Single precision may decide otherwise at an edge: 1e-5 of a size, so of 1e-4 of the lines.
    assert np.mean(got != expected) < 5e-4
    nearer = boundary_seen(
        point.astype(float),
        toward.astype(float),
        centre=centre,
        radius=20.0,
        patches=patches,
        start=1000.0,
    )
    assert set(nearer) == {0, 1}  # the disc has no near side; patches do


def _patch(name: str, shape: str, centre: Any, facing: Any, **size: Any) -> Patch:
    return Patch.model_validate(
        {
            "name": name,
            "shape": shape,
            "centre_m": centre,
            "facing": facing,
            "temperature_K": 300.0,
            **size,
        }
    )


def test_enclosure_is_seen_everywhere(apply: Any) -> None:
    got = apply(
        "boundary.h",
        "sees_background(a, a, a, -a, -a, a, (float4)(0.0f, 0.0f, 0.0f, INFINITY))",
        [np.ones(8, np.float32)],
    )
    assert np.all(got == 1.0)


def test_pinhole_rays(apply: Any) -> None:
    """Pixel centres, row 0 on top, all lines through the camera's place."""
    columns, rows, distance = 8, 6, 100.0
    row, column = np.divmod(np.arange(columns * rows), columns)
    call = "pixel_ray((int)a, (int)b, 8, 6, (float4)(1.0f, 2.0f, 3.0f, 1.0f), 2.0f, 4.0f, 100.0f)"
    got = apply(
        "ray.h",
        [f"{call}.{name}" for name in RAY],
        [column.astype(np.float32), row.astype(np.float32)],
    )
    fields = dict(zip(RAY, got.astype(float), strict=True))
    np.testing.assert_allclose(fields["px"], 1 + (column + 0.5 - 4) * 2, atol=1e-5)
    np.testing.assert_allclose(fields["pz"], 3 + (3 - row - 0.5) * 4, atol=1e-5)
    norm = fields["dx"] ** 2 + fields["dy"] ** 2 + fields["dz"] ** 2
    np.testing.assert_allclose(norm, 1.0, atol=4 * ULP)
    for axis, place in (("x", 1.0), ("y", 2.0 - distance), ("z", 3.0)):
        camera = fields[f"p{axis}"] + fields["start"] * fields[f"d{axis}"]
        np.testing.assert_allclose(camera, place, atol=8 * ULP * distance)


def test_rays_through_points_of_the_lens(apply: Any) -> None:
    """Rays cross the target plane at the same place, and the lens' plane at the point given."""
    rng = np.random.default_rng(3)
    across, down = rng.uniform(-1.0, 8.0, (2, 60)).astype(np.float32)
    lens_x, lens_z = rng.uniform(-5.0, 5.0, (2, 60)).astype(np.float32)
    camera = "8, 6, (float4)(1.0f, 2.0f, 3.0f, 1.0f), 2.0f, 4.0f, 100.0f"
    got = apply(
        "ray.h",
        [f"ray_at(a, b, c, d, {camera}).{name}" for name in RAY],
        [across, down, lens_x, lens_z],
    )
    fields = dict(zip(RAY, got.astype(float), strict=True))
    place = np.array([1.0 + (across - 4.0) * 2.0, np.full(60, 2.0), 3.0 + (3.0 - down) * 4.0])
    lens = np.array([1.0 + lens_x, np.full(60, -98.0), 3.0 + lens_z])
    along = (place - lens) / np.linalg.norm(place - lens, axis=0)
    for number, axis in enumerate("xyz"):
        np.testing.assert_allclose(fields[f"p{axis}"], place[number], atol=1e-5)
        np.testing.assert_allclose(fields[f"d{axis}"], along[number], atol=4 * ULP)
        at_lens = fields[f"p{axis}"] + fields["start"] * fields[f"d{axis}"]
        np.testing.assert_allclose(at_lens, lens[number], atol=16 * ULP * 100.0)


def test_orthographic_rays(apply: Any) -> None:
    call = "pixel_ray((int)a, 0, 4, 1, (float4)(0.0f), 1.0f, 1.0f, 50.0f)"
    column = np.arange(4, dtype=np.float32)
    expected = {"dx": 0.0, "dy": 1.0, "dz": 0.0, "start": -50.0}
    calls = [f"{call}.{name}" for name in expected]
    got = apply("ray.h", calls, [column])
    np.testing.assert_array_equal(got, np.tile([*expected.values()], (4, 1)).T)


def test_what_is_seen_at_a_height_is_1_on_average(apply: Any) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(60)
    y = ((nodes + 1) / 2).astype(np.float32)
    for depth in (1e-4, 0.3, 4.0):
        even = 1 / mean_transmission(np.full(len(y), depth))
        got = apply("view_phase.h", "seen_at(a, b, c)", [y, np.full_like(y, depth), even])
        assert np.sum(weights * got) / 2 == pytest.approx(1.0, abs=20 * ULP)


def test_phase_towards_the_camera(apply: Any) -> None:
    """The bin of the sine of half the angle between the light's way and that to the camera."""
    rng = np.random.default_rng(4)
    place = rng.uniform(1.0, 9.0, (40, 3)).astype(np.float32)
    back = rng.normal(size=(40, 3))
    back = (back / np.linalg.norm(back, axis=1)[:, None]).astype(np.float32)
    got = apply(
        "view_phase.h",
        "sqrt((float)phase_bin_of(a, b, c, (float4)(d, e, f, 0), (float4)(0, -20, 0, 1)))",
        [*place.T, *back.T],
        defines="#define PHASE_STEPS 64",
    )
    along = place.astype(float) + np.array([0.0, 20.0, 0.0])
    along /= np.linalg.norm(along, axis=1)[:, None]
    sine = np.sqrt((1 - (along * back).sum(1)) / 2)
    np.testing.assert_allclose(got**2, np.floor(sine * 64), atol=1e-3)
