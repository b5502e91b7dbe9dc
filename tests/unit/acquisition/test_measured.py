"""Measured data of other programs: read as they are; errors name file and key in few letters."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml
from click.testing import CliRunner
from numpy.typing import NDArray

from cldit.acquisition.measured import open_measured
from cldit.acquisition.measured_draft import write_measured
from cldit.api.folder_evaluation import evaluate_folder
from cldit.cli import main
from cldit.comparison.shown import open_shown
from cldit.dit.budget import load_parts
from cldit.dit.maps import Maps, Reason
from cldit.errors import ClditError, EvaluationError, RunFolderError, SceneError
from cldit.optics.planck import band_radiance
from cldit.rig.load import Setup
from tests.bench.evaluation import bench_evaluation

FILTER = (3.3, 3.5)
BACKGROUNDS = (413.0, 453.0, 493.0)
EMISSIVITY = np.linspace(0.2, 0.9, 20)[None, :] * np.ones((16, 1))
SHOTS = 6


def _pictures(kelvin: float, kind: str) -> list[NDArray[np.uint16]]:
    rng = np.random.default_rng([int(kelvin), kind == "injections"])
    light, own = band_radiance([kelvin, 430.0], filter_um=FILTER)
    seen = np.full(EMISSIVITY.shape, light)
    if kind == "injections":
        seen = (1.0 - EMISSIVITY) * light + EMISSIVITY * own
    electrons = 1.2e-17 * seen * 40.0
    return [
        np.rint(
            300 + (rng.poisson(electrons) + 200 * rng.standard_normal(seen.shape)) / 40.0
        ).astype(np.uint16)
        for _ in range(SHOTS)
    ]


def _described(folder: Path, files: Callable[[float, str], Any], **more: Any) -> dict[str, Any]:
    data = {
        "filter_um": list(FILTER),
        "setup": {"pixel_m": [1e-4, 1e-4]},
        "sensor": {"saturation_counts": 16383},
        "backgrounds": [
            {
                "temperature_K": kelvin,
                "references": files(kelvin, "references"),
                "injections": files(kelvin, "injections"),
            }
            for kelvin in BACKGROUNDS
        ],
        **more,
    }
    _write(folder, data)
    return data


def _write(folder: Path, data: dict[str, Any]) -> None:
    (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")


@pytest.fixture
def tiffs(tmp_path: Path) -> Path:
    """One TIFF an image."""
    for kelvin in BACKGROUNDS:
        for kind in ("references", "injections"):
            place = tmp_path / f"{kelvin:g}" / kind
            place.mkdir(parents=True)
            for number, image in enumerate(_pictures(kelvin, kind)):
                tifffile.imwrite(place / f"{number:03d}.tif", image)
    _described(tmp_path, lambda kelvin, kind: f"{kelvin:g}/{kind}/*.tif")
    return tmp_path


def _data(folder: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((folder / "measured.yaml").read_text())
    return loaded


@pytest.mark.usefixtures("without_pages")
def test_a_folder_of_tiffs_from_the_command_line(tiffs: Path) -> None:
    """The filter and the temperatures alone: gain and noise come from the references."""
    result = CliRunner().invoke(main, ["evaluate", str(tiffs), "--calibration", "fitted"])
    assert result.exit_code == 0, result.output
    assert "wavelengths" in result.output
    maps = Maps.load(tiffs / "maps")
    off = (maps.emissivity - EMISSIVITY) / maps.emissivity_standard_error
    # 320 pixels: 4 standard errors of a mean, and of a variance with estimated noise
    assert abs(np.mean(off)) < 4 / np.sqrt(320)
    assert np.var(off) == pytest.approx(1.0, abs=0.35)
    assert "electrons_per_count" in (tiffs / "maps" / "evaluation.json").read_text()
    picture = CliRunner().invoke(main, ["show", str(tiffs)])
    assert picture.exit_code == 0 and (tiffs / "maps.png").is_file()


def test_parts_of_stacks_give_what_single_pictures_give(tiffs: Path, tmp_path: Path) -> None:
    """Both kinds of a background are parts of one data set of NeXus."""
    h5py = pytest.importorskip("h5py")
    expected = evaluate_folder(tiffs).maps
    folder = tmp_path / "nexus"
    folder.mkdir()
    with h5py.File(folder / "run.nxs", "w") as file:
        for kelvin in BACKGROUNDS:
            both = [*_pictures(kelvin, "references"), *_pictures(kelvin, "injections")]
            file[f"entry/at{kelvin:g}/data"] = np.stack(both)
    parts = {"references": f"[:{SHOTS}]", "injections": f"[{SHOTS}:]"}
    _described(folder, lambda kelvin, kind: f"run.nxs::/entry/at{kelvin:g}/data{parts[kind]}")
    maps = evaluate_folder(folder / "measured.yaml").maps
    np.testing.assert_array_equal(maps.emissivity, expected.emissivity)
    np.testing.assert_array_equal(maps.reason, expected.reason)


def test_axes_and_readings_of_the_black_body(tiffs: Path, tmp_path: Path) -> None:
    """Frames stored last give the same maps; readings reach the shots; all is said before."""
    expected = evaluate_folder(tiffs).maps
    folder = tmp_path / "last"
    folder.mkdir()
    for kelvin in BACKGROUNDS:
        for kind in ("references", "injections"):
            np.save(folder / f"{kind}{kelvin:g}.npy", np.stack(_pictures(kelvin, kind), axis=-1))
    data = _described(folder, lambda kelvin, kind: f"{kind}{kelvin:g}.npy")
    data["axes"] = ["rows", "columns", "frames"]
    _write(folder, data)
    lines: list[str] = []
    found = evaluate_folder(folder, say=lines.append).maps
    np.testing.assert_array_equal(found.emissivity, expected.emissivity)
    assert "6 references, 6 injections each; 20 x 16 uint16 (npy)" in lines[0]
    data["backgrounds"][0]["references_K"] = [413.0 + 0.1 * number for number in range(SHOTS)]
    _write(folder, data)
    assert [shot.background_K for shot in open_measured(folder).shots[:2]] == [413.0, 413.1]
    data["axes"] = ["rows", "columns"]
    _write(folder, data)
    with pytest.raises(SceneError, match=r"axes.*allowed: frames, rows, columns"):
        open_measured(folder)


def test_bad_pixels_and_a_sensor_of_known_noise(tiffs: Path) -> None:
    data = _data(tiffs)
    mask = np.zeros(EMISSIVITY.shape, np.uint8)
    mask[3, 4] = 1
    tifffile.imwrite(tiffs / "bad.tif", mask)
    data["bad_pixels"] = "bad.tif"
    data["sensor"] |= {
        "offset_counts": 300.0,
        "electrons_per_count": 40.0,
        "read_noise_electrons": 200.0,
    }
    _write(tiffs, data)
    found = evaluate_folder(tiffs)
    assert found.maps.reason[3, 4] == Reason.BAD_PIXEL
    assert found.maps.count()[Reason.BAD_PIXEL] == 1
    # 2 x 3 x 6 images of 320 pixels of 5000 counts, noise 11 each: gain to a few 1e-4
    assert found.calibration.counts_per_radiance == pytest.approx(1.2e-17, rel=2e-3)


def test_celsius_the_injectors_pixel_and_a_dead_pixel(tiffs: Path) -> None:
    for file in tiffs.glob("*/*/*.tif"):
        image = tifffile.imread(file)
        image[7, 9] = 0
        tifffile.imwrite(file, image)
    data = _data(tiffs)
    expected = open_measured(tiffs)
    log = "Logger 3\nbody;T\n;°C\n" + "".join(f"1;{413.25 - 273.15:.2f}\n" for _ in range(SHOTS))
    (tiffs / "log.csv").write_text(log.replace(".", ","), encoding="cp1252")
    for background in data["backgrounds"]:
        background["temperature_C"] = background.pop("temperature_K") - 273.15
    data["backgrounds"][0]["references_C"] = "log.csv::T"
    data["setup"]["injector_pixel"] = [4.0, 2.0]
    _write(tiffs, data)
    found = open_measured(tiffs)
    kelvin = [shot.background_K for shot in expected.shots]
    kelvin[:SHOTS] = [413.25] * SHOTS
    assert [shot.background_K for shot in found.shots] == pytest.approx(kelvin, abs=1e-9)
    # The image's centre is at column 9.5 and row 7.5, of 20 and 16.
    assert found.centre_m == pytest.approx((5.5e-4, -5.5e-4))
    setup = Setup.model_validate(data["setup"])
    assert Setup.model_validate(setup.model_dump(mode="json")) == setup  # in acquisitions
    maps = evaluate_folder(tiffs).maps
    assert maps.reason[7, 9] == Reason.BAD_PIXEL and maps.count()[Reason.BAD_PIXEL] == 1


def test_errors_of_an_earlier_evaluation_are_not_left(tiffs: Path) -> None:
    """The walls' error is stated, and then another: a comparison reads the parts that are left."""
    data = _data(tiffs)
    for error_K in (5.0, 3.0):
        stated = {"background_emissivity": 0.9, "uncertainty": {"wall_temperature_K": error_K}}
        _write(tiffs, {**data, "setup": {**data["setup"], **stated}})
        evaluate_folder(tiffs)
        (walls,) = (part for part in load_parts(tiffs / "maps")[0] if "walls" in part.name)
        assert f"by {error_K:g} K" in walls.name


