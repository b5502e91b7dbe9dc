"""The point spread of a lens on images, against integrals of its own definition."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml
from scipy.special import erf, j1

import cldit
from cldit.errors import SceneError
from cldit.radiance.point_spread import PointSpread, airy
from cldit.scene import Scene

FIELD_M, PIXELS = 0.04, 160
PITCH_M = FIELD_M / PIXELS
WAVELENGTH_M = 3.4e-6


def scene(*, f_number: float = 2.5, **lens: Any) -> Scene:
    camera = {"field_m": [FIELD_M, FIELD_M], "pixels": PIXELS, "lens": lens}
    return cldit.Scene.from_dict(
        {
            "name": "lens",
            "spray": {"model": "none"},
            "camera": {**camera, "sensor": {"f_number": f_number}},
            "optics": {"filter_um": [3.39, 3.41]},
        }
    )


def magnification() -> float:
    """Length on the sensor over that on the target."""
    camera = scene().camera
    return camera.sensor.pitch_m / camera.pixel_m


def test_light_is_kept() -> None:
    """Even images stay, the sum of every image stays, and no weight becomes negative."""
    rng = np.random.default_rng(2)
    spread = PointSpread.of(scene(f_number=8.0, spread_m=20e-6))
    even = np.full((PIXELS, PIXELS), 0.7, np.float32)
    np.testing.assert_allclose(spread.image(even), even, rtol=1e-6)
    sharp = (rng.random((PIXELS, PIXELS)) < 0.02).astype(np.float32)
    sharp[0, 0] = sharp[-1, 5] = 1.0
    blurred = spread.image(sharp).astype(float)
    assert blurred.sum() == pytest.approx(float(sharp.sum()), rel=1e-6)
    assert blurred.min() > -1e-7 and blurred.max() < 0.9


@pytest.mark.parametrize("sigma_px", [0.25, 0.7, 2.0])
def test_gaussian(sigma_px: float) -> None:
    """A point's image has the variance, and an edge is the error function."""
    sigma_m = sigma_px * PITCH_M
    spread = PointSpread.of(scene(diffraction=False, spread_m=sigma_m * magnification()))
    point = np.zeros((PIXELS, PIXELS), np.float32)
    point[80, 80] = 1.0
    image = spread.image(point).astype(float)
    place = (np.arange(PIXELS) - 80) * PITCH_M
    assert image.min() > -1e-7
    wider = 0.15 * PITCH_M**2 if sigma_px < 0.5 else 0.05 * sigma_m**2  # no weights below 0
    for across in (image.sum(axis=0), image.sum(axis=1)):
        assert across @ place**2 == pytest.approx(sigma_m**2, abs=wider)
    edge = np.broadcast_to(np.where(place > 0, 1.0, 0.0), point.shape).astype(np.float32)
    fine = ((np.arange(32 * PIXELS) + 0.5) / 32 - 80.5) * PITCH_M
    expected = 0.5 + 0.5 * erf((fine - 0.5 * PITCH_M) / (sigma_m * 2**0.5))
    expected = expected.reshape(PIXELS, 32).mean(axis=1)
    inner = slice(20, 140)  # the image is mirrored at its sides
    # An edge between pixels has most of its light above their Nyquist frequency.
    got = spread.image(edge)[80].astype(float)
    np.testing.assert_allclose(got[inner], expected[inner], atol=0.05 if sigma_px < 1 else 0.006)
    assert got.min() > -1e-7 and got.max() < 1.0 + 1e-6


def test_diffraction_at_an_edge() -> None:
    """Against the Airy pattern itself, integrated along the edge and over pixels."""
    spread = PointSpread.of(scene(f_number=40.0))
    camera = spread.camera
    first_m = 1.22 * WAVELENGTH_M * camera.distance_m / camera.aperture_m  # dark ring
    scale = np.pi * camera.aperture_m / (WAVELENGTH_M * camera.distance_m)
    place = np.arange(PIXELS) * PITCH_M
    edge = np.broadcast_to(np.where(place > 79.6 * PITCH_M, 1.0, 0.0), (PIXELS, PIXELS))
    got = spread.image(edge.astype(np.float32))[80].astype(float)
    step = first_m / 30
    axis, along = np.arange(-3000, 3001) * step, np.arange(0.5, 6000.0) * step
    line = np.empty(len(axis))
    for number, x in enumerate(axis):
        v = scale * np.hypot(x, along)
        line[number] = np.sum((2 * j1(v) / v) ** 2)
    beyond = np.cumsum(line) - 0.5 * line
    beyond /= np.sum(line)
    fine = ((np.arange(32 * PIXELS) + 0.5) / 32 - 80.0) * PITCH_M
    expected = np.interp(fine, axis, beyond).reshape(PIXELS, 32).mean(axis=1)
    # The first dark ring is some pixels away; 1 % of the light is beyond the 100 that are summed.
    assert 1.5 < first_m / PITCH_M < 5.0
    np.testing.assert_allclose(got[60:100], expected[60:100], atol=0.02)


