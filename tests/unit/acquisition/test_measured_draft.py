"""A first measured.yaml from a folder as laboratories have it: what names and files report."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from click.testing import CliRunner
from numpy.typing import NDArray

from cldit.acquisition.measured_draft import write_measured
from cldit.acquisition.pictures.names import reported
from cldit.cli import main
from cldit.dit.maps import Maps, Reason
from cldit.errors import EvaluationError
from cldit.optics.planck import band_radiance

SHAPE = (12, 16)
EMISSIVITY = np.full(SHAPE, 0.6)


def images(kelvin: float, spray: bool, count: int) -> NDArray[np.uint16]:
    """(count, rows, columns) counts of a sheet of 430 K, or of the black body alone; one dead
    pixel.
    """
    rng = np.random.default_rng([round(kelvin), spray])
    light, own = band_radiance([kelvin, 430.0], filter_um=(3.3, 3.5))
    seen = light if not spray else (1.0 - EMISSIVITY) * light + EMISSIVITY * own
    electrons = rng.poisson(np.broadcast_to(4.8e-16 * seen, (count, *SHAPE)))
    counts = 300 + (electrons + 200 * rng.standard_normal(electrons.shape)) / 40
    found = np.rint(counts).astype(np.uint16)
    found[:, 3, 4] = 0
    return found


def filled(text: str) -> str:
    """The draft with its missing lines uncommented, as a user completes it."""
    for key in ("filter_um", "pixel_m"):
        text = re.sub(rf"# ({key}: [^#]*)#.*", r"\1", text)
    return re.sub(r"- # (temperature_K: \S+).*", r"- \1", text)


def evaluated(draft: Path) -> Maps:
    draft.write_text(filled(draft.read_text()), encoding="utf-8")
    result = CliRunner().invoke(main, ["evaluate", str(draft)])
    assert result.exit_code == 0, result.output + result.stderr
    return Maps.load(draft.parent / "maps")


@pytest.mark.usefixtures("without_pages")
def test_a_folder_of_stacks_with_darks_and_a_mask_runs_once_it_is_completed(tmp_path: Path) -> None:
    for celsius in (140, 180, 220):
        for name, spray in (("nospray", False), ("spray", True)):
            path = tmp_path / f"T{celsius}C_{name}.tif"
            tifffile.imwrite(path, images(celsius + 273.15, spray, 8), photometric="minisblack")
    dark = np.random.default_rng(1).normal(300, 5, (4, *SHAPE)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "dark_25us.tif", dark, photometric="minisblack")
    mask = np.zeros(SHAPE, np.uint8)
    mask[5, 6] = 1
    tifffile.imwrite(tmp_path / "deadPixels.tif", mask)
    (tmp_path / "log.csv").write_text("Logger\n\ntime;T_bb\ns;°C\n0;140,1\n", encoding="utf-8")
    (tmp_path / "raw.ats").write_bytes(b"x")
    draft = tmp_path / "measured.yaml"
    result = CliRunner().invoke(main, ["evaluate", str(tmp_path), "--write-measured", str(draft)])
    assert result.exit_code == 0, result.output
    assert "not found: filter_um" in result.output and "next: cldit evaluate" in result.output
    text = draft.read_text()
    for line in (
        "  - temperature_C: 180\n",
        "    references: T180C_nospray.tif  # 8 of 16 x 12 uint16\n",
        "  saturation_counts: 8191|4095|16383",
        "  offset_counts: (299|300)  # median of dark_25us.tif, 1 files",
        "bad_pixels: deadPixels.tif",
        "# table log.csv: time, T_bb",
        "# raw.ats is a film of FLIR: export raw counts as TIFF of 16 bits",
    ):
        assert re.search(line, text), (line, text)
    maps = evaluated(draft)
    assert maps.count()[Reason.BAD_PIXEL] == 2  # the one of the mask, and the dead one
    good = maps.reason == Reason.OK
    assert np.median(maps.emissivity[good]) == pytest.approx(0.6, abs=0.01)
    assert np.median(maps.apparent_temperature_K[good]) == pytest.approx(430.0, abs=1.0)
    with pytest.raises(EvaluationError, match=r"measured\.yaml: exists already"):
        write_measured(tmp_path, draft)


@pytest.mark.usefixtures("without_pages")
def test_single_images_in_folders_with_a_gap_and_a_draft_beside_them(tmp_path: Path) -> None:
    for kelvin in (413, 453):
        folder = tmp_path / "july 3" / f"bb_{kelvin}K"
        folder.mkdir(parents=True)
        for number, pair in enumerate(zip(images(kelvin, False, 11), images(kelvin, True, 11),
                                          strict=True), start=1):  # fmt: skip
            if number == 7:
                continue
            tifffile.imwrite(folder / f"ref_{number}.tif", pair[0])
            tifffile.imwrite(folder / f"frame_{number}.tif", pair[1])
    draft = tmp_path / "july.yaml"
    lines = write_measured(tmp_path / "july 3", draft)
    assert lines == [str(draft), "  not found: filter_um", "  not found: pixel_m"]
    text = draft.read_text()
    assert "references: july 3/bb_413K/ref_*.tif  # 10 of 16 x 12 uint16; no number 7" in text
    assert "injections: july 3/bb_413K/frame_*.tif  # 10 of 16 x 12 uint16; the names" in text
    assert np.nanmedian(evaluated(draft).emissivity) == pytest.approx(0.6, abs=0.02)


@pytest.mark.usefixtures("without_pages")
def test_data_sets_without_temperatures_in_their_names(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for number, kelvin in enumerate((413, 453)):
            file[f"entry/reference{number}"] = images(kelvin, False, 6)
            file[f"entry/injection{number}"] = images(kelvin, True, 6)
    draft = tmp_path / "measured.yaml"
    assert "  not found: temperature_K" in write_measured(tmp_path, draft)
    text = draft.read_text()
    assert "injections: 'run.h5::/entry/injection1'  # 6 of 16 x 12 uint16" in text
    for kelvin in (413, 453):
        text = text.replace("temperature_K: 400.0", f"temperature_K: {kelvin}", 1)
        text = text.replace(f"# temperature_K: {kelvin}", f"temperature_K: {kelvin}", 1)
    draft.write_text(text)
    assert np.nanmedian(evaluated(draft).emissivity) == pytest.approx(0.6, abs=0.02)


def test_units_that_names_omit_delays_and_unknown_kinds_are_comments(tmp_path: Path) -> None:
    for name in ("bb350_ref.npy", "bb350_inj_0.5ms.npy", "bb350_inj_1ms.npy", "bb400_a.npy"):
        np.save(tmp_path / name, np.zeros((3, *SHAPE), np.float32))
    np.save(tmp_path / "other.npy", np.zeros((2, 30, 40), np.uint16))
    draft = tmp_path / "measured.yaml"
    write_measured(tmp_path, draft)
    text = draft.read_text()
    for line in (
        "  - # temperature_K: 350  # not found: its unit; K, or temperature_C\n",
        "    injections: bb350_inj_0.5ms.npy  # 3 of 16 x 12 float32; delay 0.5 ms\n",
        "    # injections: bb350_inj_1ms.npy  # 3 of .*; delay 1 ms, for a file of its own\n",
        r"    # references: 'bb400_a.npy\[:1\]'  # not found: which of these 3 images have no",
        r"    # injections: 'bb400_a.npy\[1:\]'  # not found: which of them have\n",
        "  # saturation_counts: 0  # not found",
        "# other.npy: 40 x 30 uint16, another size",
    ):
        assert re.search(line, text), (line, text)


@pytest.mark.parametrize(
    ("name", "role", "temperature"),
    [
        ("423K/ref_1.tif", "reference", (423.0, "K")),
        ("bb_350K_nospray_01.tif", "reference", (350.0, "K")),
        ("T77.5C/Spray_0003.tif", "injection", (77.5, "C")),
        ("spray/bb_350K_3.tif", "injection", (350.0, "K")),
        ("bb_350K.tif", "", (350.0, "K")),
        ("ref77C.tif", "reference", (77.0, "C")),
        ("INJ_423,5_K_12.tif", "injection", (423.5, "K")),
        ("spray_july/BB_T=423K/off_1.tif", "reference", (423.0, "K")),
        ("noSpray_T_350.tif", "reference", (350.0, "")),
        ("run.h5::/423K/injections/data", "injection", (423.0, "K")),
        ("dark/frame_350.tif", "dark", None),
        ("BadPixelMap.png", "defective", None),
        ("640x512/img_12_25us.tif", "", None),
        ("423K/bg_007.tif", "reference", (423.0, "K")),
        ("423K/background/7.tif", "reference", (423.0, "K")),
        ("bg_423K_007.tif", "", (423.0, "K")),
        ("bg_2/image_1.tif", "", None),
    ],
)
def test_what_names_report(name: str, role: str, temperature: Any) -> None:
    found = reported(name)
    assert (found.role, found.temperature) == (role, temperature)


def test_a_word_that_all_names_share_reports_no_kind(tmp_path: Path) -> None:
    for name in ("bg_1", "bg_2", "inj_1", "inj_2"):
        tifffile.imwrite(tmp_path / f"spray_T140C_{name}.tif", images(413.0, False, 1)[0])
    write_measured(tmp_path, tmp_path / "measured.yaml")
    text = (tmp_path / "measured.yaml").read_text()
    assert "    references: spray_T140C_bg_*.tif  # 2 of" in text
    assert "    injections: spray_T140C_inj_*.tif  # 2 of" in text


def test_folders_without_images(tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("x")
    with pytest.raises(EvaluationError, match="no image was found"):
        write_measured(tmp_path, tmp_path / "measured.yaml")
    with pytest.raises(EvaluationError, match="is no folder"):
        write_measured(tmp_path / "notes.md", tmp_path / "measured.yaml")