@pytest.mark.parametrize("name", ["emissivity.tif", "budget/walls*_K.tif"])
def test_maps_that_a_kill_left_of_two_evaluations_are_named(tiffs: Path, name: str) -> None:
    """A map of another evaluation is a good file, and belongs to none of the others."""
    evaluate_folder(tiffs)
    (place,) = (tiffs / "maps").glob(name)
    place.write_bytes((tiffs / "maps" / "fit_probability.tif").read_bytes())
    with pytest.raises(RunFolderError, match=rf"{place.name}: is damaged: it differs"):
        open_shown(tiffs)


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        ("backgrounds", "temperature_C", 140.0, "temperature_K is given too; allowed: one of them"),
        ("backgrounds", "references_C", [140.0], "log.csv|is given too"),
        ("backgrounds", "temperature_C", -300.0, "temperature_C.*-300"),
        ("setup", "injector_pixel", [1.0, 2.0], "centre_m is given too; allowed: one of them"),
    ],
)
def test_values_that_are_given_twice_or_cannot_be(
    tiffs: Path, section: str, key: str, value: Any, message: str
) -> None:
    data = _data(tiffs)
    place = data["backgrounds"][0] if section == "backgrounds" else data["setup"]
    place |= {"references_K": [413.0]} if key == "references_C" else {}
    place |= {"centre_m": [0.0, 1e-3]} if key == "injector_pixel" else {}
    if value == -300.0:
        del place["temperature_K"]
    place[key] = value
    _write(tiffs, data)
    with pytest.raises(SceneError, match=message):
        open_measured(tiffs)