def test_given_mtf() -> None:
    """A table of an aperture's MTF gives it back at its place on the sensor; factors multiply."""
    cutoff_per_mm = 40.0
    table = [(f, float(airy(np.array(f / cutoff_per_mm)))) for f in np.linspace(0, 60, 600)]
    at_per_mm = np.linspace(0.0, 50.0, 7)
    at_per_m = 1e3 * at_per_mm * magnification()  # on the target
    given = PointSpread.of(scene(diffraction=False, mtf=table)).mtf(at_per_m)
    np.testing.assert_allclose(given, airy(at_per_mm / cutoff_per_mm), atol=1e-4)
    one = PointSpread.of(scene()).mtf(at_per_m)
    both = PointSpread.of(scene(mtf=table)).mtf(at_per_m)
    np.testing.assert_allclose(both, one * given, atol=1e-12)
    # Cut-off on the sensor: 1 / (wavelength times the image's distance over the aperture).
    camera = scene().camera
    image_m = camera.distance_m * magnification()
    cutoff = camera.aperture_m / image_m / WAVELENGTH_M
    expected = airy(1e3 * at_per_mm / cutoff)
    np.testing.assert_allclose(one, expected, atol=1e-3)


def gauss(sigma: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """81 x 81 samples of a Gaussian, of a sum other than 1."""
    line = np.exp(-0.5 * (np.arange(-40, 41) / sigma) ** 2)
    return 1e3 * np.outer(line, line)


def test_samples_of_a_gaussian_blur_as_its_mtf(tmp_path: Path) -> None:
    """1.7 traced pixels; linear between samples 10 um apart adds 1/600 to the variance."""
    samples = gauss(10.0)
    np.savetxt(tmp_path / "spread.csv", samples, delimiter=",")
    tifffile.imwrite(tmp_path / "spread.tif", samples.astype(np.float32))
    sharp = np.zeros((PIXELS, PIXELS), np.float32)
    sharp[30:90, 70:] = sharp[120, 40] = 1.0
    expected = PointSpread.of(scene(diffraction=False, spread_m=1e-4)).image(sharp)
    for name in ("spread.csv", "spread.tif"):
        lens: dict[str, Any] = {"point_spread": str(tmp_path / name), "point_spread_pixel_m": 1e-5}
        got = PointSpread.of(scene(diffraction=False, **lens)).image(sharp)
        np.testing.assert_allclose(got, expected, atol=1e-3)
        assert got.sum() == pytest.approx(sharp.sum(), rel=1e-6)
        written = scene(**lens).to_yaml()
        assert cldit.Scene.from_dict(yaml.safe_load(written)) == scene(**lens)
        even = PointSpread.of(scene(**lens)).image(np.full_like(sharp, 0.7))
        np.testing.assert_allclose(even, 0.7, rtol=1e-6)


def test_samples_are_seen_as_in_the_image() -> None:
    """All light two traced pixels to the right and one up, of samples one traced pixel apart."""
    samples = np.zeros((5, 7))
    samples[1, 5] = 3.0
    step_m = PITCH_M * magnification()
    lens: dict[str, Any] = {"point_spread": samples.tolist(), "point_spread_pixel_m": step_m}
    sharp = np.zeros((PIXELS, PIXELS), np.float32)
    sharp[60, 50] = 1.0
    got = PointSpread.of(scene(diffraction=False, **lens)).image(sharp).astype(float)
    rows, columns = np.indices(got.shape)
    assert got.sum() == pytest.approx(1.0, rel=1e-6) and got.min() > -1e-7
    assert got[59, 52] == got.max()
    assert [np.sum(got * rows), np.sum(got * columns)] == pytest.approx([59.0, 52.0], abs=1e-4)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (
            {"point_spread": [[1.0] * 3] * 4},
            r"lens\.point_spread: samples: 4 x 3 samples; allowed: odd",
        ),
        ({"point_spread": [[1.0] * 3] * 3}, r"point_spread_pixel_m: missing with point_spread"),
        ({"point_spread_pixel_m": 1e-5}, r"point_spread: missing with point_spread_pixel_m"),
        (
            {"point_spread": [[1.0, 2.0, -1.0]] * 3},
            r"a sample is -1; allowed: finite numbers from 0",
        ),
        ({"point_spread": [[0.0] * 3] * 3}, r"all samples are 0"),
        ({"point_spread": [[1.0], [1.0, 2.0]]}, r"no table of numbers"),
        ({"point_spread": "nowhere.csv"}, r"lens\.point_spread: .*nowhere\.csv"),
        (
            {"point_spread": [[1.0] * 129] * 3, "point_spread_pixel_m": 1e-3},
            r"0\.537 x 0\.0125 m at the target; allowed: at most the field, 0\.04 x 0\.04 m",
        ),
    ],
)
def test_no_samples(lens: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(**lens)


@pytest.mark.parametrize(
    ("mtf", "message"),
    [
        ([(0.0, 0.9), (10.0, 0.5)], r"camera\.lens\.mtf: .*starts with 0\.9 at 0 1/mm"),
        ([(1.0, 1.0), (10.0, 0.5)], r"starts with 1 at 1 1/mm; allowed: 1 at 0"),
        ([(0.0, 1.0), (10.0, 1.5)], r"value 1\.5 at 10 1/mm is outside 0\.\.1"),
        ([(0.0, 1.0), (-1.0, 0.5)], r"frequency -1 is outside 0\.\.100000 1/mm"),
        ([(0.0, 1.0)], r"1 pairs are no curve"),
    ],
)
def test_refused(mtf: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(mtf=mtf)
