"""Colours, default ranges, windows, and figures whose pixels and texts are looked at."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.image import imread
from numpy.typing import NDArray
from PIL import Image

from cldit.dit.maps import Maps, Reason
from cldit.errors import FileError
from cldit.radiance.weights import Weights
from cldit.show.figures.colours import (
    UNKNOWN,
    Scale,
    emissivity_scale,
    robust_limits,
    temperature_range_K,
)
from cldit.show.figures.maps import (
    camera_figures,
    errors_panels,
    map_figure,
    shares_of_light,
    weights_panels,
)
from cldit.show.figures.panels import ImageFrame, Panel, panels_figure, window_around
from cldit.show.figures.style import DPI, WIDTH_IN, png_of, write_figure

FRAME = ImageFrame((1e-3, 1e-3))


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
        error_correlation=np.zeros(emissivity.shape, np.float32),
    )


def _pixels(png: bytes) -> NDArray[np.float64]:
    return np.asarray(imread(io.BytesIO(png), format="png"), dtype=np.float64)[..., :3]


def _has(picture: NDArray[np.float64], colour: tuple[float, ...]) -> int:
    """Number of pixels of this colour, to an 8-bit step."""
    return int(np.count_nonzero(np.all(np.abs(picture - colour[:3]) < 1.1 / 255, axis=-1)))


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
    assert Scale.of([one, none, faint]).range_K == (330.0, 335.0)
    assert Scale.of([none]).range_K == (0.0, 0.0)


@pytest.mark.parametrize(
    ("most", "scale"),
    [(0.97, 1.0), (0.3, 0.3), (0.31, 0.5), (0.6, 1.0), (0.012, 0.02), (1.7, 1.0), (1e-9, 1e-3)],
)
def test_default_scale(most: float, scale: float) -> None:
    maps = _maps(np.full((3, 3), most), np.full((3, 3), 400.0))
    assert emissivity_scale(maps) == pytest.approx(scale)  # 0.3 although float32 has 0.30000001


def test_window_is_the_spray() -> None:
    """20 x 30 mm of spray below the tip in a field of 200 mm; stray pixels do not count."""
    weight = np.zeros((200, 200))
    weight[102:130, 90:110] = 1.0  # z from -2 to -30 mm
    weight[5, 5] = 0.5  # 0.09 % of it
    left, right, bottom, top = window_around(weight, FRAME)
    assert -15 <= left <= -11 and 11 <= right <= 15
    assert -35 <= bottom <= -31 and 0 < top <= 5
    # a line gets a width; nothing gets the whole image
    narrow = np.zeros((200, 200))
    narrow[100:180, 99:101] = 1.0
    left, right, bottom, top = window_around(narrow, FRAME)
    assert right - left >= 0.4 * (top - bottom)
    assert window_around(np.zeros((200, 200)), FRAME) == FRAME.extent_mm((200, 200))
    assert window_around(np.ones((200, 200)), FRAME) == FRAME.extent_mm((200, 200))


def test_map_picture_shows_the_colours() -> None:
    """The left half hot and opaque, the right half out of sight: yellow and grey, equally large."""
    temperature = np.full((40, 40), np.nan)
    temperature[:, :20] = 500.0
    maps = _maps(np.where(np.isfinite(temperature), 1.0, np.nan), temperature)
    window = FRAME.extent_mm((40, 40))
    figure = map_figure(maps, FRAME, title="t", vmin=300, vmax=500, scale=1, window=window)
    picture = _pixels(png_of(figure))[:, : int(2.9 * DPI)]
    hot, grey = _has(picture, colormaps["plasma"](1.0)), _has(picture, (UNKNOWN,) * 3)
    assert hot > 100_000
    assert hot == pytest.approx(grey, rel=0.05)  # ticks, marker
    # in the paper's colours, half an emissivity is half a saturation
    half = replace(maps, emissivity=0.5 * maps.emissivity)
    figure = map_figure(half, FRAME, title="t", vmin=300, vmax=500, scale=1, paper=True)
    picture = _pixels(png_of(figure))[:, : int(2.9 * DPI)]
    assert _has(picture, (1, 0.5, 0.5)) + _has(picture, (1, 128 / 255, 128 / 255)) > 100_000


def test_clipped_values_point_the_colour_bar() -> None:
    """Arrows at the ends beyond which shown values lie; a value outside the window does not."""
    temperature = np.full((40, 40), 450.0)
    temperature[20, 20], temperature[0, 0] = 391.0, 600.0
    maps = _maps(np.ones((40, 40)), temperature)
    window = (-10.0, 10.0, -10.0, 10.0)
    figure = map_figure(maps, FRAME, title="t", vmin=420, vmax=500, window=window)
    keys = [axes for axes in figure.axes if axes.get_ylabel() == "apparent temperature / K"]
    [bar] = [axes._colorbar for axes in keys]  # type: ignore[attr-defined]
    assert bar.extend == "min"
    figure = map_figure(maps, FRAME, title="t", vmin=420, vmax=500, window=(-20, 20, -20, 20))
    assert figure.axes[1]._colorbar.extend == "both"  # type: ignore[attr-defined]


def test_up_is_up() -> None:
    """Row 0 is at the top, and the extent is centred where the frame says."""
    temperature = np.full((40, 40), 300.0)
    temperature[:10] = 500.0
    maps = _maps(np.ones((40, 40)), temperature)
    frame = ImageFrame((1e-3, 1e-3), (0.01, -0.5))
    picture = _pixels(png_of(map_figure(maps, frame, title="t", vmin=300, vmax=500, scale=1)))
    left = picture[:, : int(0.35 * WIDTH_IN * DPI)]
    hot, cold = (
        np.nonzero(np.all(np.abs(left - colormaps["plasma"](end)[:3]) < 1.1 / 255, axis=-1))[0]
        for end in (1.0, 0.0)
    )
    assert hot.max() < cold.min()
    assert frame.extent_mm((40, 40)) == pytest.approx((-10.0, 30.0, -520.0, -480.0))


def test_user_text_is_no_formula() -> None:
    """An unbalanced `$` or a bad formula in a scene's name must not stop the picture."""
    maps = _maps(np.ones((4, 4)), np.full((4, 4), 400.0))
    for title in (r"$\frac{", "5 $ a $^$ shot", ""):
        assert png_of(map_figure(maps, FRAME, title=title)).startswith(b"\x89PNG")


