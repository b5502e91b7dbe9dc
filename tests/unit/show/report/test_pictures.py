"""Colours of the maps by hand, default ranges, and PNGs whose pixels are looked at."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray

from cldit.dit.maps import Maps, Reason
from cldit.radiance.weights import Weights
from cldit.show.figures.colours import (
    UNKNOWN,
    emissivity_scale,
    map_colours,
    pixel_colours,
    temperature_range_K,
)
from cldit.show.figures.maps import (
    Shares,
    camera_pngs,
    errors_panels,
    map_png,
    weights_panels,
)
from cldit.show.figures.panels import Frame, Panel, panels_png, robust_limits

FRAME = Frame((1e-3, 1e-3))


def _maps(emissivity: NDArray[np.floating], temperature_K: NDArray[np.floating]) -> Maps:
    known = np.isfinite(temperature_K)
    return Maps(
        emissivity=emissivity.astype(np.float32),
        apparent_temperature_K=temperature_K.astype(np.float32),
        emissivity_standard_error=np.full(emissivity.shape, 0.01, np.float32),
        apparent_temperature_standard_error_K=np.where(known, 2.0, np.nan).astype(np.float32),
        reason=np.where(known, Reason.OK, Reason.BACKGROUND_NOT_VISIBLE).astype(np.uint8),
        reduced_chi2=np.ones(emissivity.shape, np.float32),
        fit_probability=np.full(emissivity.shape, 0.5, np.float32),
    )


def _pixels(png: bytes) -> NDArray[np.float64]:
    return np.asarray(imread(io.BytesIO(png), format="png"), dtype=np.float64)[..., :3]


def _has(picture: NDArray[np.float64], colour: tuple[float, float, float]) -> int:
    """Number of pixels of this colour, to an 8-bit step."""
    return int(np.count_nonzero(np.all(np.abs(picture - colour) < 1.1 / 255, axis=-1)))


def test_colours_by_hand() -> None:
    got = map_colours(
        np.array([1.0, 1.0, 1.0, 0.0, 0.5, 2.0, 1.0]),
        np.array([300.0, 400.0, 500.0, 500.0, 500.0, 900.0, np.nan]),
        range_K=(300.0, 500.0),
        scale=1.0,
    )
    blue, green, red, white = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    expected = np.array([blue, green, red, white, (1.0, 0.5, 0.5), red, white])
    np.testing.assert_allclose(got, expected, atol=1e-12)
    half = map_colours(np.array([0.15]), np.array([500.0]), range_K=(300, 500), scale=0.3)
    np.testing.assert_allclose(half, [[1, 0.5, 0.5]], atol=1e-12)


def test_unknown_is_grey_and_transparent_is_white() -> None:
    maps = _maps(np.array([[0.9, np.nan, 0.0]]), np.array([[400.0, np.nan, np.nan]]))
    maps.reason[0, 2] = Reason.EMISSIVITY_TOO_LOW
    got = pixel_colours(maps, range_K=(300, 400), scale=0.9)
    expected = np.array([(1.0, 0.0, 0.0), (UNKNOWN,) * 3, (1.0, 1.0, 1.0)])
    np.testing.assert_allclose(got[0], expected, atol=1e-6)


def test_default_range() -> None:
    temperature = np.linspace(400.0, 500.0, 1000).reshape(20, 50)
    emissivity = np.full((20, 50), 0.9)
    assert temperature_range_K(_maps(emissivity, temperature)) == (400.0, 500.0)
    # Faint pixels at absurd temperatures, and NaN, have no say.
    temperature[0], emissivity[0] = 3000.0, 0.02
    temperature[1], emissivity[1] = np.nan, np.nan
    low, high = temperature_range_K(_maps(emissivity, temperature))
    assert 400.0 <= low <= 415.0 and high == 500.0
    # Nothing but faint pixels: they count.
    faint = _maps(np.full((1, 9), 0.01), np.full((1, 9), 333.0))
    assert temperature_range_K(faint) == (330.0, 335.0)
    one = _maps(np.full((1, 9), 1.0), np.full((1, 9), 330.0))
    assert temperature_range_K(one) == (330.0, 335.0)
    none = _maps(np.full((1, 9), np.nan), np.full((1, 9), np.nan))
    assert temperature_range_K(none) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("most", "scale"),
    [(0.97, 1.0), (0.3, 0.3), (0.31, 0.5), (0.6, 1.0), (0.012, 0.02), (1.7, 1.0), (1e-9, 1e-3)],
)
def test_default_scale(most: float, scale: float) -> None:
    maps = _maps(np.full((3, 3), most), np.full((3, 3), 400.0))
    assert emissivity_scale(maps) == pytest.approx(scale)  # 0.3 although float32 has 0.30000001


def test_map_picture_shows_the_colours() -> None:
    """The left half hot and opaque, the right half out of sight: red and grey, equally large."""
    temperature = np.full((40, 40), np.nan)
    temperature[:, :20] = 500.0
    maps = _maps(np.where(np.isfinite(temperature), 1.0, np.nan), temperature)
    picture = _pixels(
        map_png(maps, Frame((1e-3, 1e-3), (0.0, 0.5)), title="t", range_K=(300, 500), scale=1)
    )
    red, grey = _has(picture, (1, 0, 0)), _has(picture, (UNKNOWN,) * 3)
    assert red > 10_000
    assert red == pytest.approx(grey, rel=0.05)  # ticks, key
    # and the key has the other end
    assert _has(picture, (0, 0, 1)) > 0


def test_up_is_up() -> None:
    """Row 0 is at the top, and the extent is centred where the frame says."""
    temperature = np.full((40, 40), 300.0)
    temperature[:10] = 500.0
    maps = _maps(np.ones((40, 40)), temperature)
    frame = Frame((1e-3, 1e-3), (0.01, -0.5))
    picture = _pixels(map_png(maps, frame, title="t", range_K=(300, 500), scale=1))
    left = picture[:, : picture.shape[1] // 2]
    red = np.nonzero(np.all(left == (1, 0, 0), axis=-1))[0]
    blue = np.nonzero(np.all(left == (0, 0, 1), axis=-1))[0]
    assert red.max() < blue.min()
    assert frame.extent_mm((40, 40)) == pytest.approx((-10.0, 30.0, -520.0, -480.0))


def test_user_text_is_no_formula() -> None:
    """An unbalanced `$` or a bad formula in a scene's name must not stop the picture."""
    maps = _maps(np.ones((4, 4)), np.full((4, 4), 400.0))
    for title in (r"$\frac{", "5 $ a $^$ shot", ""):
        assert map_png(maps, FRAME, title=title).startswith(b"\x89PNG")