def test_names_are_sorted_by_their_numbers_and_may_have_brackets(tmp_path: Path) -> None:
    for number in range(1, 13):
        for kelvin in (413, 453):
            folder = tmp_path / f"shots[{kelvin}]"
            folder.mkdir(exist_ok=True)
            for kind in ("references", "injections"):
                image = np.full((4, 5), 100 * number, np.uint16)
                tifffile.imwrite(folder / f"{kind}_{number}.tif", image)
    data = _described(tmp_path, lambda kelvin, kind: f"shots[{kelvin:g}]/{kind}_*.tif")
    _write(tmp_path, {**data, "backgrounds": data["backgrounds"][:2]})
    found = open_measured(tmp_path)
    assert [int(found.load(shot)[0, 0]) for shot in found.shots[:12]] == [
        100 * number for number in range(1, 13)
    ]
    assert "names by their numbers: references_9.tif before references_10.tif" in found.found()


def _swap(*backgrounds: dict[str, Any]) -> None:
    for background in backgrounds:
        kinds = background["injections"], background["references"]
        background["references"], background["injections"] = kinds


def _image(image: NDArray[Any], **options: Any) -> Callable[[list[dict[str, Any]], Path], object]:
    """Another image among the references at 453 K."""
    name = "453/references/002.tif"
    return lambda backgrounds, folder: tifffile.imwrite(folder / name, image, **options)