def test_pictures_of_nothing() -> None:
    """All NaN, all equal, one pixel, very wide: still a picture, and no warning."""
    nan = np.full((3, 3), np.nan)
    nothing = _maps(nan, nan)
    assert png_of(map_figure(nothing, FRAME, title="nothing")).startswith(b"\x89PNG")
    assert png_of(panels_figure(errors_panels(nothing), FRAME, title="nothing"))
    exact = replace(
        nothing,
        emissivity_standard_error=np.zeros((3, 3), np.float32),
        apparent_temperature_standard_error_K=np.zeros((3, 3), np.float32),
    )
    assert png_of(panels_figure(errors_panels(exact), FRAME, title="exact"))
    for shape in ((1, 1), (2, 200), (200, 2)):
        image = np.zeros(shape, np.uint16)
        both = camera_figures({400.0: image, 450.0: image + 1}, FRAME, title="t")
        assert list(both) == [400.0, 450.0]
        assert png_of(both[400.0]) != png_of(both[450.0])
    assert camera_figures({}, FRAME, title="t") == {}
    assert robust_limits(np.array([])) == (0.0, 1.0)
    assert robust_limits(np.array([np.nan, 5.0]))[0] == 5.0
    low, high = robust_limits(np.append(np.full(99_999, 7.0), 1e9))
    assert (low, round(high)) == (7.0, 7)


def test_weights_and_panels() -> None:
    zero = np.zeros((10, 10), np.float32)
    weights = Weights(zero + 1, zero, zero, zero)
    assert png_of(panels_figure(weights_panels(weights), FRAME, title="w"))
    # Three panels leave the fourth place blank.
    panels = [Panel(zero + n, f"{n}", "1", (0.0, 2.0), "gray") for n in range(3)]
    picture = _pixels(png_of(panels_figure(panels, FRAME, title="p")))
    assert _has(picture, (0, 0, 0)) > 10_000
    corner = picture[picture.shape[0] * 3 // 4, picture.shape[1] * 3 // 4]
    np.testing.assert_array_equal(corner, [1, 1, 1])


def test_files_for_print(tmp_path: Path) -> None:
    """PNG of 300 dpi on two columns, vectors with text; other kinds are refused with the path."""
    maps = _maps(np.ones((4, 4)), np.full((4, 4), 400.0))
    figure = map_figure(maps, FRAME, title="t")
    with Image.open(write_figure(figure, tmp_path / "a.png")) as image:
        assert image.info["dpi"] == pytest.approx((300, 300), abs=0.01)  # whole dots per metre
        assert image.width == pytest.approx(300 * WIDTH_IN, abs=1)
    pdf = write_figure(figure, tmp_path / "a.pdf").read_bytes()
    assert pdf.startswith(b"%PDF") and b"CIDFontType2" in pdf
    svg = write_figure(figure, tmp_path / "a.SVG").read_text(encoding="utf-8")
    assert "<svg" in svg and svg == write_figure(figure, tmp_path / "b.svg").read_text("utf-8")
    with pytest.raises(FileError, match=r"a\.jpg: .*allowed: \.png, \.pdf, \.svg"):
        write_figure(figure, tmp_path / "a.jpg")


def test_shares() -> None:
    """Shares of one pixel by hand; they add up; what is untouched does not count."""
    image = [np.array([[value, clear]], np.float32) for value, clear in
             ((0.5, 1.0), (0.1, 0.0), (30.0, 0.0), (10.0, 0.0))]  # fmt: skip
    zero = np.zeros((1, 2), np.float32)
    empty = Weights(zero + 1, zero, zero, zero)
    panels, means = shares_of_light(
        Weights(*image), empty, background=100.0, wall=100.0, patches={}
    )
    expected = {"background": 0.5, "walls": 0.1, "vapour": 0.3, "droplets": 0.1}
    assert means == pytest.approx(expected)
    assert png_of(panels_figure(panels, FRAME, title="s")).startswith(b"\x89PNG")
    nothing = shares_of_light(empty, empty, background=0.0, wall=0.0, patches={})
    assert nothing == ([], {})
