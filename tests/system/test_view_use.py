"""`cldit view` as it is used: by keyboard, with the mouse, in a narrow window; what it saves.

Without Chromium or playwright these tests are skipped.
"""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.viewed import Viewer, made_run, open_page, scene_for


def download(viewer: Viewer, button: str) -> tuple[str, bytes]:
    """Name and content of the file that a button saves."""
    with viewer.page.expect_download() as told:
        viewer.run("(button) => document.querySelector(button).click()", button)
    return told.value.suggested_filename, Path(told.value.path()).read_bytes()


def test_everything_by_keyboard(viewer: Viewer, tmp_path: Path) -> None:
    """Every control is reached by the tabulator, has a label, and shows that it has the focus."""
    run = made_run(scene_for())
    open_page(viewer, tmp_path, run)
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
    open_page(viewer, tmp_path, made_run(scene_for()), made_run(scene_for(name="other")))
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
    open_page(viewer, tmp_path, run)
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
    open_page(viewer, tmp_path, run)
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
        return download(viewer, button)[1]

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
    open_page(viewer, tmp_path, made_run(scene_for()), made_run(scene_for(name="other")))
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    assert viewer.run("document.documentElement.scrollWidth") <= width
    paper = viewer.run("getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(28, 28, 28)")


def test_the_command_that_traces_it_anew(viewer: Viewer, tmp_path: Path) -> None:
    open_page(viewer, tmp_path, made_run(scene_for()))
    assert viewer.page.locator("#command-box").is_hidden()
    viewer.set({"wall_K": 500.0, "emissivity": 0.8})
    assert viewer.page.inner_text("#command") == (
        "cldit run made.yaml --set walls.temperature_K=500 --set background.emissivity=0.8"
    )
    viewer.set({"wall_K": 440.0, "emissivity": 0.93})  # those of the run
    assert viewer.page.locator("#command-box").is_hidden()


def test_files_say_what_was_changed(viewer: Viewer, tmp_path: Path) -> None:
    """Title, note, file name and comment, with the run's own value; nothing without a change."""
    open_page(viewer, tmp_path, made_run(scene_for()))
    name, before = download(viewer, "#save-csv")
    assert name == "made-temperature.csv" and before.startswith(b"x_mm,")
    viewer.set({"wall_K": 1500.0})
    said = "changed: walls 1500 K (run: 440 K)"
    for button in ("#save-csv", "#save-svg"):
        name, content = download(viewer, button)
        assert "changed" in name and said in content.decode()
    viewer.run("cldit.state.line = [[-20, 0], [20, 0]]; cldit.set('wall_K', 1500)")
    viewer.page.wait_for_selector("#profile path.curve")
    assert download(viewer, "#save-profile")[1].decode().startswith(f"# {said}\n")
    assert "made (changed)" in (viewer.page.get_attribute(".map svg", "aria-label") or "")


def test_values_beyond_the_scale_are_marked(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for())
    open_page(viewer, tmp_path, run)
    kelvin = run.maps.apparent_temperature_K[np.isfinite(run.maps.apparent_temperature_K)]
    for low, high in ((300, 700), (300, 380), (380, 390)):
        viewer.run("(limits) => { cldit.state.limits.temperature = limits; }", [low, high])
        viewer.set({})
        below, above = int(np.sum(kelvin < low)), int(np.sum(kelvin > high))
        assert viewer.page.locator(".map .beyond").count() == (below > 0) + (above > 0)
        text = viewer.page.inner_text(".map")
        assert (f"{above} above {high}" in text) == (above > 0)
        assert (f"{below} below {low}" in text) == (below > 0)


def test_zoom_and_move(viewer: Viewer, tmp_path: Path) -> None:
    """By keys, buttons, wheel and drag; the cursor's values stay those of its place."""
    run = made_run(scene_for())
    open_page(viewer, tmp_path, run)
    size = "[...document.querySelectorAll('.map canvas')].map((one) => [one.width, one.height])[0]"
    assert viewer.run(size) == [40, 30]
    viewer.page.click("#spray")
    columns, rows = viewer.run(size)
    assert 20 < columns < 40 and 20 < rows <= 30
    viewer.page.focus(".map")
    viewer.page.keyboard.press("0")
    viewer.page.keyboard.press("+")
    assert viewer.run(size)[0] < 30
    box = viewer.page.locator(".map canvas").bounding_box()
    assert box is not None
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    viewer.page.mouse.move(*middle)
    viewer.page.wait_for_selector("#readout td")
    before = viewer.page.locator("#readout tr").nth(1).inner_text()
    viewer.page.mouse.wheel(0, -300)
    assert viewer.run(size)[0] <= 24
    viewer.page.mouse.move(middle[0] + 1, middle[1])
    viewer.page.wait_for_timeout(200)
    assert viewer.page.locator("#readout tr").nth(1).inner_text() == before
    held = viewer.run("cldit.state.view")
    viewer.page.click("#moving")
    viewer.page.mouse.move(*middle)
    viewer.page.mouse.down()
    viewer.page.mouse.move(middle[0] + 60, middle[1], steps=3)
    viewer.page.mouse.up()
    assert viewer.run("cldit.state.view")[0] < held[0]
    assert "Drag across a map" in (viewer.page.text_content("#profile") or "")
    viewer.page.click("#whole")
    assert viewer.run(size) == [40, 30]


def test_sliders_span_the_run_and_numbers_more(viewer: Viewer, tmp_path: Path) -> None:
    open_page(viewer, tmp_path, made_run(scene_for()))  # 420 to 560 K
    low, high = (
        float(viewer.page.get_attribute("#range-wall_K", end) or 0) for end in ("min", "max")
    )
    assert (low, high) == (350.0, 630.0)
    assert viewer.set({"wall_K": 1500.0})["wall_K"] == 1500.0
    assert float(viewer.page.get_attribute("#range-wall_K", "max") or 0) == 1500.0


def test_the_papers_colours(viewer: Viewer, tmp_path: Path) -> None:
    """Hue at full saturation where the spray is opaque; half of it at half the emissivity."""
    run = made_run(scene_for(windows=[], patches=[]), depth=6.0)
    open_page(viewer, tmp_path, run)
    viewer.page.select_option("#colours", "hue")
    viewer.drawn()
    flat = viewer.run(
        "(() => { const one = document.querySelector('.map canvas');"
        " return [...one.getContext('2d').getImageData(0, 0, one.width, one.height).data]; })()"
    )
    pixels = np.array(flat).reshape(30, 40, 4)[..., :3] / 255.0
    known = np.isfinite(run.maps.apparent_temperature_K) & (run.maps.reason == 0)
    np.testing.assert_allclose(pixels[known].max(axis=-1), 1.0, atol=1e-6)
    # a colour's step is 1 / 255 of its channel
    saturation = 1.0 - pixels[known].min(axis=-1)
    np.testing.assert_allclose(saturation, run.maps.emissivity[known], atol=2.1 / 255)
