"""Imaging by area: means are kept, a ramp stays a ramp, the footprint is centred."""

import numpy as np
import pytest

from cldit.camera.view import SensorView
from cldit.errors import TransportError
from cldit.scene.camera import Camera, Sensor
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray


def _view(
    pixels: tuple[int, int] = (640, 512), field_m: tuple[float, float] = (0.16, 0.16)
) -> SensorView:
    return SensorView(field_m=field_m, centre_m=(0.0, 0.0), pixels=pixels)


def test_footprint_is_the_largest_rectangle() -> None:
    assert _view().pixel_m == (0.16 / 640, 0.16 / 640)  # the width limits
    assert _view(field_m=(0.16, 0.064)).pixel_m == (0.064 / 512, 0.064 / 512)
    assert _view(pixels=(10, 40)).pixel_m == (0.16 / 40, 0.16 / 40)


@pytest.mark.parametrize("traced", [(1000, 1000), (333, 77), (1, 1), (512, 640), (40, 3000)])
def test_constant_and_ramp_are_exact(traced: tuple[int, int]) -> None:
    """A sampled ramp is a staircase; its area means are differences of its integral."""
    view = _view(pixels=(64, 48))
    columns = traced[1]
    flat = view.image(np.full(traced, 7.25))
    np.testing.assert_allclose(flat, 7.25, rtol=1e-14)
    steps = np.arange(columns) + 0.5
    ramp = np.broadcast_to(steps, traced)
    edges = columns * np.arange(65) / 64  # the width is used whole
    staircase = np.concatenate([[0.0], np.cumsum(steps)])  # its integral, linear in between
    integral = np.interp(edges, np.arange(columns + 1), staircase)
    expected = np.diff(integral) / np.diff(edges)
    np.testing.assert_allclose(view.image(ramp), np.broadcast_to(expected, (48, 64)), rtol=1e-12)


def test_centred() -> None:
    """A picture that is even about its middle has an even image; one point stays in its place."""
    traced = np.zeros((101, 101))
    traced[50, 50] = 1.0
    got = _view(pixels=(25, 21)).image(traced)
    np.testing.assert_allclose(got, got[::-1, ::-1], atol=1e-15)
    assert np.argmax(got) == 10 * 25 + 12
    traced = np.zeros((100, 100))
    traced[12, 90] = 1.0  # up and to the right
    assert np.argmax(_view(pixels=(10, 8)).image(traced)) == 9  # row 0, last column


def test_nan_spreads_only_where_it_lies() -> None:
    traced = np.ones((80, 80))
    traced[0, 0] = np.nan
    got = _view(pixels=(20, 20)).image(traced)
    assert np.isnan(got).sum() == 1 and np.isnan(got[0, 0])


def test_from_scene_and_refusals() -> None:
    camera = Camera(sensor=Sensor(pixels=(32, 16)), target_m=(0.01, 0.0, -0.03))
    view = SensorView.from_scene(Scene(name="t", spray=EmptySpray(), camera=camera))
    assert view.centre_m == (0.01, -0.03) and view.pixel_m == (0.005, 0.005)
    for shape in ((0, 3), (3,), (2, 2, 2)):
        with pytest.raises(TransportError, match="traced image"):
            view.image(np.zeros(shape))
