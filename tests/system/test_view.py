"""`cldit view` in a real Chromium: right to 1e-5, without network. The formulas of its script, with
windows and for other sliders, are in tests/unit/show/view/test_script.py.

Without Chromium or playwright these tests are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.run import open_run, reevaluated
from cldit.show.view import Item, page_html, save_page, view_items
from cldit.show.view.traced import traced_item
from tests.viewed import Viewer, as_asked, made_run, open_page, scene_for

OLD = Path(__file__).parents[1] / "data" / "run-0.1.0"
MAPS = {
    "temperature": "apparent_temperature_K",
    "temperature_error": "apparent_temperature_standard_error_K",
    "emissivity": "emissivity",
    "emissivity_error": "emissivity_standard_error",
}


def off(page: NDArray[np.float32], given: NDArray[np.float32], *, share: bool) -> float:
    """Largest difference, as a share of the number or of 1; both have values in the same places."""
    assert np.array_equal(np.isnan(page), np.isnan(given))
    known = np.isfinite(given)
    difference = np.abs(page[known].astype(float) - given[known])
    return float(np.max(difference / (np.abs(given[known]) if share else 1.0), initial=0.0))


def test_several_nodes_and_temperatures_that_are_bound(viewer: Viewer, tmp_path: Path) -> None:
    """Sliders that the trace does not serve are held, and say why."""
    run = made_run(scene_for(optics={"preset": "spectral"}), nodes=4)
    open_page(viewer, tmp_path, run)
    asked = viewer.set({"emissivity": 0.4, "read_noise_electrons": 900.0, "shots": 3})
    expected = reevaluated(run, as_asked(run.scene, asked))
    assert asked["integration_time_s"] == expected.info.integration_time_s
    for name, of in MAPS.items():
        page = viewer.numbers(item=0, name=name)
        assert off(page, getattr(expected.maps, of), share=name != "emissivity") < 1e-5
    for name in ("lowest_K", "highest_K", "wall_K"):
        assert viewer.page.locator(f"#range-{name}").is_disabled()
        assert "wavelengths were chosen" in viewer.page.inner_text(f"#why-{name}")
    assert viewer.set({"wall_K": 700.0})["wall_K"] == run.scene.walls.temperature_K


def test_what_the_camera_sees(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for())
    open_page(viewer, tmp_path, run)
    asked = viewer.set({"signal_K": 480.0, "wall_K": 500.0})
    scene = as_asked(run.scene, asked)
    filter_um = scene_filter(scene)
    whole = Boundary.in_filter(
        Surroundings.from_scene(scene),
        filter_um,
        reference_K=float(np.median(scene.background.temperatures_K)),
    )
    seen = camera_radiance(run.spectral, [whole], background_K=480.0)
    expected = temperature_of_radiance(seen, filter_um=filter_um).astype(np.float32)
    assert off(viewer.numbers(item=0, name="signal"), expected, share=True) < 1e-6


def test_one_background_gives_no_maps_but_a_picture(viewer: Viewer, tmp_path: Path) -> None:
    run = made_run(scene_for(background={"temperatures_K": [450.0], "radius_m": 0.05}))
    open_page(viewer, tmp_path, run)
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
    open_page(viewer, tmp_path, coarse, fine)
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
    open_page(viewer, tmp_path, one, other)
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


def million(field_m: float) -> Item:
    """1000 x 1000 pixels with noise as a trace has it, a blob of 45 mm radius in the middle."""
    scene = scene_for(
        camera={"pixels": [1000, 1000], "field_m": [field_m, field_m]}, windows=[], patches=[]
    )
    run, rng = made_run(scene), np.random.default_rng(7)
    bare = run.reference.images

    def noisy(images: Mapping[str, NDArray[np.float32]]) -> Weights:
        """Of what the spray changes, a thousandth."""
        factor = 1 + 1e-3 * rng.standard_normal((1000, 1000), np.float32)
        return Weights.of({k: bare[k] + (image - bare[k]) * factor for k, image in images.items()})

    spectral = tuple(noisy(one.images) for one in run.spectral)
    return traced_item(replace(run, spectral=spectral), source="made.yaml")


@pytest.mark.slow
def test_a_million_pixels_of_spray_can_be_mailed() -> None:
    """The worst case: spray in every pixel."""
    item = million(0.05)
    assert item.arrays["covered"].mean() > 0.99
    assert len(page_html([item])) < 15e6
