"""`cldit view` in a real Chromium: right to 1e-5, by keyboard, without network; what it saves.

Without Chromium or playwright these tests are skipped.
"""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from cldit.dit.maps import Maps
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.radiance.boundary import Boundary, Surroundings, picture
from cldit.run import Run, open_run, reevaluated
from cldit.scene import Scene
from cldit.view import save_page, view_items
from cldit.view.traced import traced_item
from tests.viewed import Viewer, chromium, made_run, scene_for

OLD = Path(__file__).parents[1] / "data" / "run-0.1.0"
MAPS = {
    "temperature": "apparent_temperature_K",
    "temperature_error": "apparent_temperature_standard_error_K",
    "emissivity": "emissivity",
    "emissivity_error": "emissivity_standard_error",
}
CHANGES: tuple[dict[str, float], ...] = (
    {},
    {"wall_K": 515.0},
    {"lowest_K": 350.0, "highest_K": 700.0},
    {"emissivity": 0.6},
    {"read_noise_electrons": 1500.0, "shots": 2},
    {"wall_K": 300.0, "lowest_K": 390.0, "highest_K": 612.5, "emissivity": 0.99, "shots": 20},
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=path)
        yield opened
        opened.close()


@pytest.fixture
def viewer(browser: Any) -> Iterator[Viewer]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    viewer = Viewer(context.new_page())
    yield viewer
    assert viewer.complaints == []
    own = {"file", "data", "blob"}
    assert {address.partition(":")[0] for address in viewer.asked} <= own
    assert len([one for one in viewer.asked if one.startswith("file")]) == 1  # the page itself
    context.close()


def opened(viewer: Viewer, folder: Path, *runs: Run) -> None:
    save_page(folder / "page.html", [traced_item(run, source="made.yaml") for run in runs])
    viewer.open(folder / "page.html")


def as_asked(scene: Scene, asked: dict[str, Any]) -> Scene:
    return scene.with_(
        **{
            "walls.temperature_K": asked["wall_K"],
            "background.temperatures_K": asked["backgrounds_K"],
            "background.emissivity": asked["emissivity"],
            "camera.sensor.read_noise_electrons": asked["read_noise_electrons"],
            "plan.shots": asked["shots"],
        }
    )


def off(page: NDArray[np.float32], given: NDArray[np.float32], *, share: bool) -> float:
    """Largest difference, as a share of the number or of 1; both have values in the same places."""
    assert np.array_equal(np.isnan(page), np.isnan(given))
    known = np.isfinite(given)
    difference = np.abs(page[known].astype(float) - given[known])
    return float(np.max(difference / (np.abs(given[known]) if share else 1.0), initial=0.0))


def agrees(viewer: Viewer, run: Run, change: dict[str, float]) -> None:
    """Weights err by 2e-6 of themselves, so the maps must be within 1e-5 of `reevaluated`."""
    asked = viewer.set(change)
    expected = reevaluated(run, as_asked(run.scene, asked))
    assert asked["integration_time_s"] == expected.info.integration_time_s
    assert np.array_equal(viewer.numbers(item=0, name="reason"), expected.maps.reason)
    for name, of in MAPS.items():
        page, given = viewer.numbers(item=0, name=name), getattr(expected.maps, of)
        assert np.isfinite(given).sum() > 20
        assert off(page, given, share=name != "emissivity") < 1e-5, (name, change)


@pytest.mark.parametrize("windows", [True, False], ids=["windows and patch", "plain"])
def test_sliders_give_what_reevaluated_gives(viewer: Viewer, tmp_path: Path, windows: bool) -> None:
    run = made_run(scene_for() if windows else scene_for(windows=[], patches=[]))
    opened(viewer, tmp_path, run)
    for change in CHANGES:
        agrees(viewer, run, change)