def _bytes(change: Callable[[bytes], bytes]) -> Callable[[list[dict[str, Any]], Path], object]:
    """A damaged image among the references at 453 K."""
    name = "453/references/002.tif"
    return lambda backgrounds, folder: (folder / name).write_bytes(
        change((folder / name).read_bytes())
    )


def _kelvin(*kelvin: float) -> Callable[[list[dict[str, Any]], Path], object]:
    return lambda backgrounds, folder: [
        background.update(temperature_K=value)
        for background, value in zip(backgrounds, kelvin, strict=True)
    ]


NOT_FINITE = np.where(np.arange(320).reshape(16, 20) == 0, np.nan, 1.0).astype(np.float32)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda b, f: (b.pop(), b.pop()),
            r"\[413.0\] K; the evaluation needs at least two",
        ),
        (_kelvin(5.0, 5.0 + 1e-9, 5.0 + 2e-9), "give the same radiance"),
        (_kelvin(*BACKGROUNDS[::-1]), "they fall where the background is hotter"),
        (lambda b, f: _swap(*b), "swapped"),
        (lambda b, f: _swap(b[-1]), "background 493 K.*swapped"),
        (
            lambda b, f: b[2].update(injections=b[2]["references"]),
            "named as references at 493 K and as injections at 493 K",
        ),
        (
            _image(np.zeros((16, 21), np.uint16)),
            r"002.tif\[0\]: image of shape \(16, 21\); allowed: \(16, 20\)",
        ),
        (_bytes(lambda data: b"II*\0no image"), "002.tif: cannot be read"),
        (_bytes(lambda data: data[:-200]), "002.tif"),
        (_image(NOT_FINITE), "1 pixels are not finite"),
        (_image(np.zeros((16, 20, 3), np.uint8), photometric="rgb"), r"shape \(16, 20, 3\)"),
        (
            lambda b, f: [x.update(references=x["references"].replace("*", "000")) for x in b],
            "one reference per background",
        ),
    ],
)
def test_bad_images_are_named(
    tiffs: Path, spoil: Callable[[list[dict[str, Any]], Path], object], message: str
) -> None:
    data = _data(tiffs)
    spoil(data["backgrounds"], tiffs)
    _write(tiffs, data)
    with pytest.raises(EvaluationError, match=message):
        evaluate_folder(tiffs)
    assert not (tiffs / "maps").exists()


def test_saturated_images_and_a_mask_of_another_size_are_named(tiffs: Path) -> None:
    data = _data(tiffs)
    data["sensor"]["saturation_counts"] = 250
    _write(tiffs, data)
    with pytest.raises(EvaluationError, match="saturated; it is ignored\nthe evaluation needs two"):
        evaluate_folder(tiffs)
    tifffile.imwrite(tiffs / "bad.tif", np.zeros((8, 8), np.uint8))
    _write(tiffs, {**data, "bad_pixels": "bad.tif"})
    with pytest.raises(EvaluationError, match=r"bad_pixels: bad.tif has shape \(8, 8\); allowed: "):
        evaluate_folder(tiffs)


