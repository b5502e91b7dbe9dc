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