def test_several_nodes_and_temperatures_that_are_bound(viewer: Viewer, tmp_path: Path) -> None:
    """Sliders that the trace does not serve are held, and say why."""
    run = made_run(scene_for(optics={"preset": "spectral"}), nodes=4)
    opened(viewer, tmp_path, run)
    for change in ({}, {"emissivity": 0.4}, {"read_noise_electrons": 900.0, "shots": 3}):
        agrees(viewer, run, change)
    for name in ("lowest_K", "highest_K", "wall_K"):
        assert viewer.page.locator(f"#range-{name}").is_disabled()
        assert "wavelengths were chosen" in viewer.page.inner_text(f"#why-{name}")
    assert viewer.set({"wall_K": 700.0})["wall_K"] == run.scene.walls.temperature_K


def test_what_the_camera_sees(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for())
    opened(viewer, tmp_path, run)
    asked = viewer.set({"signal_K": 480.0, "wall_K": 500.0})
    scene = as_asked(run.scene, asked)
    filter_um = scene_filter(scene)
    whole = Boundary.in_filter(
        Surroundings.from_scene(scene),
        filter_um,
        reference_K=float(np.median(scene.background.temperatures_K)),
    )
    seen = picture(run.spectral, [whole], background_K=480.0)
    expected = temperature_of_radiance(seen, filter_um=filter_um).astype(np.float32)
    assert off(viewer.numbers(item=0, name="signal"), expected, share=True) < 1e-6


def test_one_background_gives_no_maps_but_a_picture(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for(background={"temperatures_K": [450.0], "radius_m": 0.05}))
    opened(viewer, tmp_path, run)
    assert np.array_equal(viewer.numbers(item=0, name="reason"), run.maps.reason)
    assert np.isnan(viewer.numbers(item=0, name="temperature")).all()
    assert np.isfinite(viewer.numbers(item=0, name="signal")).all()
    assert "fewer than two backgrounds" in viewer.page.inner_text(".map")
    assert "DIT needs two" in viewer.page.inner_text("#why-lowest_K")


def test_a_measurement_has_maps_and_no_sliders(viewer: Viewer, tmp_path: Path) -> None:
    save_page(tmp_path / "page.html", view_items([OLD / "acquisition"]))
    viewer.open(tmp_path / "page.html")
    maps = Maps.load(OLD / "acquisition" / "maps")
    for name in ("temperature", "emissivity"):
        page = viewer.numbers(item=0, name=name)
        assert off(page, getattr(maps, MAPS[name]), share=True) < 1e-5
    assert "a measurement has no weights" in viewer.page.inner_text("#why-all")
    ranges = viewer.page.locator("#sliders input")
    assert ranges.count() > 10
    assert all(ranges.nth(at).is_disabled() for at in range(ranges.count()))


def test_a_run_beside_its_recording(viewer: Viewer, tmp_path: Path) -> None:
    """The recording states its errors; this run, of 0.1.0, states none."""
    save_page(tmp_path / "page.html", view_items([OLD, OLD / "acquisition"]))
    viewer.open(tmp_path / "page.html")
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    found, stated = viewer.numbers(panel=2), viewer.errors(2)
    known = np.isfinite(found)
    assert found.shape == open_run(OLD).maps.reason.shape and known.sum() > 5
    assert np.array_equal(known, np.isfinite(stated)) and (stated[known] > 0).all()
    text = viewer.page.inner_text("#summary")
    assert "RMS" in text and "stated errors together" in text
    assert text.endswith(f"no error of it is stated by {open_run(OLD).scene.name}.")
    assert "measurement has no weights" in viewer.page.inner_text("#why-all")
    assert viewer.page.locator("#range-wall_K").is_enabled()