def test_wrong_keys_are_named(tiffs: Path) -> None:
    data = _data(tiffs)
    data["sensor"]["saturation"] = 1
    data["filter_um"] = [3.5, 3.3]
    _write(tiffs, data)
    with pytest.raises(SceneError, match=r"sensor\.saturation"):
        open_measured(tiffs)
    del data["sensor"]["saturation"]
    _write(tiffs, data)
    with pytest.raises((SceneError, EvaluationError), match="filter_um"):
        open_measured(tiffs)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_shots(tmp_path: Path) -> None:
    """What the evaluation holds are sums: ten times the shots, the same arrays.

    Told by numpy's own allocations, not by the process.
    """
    peaks = []
    for shots in (20, 120):
        tracemalloc.start()
        found = bench_evaluation(tmp_path, shots=shots, sensor=(160, 128))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found.shots == shots and found.peak_bytes >= 0
        assert np.isfinite(found.evaluation.maps.emissivity).mean() > 0.99
    # An image is 160 kB as float64; 100 more shots held would be 16 MB. Thumbnails and
    # their differences: 8 kB a shot.
    assert peaks[1] < peaks[0] + 100 * 16e3


LONG = "x" * 100_000
MANY = [1.0 + n for n in range(20_000)]
IMAGE = np.arange(20 * 16, dtype=np.uint16).reshape(20, 16)


@pytest.fixture
def data(tmp_path: Path) -> dict[str, Any]:
    for name in ("a", "b", "c", "d"):
        tifffile.imwrite(tmp_path / f"{name}.tif", np.stack([IMAGE] * 3), photometric="minisblack")
    return {
        "filter_um": [3.3, 3.5],
        "setup": {"pixel_m": [1e-4, 1e-4]},
        "sensor": {"saturation_counts": 16383},
        "backgrounds": [
            {"temperature_K": 413.0, "references": "a.tif", "injections": "b.tif"},
            {"temperature_K": 453.0, "references": "c.tif", "injections": "d.tif"},
        ],
    }


def _message(folder: Path, data: dict[str, Any]) -> str:
    (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ClditError) as caught:
        open_measured(folder)
    return str(caught.value)


def _second(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda data: data["backgrounds"][1].update({key: value})


def _top(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda data: data.update({key: value})


CASES: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (_second("references", LONG), "backgrounds[1].references"),
    (_second("references", "a.tif"), "backgrounds[1].references"),
    (_second("references", "c.tif[0:99]"), "backgrounds[1].references"),
    (_second("injections", f"{LONG}[]::"), "backgrounds[1].injections"),
    (_second("references_s", MANY), "backgrounds[1].references_s"),
    (_second("references_s", [1.0, 3.0, 2.0]), "backgrounds[1].references_s"),
    (_second("injections_s", f"log.csv::{LONG}"), "backgrounds[1].injections_s"),
    (_second("injections_K", [453.0, 180.0, 453.0]), "backgrounds[1].injections_K"),
    (_second("temperature_K", 413.0), "backgrounds"),
    (_top("references", 5), "backgrounds[0].references"),
    (_top("bad_pixels", LONG), "bad_pixels"),
    (_top("axes", [LONG, "rows", "columns"]), "axes"),
    (_top(LONG, 1), "x" * 70),
]


@pytest.mark.parametrize("number", range(len(CASES)))
def test_an_error_names_file_and_key_in_few_letters(
    tmp_path: Path, data: dict[str, Any], number: int
) -> None:
    change, key = CASES[number]
    change(data)
    message = _message(tmp_path, data)
    assert message.startswith(f"{tmp_path / 'measured.yaml'}:")
    assert re.search(rf":\s{re.escape(key)}", message), message[:2000]
    assert len(message) < 1500 and not re.search("x{81}", message)


def test_an_unfinished_draft_lists_what_is_missing(tmp_path: Path, data: dict[str, Any]) -> None:
    out = tmp_path / "measured.yaml"
    write_measured(tmp_path, out)
    with pytest.raises(ClditError) as caught:
        open_measured(out)
    first, *lines = str(caught.value).splitlines()
    assert first == f"{out}: is incomplete; complete and uncomment what is missing:"
    assert {"filter_um: is missing", "setup.pixel_m: is missing"} <= set(lines)
    assert "backgrounds[0].temperature_K: is missing" in lines
