"""Films: as long as their times say, without tints, in one scale."""

from __future__ import annotations

import io
import math
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cldit.dit.delay_table import DelayRow
from cldit.dit.maps import Maps
from cldit.run.series import SeriesTime
from cldit.run.series_plan import SeriesPlan
from cldit.scene import load_scene
from cldit.show.figures.colours import Scale
from cldit.show.figures.film import durations_s, gif_of, write_film
from cldit.show.report.series_report import table_csv

MAPS = Path(__file__).parents[3] / "data" / "run-0.1.0" / "maps"


def picture(hue: int, *, size: tuple[int, int] = (33, 21)) -> bytes:
    """White paper with a patch of two thousand colours."""
    pixels = np.full((size[1], size[0], 3), 255, np.uint8)
    random = np.random.default_rng(hue)
    pixels[3:9, 5:25] = random.integers(0, 256, (6, 20, 3))
    pixels[12, 5:25] = (0, 0, hue)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG")
    return stream.getvalue()


def test_uneven_times_stand_unevenly() -> None:
    shown = durations_s([0.0, 1.0, 2.0, 4.0])
    assert shown[2] == pytest.approx(2 * shown[0])
    assert shown[0] == shown[1]
    assert len(shown) == 4
    assert durations_s([1.0]) == [1.0]
    assert min(durations_s([0.0, 1e-9, 1.0])) >= 0.04  # viewers show no shorter ones


def test_a_gif_keeps_white_black_and_the_colours_nearly() -> None:
    pictures = [picture(hue) for hue in (10, 90, 250)]
    film = Image.open(io.BytesIO(gif_of(pictures, [0.1, 0.3, 1.0])))
    assert film.n_frames == 3  # type: ignore[attr-defined]
    assert film.info["loop"] == 0
    for number, (png, stands_ms) in enumerate(zip(pictures, (100, 300, 1000), strict=True)):
        film.seek(number)
        assert film.info["duration"] == stands_ms
        shown = np.asarray(film.convert("RGB")).astype(int)
        wanted = np.asarray(Image.open(io.BytesIO(png))).astype(int)
        white = np.all(wanted == 255, axis=2)
        assert np.all(shown[white] == 255)
        # 360 colours at random in a cube of 256: of 254 places in it, the nearest is mostly within
        # 256 / 254^(1/3) / 2 along each axis
        assert np.sqrt(np.mean((shown - wanted)[~white] ** 2.0)) < 256 / 254 ** (1 / 3) / 2


def test_an_mp4_has_the_pictures_in_turn(tmp_path: Path) -> None:
    """65 x 49 pixels become 64 x 48: colours of H.264 are stored for two by two."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    pictures = [picture(hue, size=(65, 49)) for hue in (10, 250)]
    files = write_film(tmp_path / "film.gif", pictures, [0.0, 1.0])
    assert [path.name for path in files] == ["film.gif", "film.mp4"]
    command = [ffmpeg.get_ffmpeg_exe(), "-i", files[1], "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    frames = np.frombuffer(raw, np.uint8).reshape(-1, 48, 64, 3)
    assert len(frames) == round(0.25 * 25) + 25
    assert np.all(frames[-1][30:, 30:] > 250)
    assert [path.name for path in tmp_path.iterdir() if ".part" in path.name] == []


def test_one_scale_holds_all() -> None:
    maps = Maps.load(MAPS)
    warmer = replace(maps, apparent_temperature_K=maps.apparent_temperature_K + np.float32(40.0))
    one, both = Scale.of([maps]), Scale.of([maps, warmer])
    assert both.range_K[0] == one.range_K[0]
    assert both.range_K[1] == pytest.approx(one.range_K[1] + 40.0)
    nothing = replace(
        maps, apparent_temperature_K=np.full_like(maps.apparent_temperature_K, np.nan)
    )
    assert Scale.of([nothing, maps]).range_K == one.range_K
    assert Scale.of([nothing]).range_K == (0.0, 0.0)


def times() -> tuple[SeriesPlan, list[SeriesTime]]:
    scene = load_scene("gdi-cone")
    nan = math.nan
    row = DelayRow(1e-3, 12, 480.5, nan, 0.25, nan)
    spray = {"liquid_mass_kg": 1e-6, "liquid_penetration_95_m": 0.02, "other": 3.0}
    found = [
        SeriesTime(0.0, "no spray", problem="holds no fuel"),
        SeriesTime(1e-3, "done", Path("out/time_1ms"), spray, row),
        SeriesTime(2e-3, "failed", problem='a, b "c"'),
    ]
    return SeriesPlan({each.time: scene for each in found}), found


def test_the_table_says_what_is_known() -> None:
    import csv

    rows = list(csv.DictReader(io.StringIO(table_csv(*times()))))
    assert [row["time_s"] for row in rows] == ["0", "0.001", "0.002"]
    assert [row["state"] for row in rows] == ["no spray", "done", "failed"]
    assert rows[0]["liquid_mass_kg"] == rows[0]["vapour_mass_kg"] == "0"
    assert rows[1]["liquid_penetration_95_m"] == "0.02"
    assert rows[1]["vapour_mass_kg"] == rows[2]["liquid_mass_kg"] == ""
    assert rows[1]["apparent_temperature_K"] == "480.5"
    assert rows[1]["folder"] == "time_1ms"
    assert rows[2]["problem"] == 'a, b "c"'
    assert "other" not in rows[1]
    plan, found = times()
    crank = table_csv(replace(plan, in_seconds=False), found)
    assert crank.startswith("time,state,")