def test_a_difference_is_taken_on_the_coarser_pixels(viewer: Viewer, tmp_path: Path) -> None:
    """What a larger pixel sees is the mean of radiances: of emissivity times that of T_app."""
    fine_scene = scene_for(name="fine", camera={"pixels": [80, 60], "field_m": [0.16, 0.12]})
    coarse, fine = made_run(scene_for()), made_run(fine_scene, depth=1.0)
    opened(viewer, tmp_path, coarse, fine)
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    kelvin, error = fine.maps.apparent_temperature_K.astype(float), fine.error_maps["total"]
    known = np.isfinite(kelvin) & np.isfinite(error)
    emissivity = np.where(known, fine.maps.emissivity, 0.0)
    filter_um = scene_filter(fine_scene)
    light = emissivity * np.where(known, band_radiance(kelvin, filter_um=filter_um), 0.0)

    def mean(image: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(image.reshape(30, 2, 40, 2).mean(axis=(1, 3)))

    enough = mean(known.astype(float)) >= 0.5
    with np.errstate(invalid="ignore"):
        radiance = mean(light) / mean(emissivity)
        of_fine = mean(emissivity * np.where(known, error, 0.0)) / mean(emissivity)
    averaged = temperature_of_radiance(radiance, filter_um=filter_um)
    expected = np.where(enough, coarse.maps.apparent_temperature_K - averaged, np.nan)
    found = viewer.numbers(panel=2)
    assert found.shape == (30, 40)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    assert np.nanmax(np.abs(found - expected)) < 4e-3  # 1e-5 of some 400 K
    both = np.isfinite(expected) & np.isfinite(coarse.error_maps["total"])
    stated = np.hypot(coarse.error_maps["total"], of_fine)
    assert np.allclose(viewer.errors(2)[both], stated[both], rtol=1e-3)


def test_two_runs_state_their_errors_together(viewer: Viewer, tmp_path: Path) -> None:
    one, other = made_run(scene_for()), made_run(scene_for(name="thicker"), depth=4.0)
    opened(viewer, tmp_path, one, other)
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    expected = one.maps.apparent_temperature_K - other.maps.apparent_temperature_K
    assert np.nanmax(np.abs(viewer.numbers(panel=2) - expected)) < 4e-3
    error = np.hypot(one.error_maps["total"], other.error_maps["total"])
    known = np.isfinite(expected) & np.isfinite(error)
    assert np.allclose(viewer.errors(2)[known], error[known], rtol=1e-3)
    with viewer.page.expect_download() as told:
        viewer.page.click("#save-csv")
    heading = Path(told.value.path()).read_text(encoding="utf-8").splitlines()[0]
    assert heading == "x_mm,z_mm,difference_of_temperature_K,standard_error_K"
    asked = viewer.set({"wall_K": 600.0})  # sliders change both
    both = [reevaluated(run, as_asked(run.scene, asked)).maps for run in (one, other)]
    expected = both[0].apparent_temperature_K - both[1].apparent_temperature_K
    assert np.nanmax(np.abs(viewer.numbers(panel=2) - expected)) < 4e-3


def test_a_series_has_a_slider_over_its_times(viewer: Viewer, tmp_path: Path) -> None:
    items = []
    for time_s, depth in ((0.5e-3, 0.5), (1e-3, 1.0), (1.5e-3, 2.0)):
        item = traced_item(made_run(scene_for(), depth=depth), source="made.yaml")
        items.append(replace(item, head={**item.head, "time_s": time_s}))
    save_page(tmp_path / "page.html", items)
    viewer.open(tmp_path / "page.html")
    assert viewer.page.inner_text("#frame-name") == "made, 0.5 ms"
    before = np.nanmax(viewer.numbers(panel=0))
    viewer.page.select_option("#quantity", "depth")
    viewer.page.focus("#frame")
    viewer.page.keyboard.press("ArrowRight")
    viewer.page.keyboard.press("ArrowRight")
    viewer.drawn()
    assert viewer.page.inner_text("#frame-name") == "made, 1.5 ms"
    assert np.nanmax(viewer.numbers(panel=0)) == pytest.approx(2.0, rel=0.05) != before


def test_everything_by_keyboard(viewer: Viewer, tmp_path: Path) -> None:
    """Every control is reached by the tabulator, has a label, and shows that it has the focus."""
    run = made_run(scene_for())
    opened(viewer, tmp_path, run)
    controls = viewer.run(
        "[...document.querySelectorAll('input, select, button, [tabindex]')]"
        ".filter((one) => !one.disabled && one.offsetParent !== null)"
        ".map((one) => one.id || one.className)"
    )
    nameless = viewer.run(
        "[...document.querySelectorAll('input, select, button, .map')].filter((one) =>"
        " !one.getAttribute('aria-label') && !(one.labels && one.labels.length)"
        " && !(one.tagName === 'BUTTON' && one.textContent.trim())).map((one) => one.id)"
    )
    assert nameless == []
    reached = []
    for _ in controls:
        viewer.page.keyboard.press("Tab")
        reached.append(viewer.run("document.activeElement.id || document.activeElement.className"))
        outline = viewer.run("getComputedStyle(document.activeElement).outlineStyle")
        assert outline not in ("none", ""), reached[-1]
    assert sorted(reached) == sorted(controls) and "range-wall_K" in controls

    viewer.page.focus("#range-wall_K")
    viewer.page.keyboard.press("ArrowRight")
    viewer.drawn()
    assert viewer.run("cldit.scene(0)")["wall_K"] == run.scene.walls.temperature_K + 1.0

    viewer.page.focus(".map")
    viewer.page.keyboard.press("ArrowUp")
    viewer.page.keyboard.press("Space")
    for _ in range(3):
        viewer.page.keyboard.press("Shift+ArrowRight")
    viewer.page.wait_for_selector("#profile path.curve")
    viewer.page.wait_for_selector("#readout td")
    place = viewer.page.inner_text("#where")
    pixel = 4.0  # mm; the picture's middle is at z = 0
    assert place == f"x {min(30 * pixel, 80.0):.2f} mm, z {pixel:.2f} mm"
    viewer.page.keyboard.press("Escape")
    assert "Drag across a map" in (viewer.page.text_content("#profile") or "")


def test_what_is_changed_while_the_worker_works(viewer: Viewer, tmp_path: Path) -> None:
    """A slider moves on, and another map is chosen, before the first picture is there."""
    opened(viewer, tmp_path, made_run(scene_for()), made_run(scene_for(name="other")))
    viewer.page.select_option("#other", "1")
    viewer.run(
        """() => {
             const choice = document.getElementById("quantity");
             for (const kelvin of [450, 500, 550]) cldit.set("wall_K", kelvin);
             choice.value = "emissivity";
             choice.dispatchEvent(new Event("change"));
             cldit.set("wall_K", 480);
           }"""
    )
    viewer.drawn()
    assert viewer.run("cldit.scene(0)")["wall_K"] == 480.0
    low, high = viewer.run("cldit.state.limits.emissivity")
    assert -0.1 < low < high <= 1.0
    assert 300.0 < viewer.run("cldit.state.limits.temperature")[0] < 600.0
    assert "Emissivity" in (viewer.page.get_attribute(".map svg", "aria-label") or "")


def test_hover_tells_all_that_is_known(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for())
    opened(viewer, tmp_path, run)
    box = viewer.page.locator(".map canvas").bounding_box()
    assert box is not None
    row, column = 15, 22
    viewer.page.mouse.move(
        box["x"] + (column + 0.5) / 40 * box["width"], box["y"] + (row + 0.5) / 30 * box["height"]
    )
    viewer.page.wait_for_selector("#readout td")
    cells = viewer.page.locator("#readout tr").nth(1).locator("td").all_inner_texts()
    maps = run.maps
    emissivity = float(maps.emissivity[row, column])
    for text, value, error in (
        (cells[1], maps.apparent_temperature_K, maps.apparent_temperature_standard_error_K),
        (cells[2], maps.emissivity, maps.emissivity_standard_error),
    ):
        shown, uncertain = (float(one) for one in text.split(" ± "))
        assert shown == pytest.approx(float(value[row, column]), abs=0.0051)
        assert uncertain == pytest.approx(float(error[row, column]), rel=0.06)  # two digits
    depth = float(cells[3].split(" ± ")[0])
    assert depth == pytest.approx(-np.log1p(-emissivity), abs=2e-5)
    assert float(cells[4]) == pytest.approx(float(run.error_maps["total"][row, column]), abs=0.0051)


def test_saved_files_hold_the_numbers_and_the_picture(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for())
    opened(viewer, tmp_path, run)
    box = viewer.page.locator(".map canvas").bounding_box()
    assert box is not None
    middle = box["y"] + 15.5 / 30 * box["height"]
    viewer.page.mouse.move(box["x"] + 0.2 * box["width"], middle)
    viewer.page.mouse.down()
    viewer.page.mouse.move(box["x"] + 0.8 * box["width"], middle, steps=3)
    viewer.page.mouse.up()
    viewer.page.wait_for_selector("#profile path.curve")
    viewer.page.wait_for_timeout(200)

    def saved(button: str) -> bytes:
        with viewer.page.expect_download() as told:
            viewer.run("(button) => document.querySelector(button).click()", button)
        return Path(told.value.path()).read_bytes()

    rows = list(csv.DictReader(io.StringIO(saved("#save-csv").decode())))
    kelvin = run.maps.apparent_temperature_K
    assert len(rows) == np.isfinite(kelvin).sum()
    for row in rows[::37]:
        at = round(14.5 - float(row["z_mm"]) / 4.0), round(19.5 + float(row["x_mm"]) / 4.0)
        assert float(row["temperature_K"]) == pytest.approx(float(kelvin[at]), rel=1e-5)
        error = float(run.maps.apparent_temperature_standard_error_K[at])
        assert float(row["standard_error_K"]) == pytest.approx(error, rel=1e-3)

    line = list(csv.DictReader(io.StringIO(saved("#save-profile").decode())))
    assert float(line[-1]["distance_mm"]) == pytest.approx(0.6 * 160.0, abs=1.0)
    centre = min(line, key=lambda row: abs(float(row["x_mm"]) - 2.0))
    assert float(centre["value"]) == pytest.approx(float(kelvin[15, 20]), rel=1e-5)

    tree = ET.fromstring(saved("#save-svg"))
    name = "{http://www.w3.org/2000/svg}"
    texts = [one.text for one in tree.iter(f"{name}text")]
    assert {"x / mm", "z / mm", "T_app / K", "along the line / mm"} <= set(texts)
    pixels = [one.get("href") or "" for one in tree.iter(f"{name}image")]
    assert len(pixels) == 2 and all(one.startswith("data:image/png;base64,") for one in pixels)

    image = Image.open(io.BytesIO(saved("#save-png"))).convert("RGB")
    width, height = (float(tree.get(side) or 0) for side in ("width", "height"))
    assert image.size == (2 * width, int(2 * height))
    colours = np.asarray(image)[::5, ::5].reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 100 and (colours == 255).all(axis=1).mean() > 0.2


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (640, "dark"), (360, "light")])
def test_nothing_is_cut_in_a_narrow_window(
    viewer: Viewer, tmp_path: Path, width: int, scheme: Any
) -> None:
    viewer.page.set_viewport_size({"width": width, "height": 800})
    viewer.page.emulate_media(color_scheme=scheme)
    opened(viewer, tmp_path, made_run(scene_for()), made_run(scene_for(name="other")))
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    assert viewer.run("document.documentElement.scrollWidth") <= width
    paper = viewer.run("getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(28, 28, 28)")


def test_the_command_that_traces_it_anew(viewer: Viewer, tmp_path: Path) -> None:
    opened(viewer, tmp_path, made_run(scene_for()))
    assert viewer.page.locator("#command-box").is_hidden()
    viewer.set({"wall_K": 500.0, "emissivity": 0.8})
    assert viewer.page.inner_text("#command") == (
        "cldit run made.yaml --set walls.temperature_K=500 --set background.emissivity=0.8"
    )