def test_pictures_of_nothing() -> None:
    """All NaN, all equal, one pixel, very wide: still a picture, and no warning."""
    nan = np.full((3, 3), np.nan)
    nothing = _maps(nan, nan)
    assert map_png(nothing, FRAME, title="nothing").startswith(b"\x89PNG")
    assert panels_png(errors_panels(nothing), FRAME, title="nothing").startswith(b"\x89PNG")
    exact = replace(
        nothing,
        emissivity_standard_error=np.zeros((3, 3), np.float32),
        apparent_temperature_standard_error_K=np.zeros((3, 3), np.float32),
    )
    assert panels_png(errors_panels(exact), FRAME, title="exact").startswith(b"\x89PNG")
    for shape in ((1, 1), (2, 200), (200, 2)):
        image = np.zeros(shape, np.uint16)
        both = camera_pngs({400.0: image, 450.0: image + 1}, FRAME, title="t")
        assert list(both) == [400.0, 450.0]
        assert all(png.startswith(b"\x89PNG") for png in both.values())
        assert both[400.0] != both[450.0]
    assert camera_pngs({}, FRAME, title="t") == {}
    assert robust_limits(np.array([])) == (0.0, 1.0)
    assert robust_limits(np.array([np.nan, 5.0]))[0] == 5.0
    low, high = robust_limits(np.append(np.full(99_999, 7.0), 1e9))
    assert (low, round(high)) == (7.0, 7)


def test_weights_and_panels() -> None:
    zero = np.zeros((10, 10), np.float32)
    weights = Weights(zero + 1, zero, zero, zero)
    assert panels_png(weights_panels(weights), FRAME, title="w").startswith(b"\x89PNG")
    # Three panels leave the fourth place blank.
    panels = [Panel(zero + n, f"{n}", "1", (0.0, 2.0), "gray") for n in range(3)]
    picture = _pixels(panels_png(panels, FRAME, title="p"))
    assert _has(picture, (0, 0, 0)) > 10_000
    corner = picture[picture.shape[0] * 3 // 4, picture.shape[1] * 3 // 4]
    np.testing.assert_array_equal(corner, [1, 1, 1])


def test_shares() -> None:
    """Shares of one pixel by hand; they add up; what is untouched does not count."""
    image = [np.array([[value, clear]], np.float32) for value, clear in
             ((0.5, 1.0), (0.1, 0.0), (30.0, 0.0), (10.0, 0.0))]  # fmt: skip
    zero = np.zeros((1, 2), np.float32)
    empty = Weights(zero + 1, zero, zero, zero)
    shares = Shares.of(Weights(*image), empty, background=100.0, wall=100.0)
    expected = {"background": 0.5, "walls": 0.1, "vapour": 0.3, "droplets": 0.1}
    assert shares.means() == pytest.approx(expected)
    assert shares.where.tolist() == [[True, False]]
    assert panels_png(shares.panels(), FRAME, title="s").startswith(b"\x89PNG")
    nothing = Shares.of(empty, empty, background=0.0, wall=0.0)
    assert nothing.means() == {}
    assert np.isnan(nothing.images["vapour"]).all()
