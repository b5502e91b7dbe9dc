"""Reports of runs and optics: results first, details folded, figures with names and units."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.prepare.spray_factory import make_spray
from cldit.radiance.weights import Weights
from cldit.run import open_run
from cldit.scene import load_scene, parse_scene
from cldit.show.figures.maps import shares_of_light
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.readable import human, human_figures
from cldit.show.figures.style import png_of
from cldit.show.report.optics_summary import SceneOptics, scene_optics
from cldit.show.report.run_report import write_run_report
from tests.command_line import command

RUN = Path(__file__).parents[3] / "data" / "run-0.1.0"


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("report") / "run"
    shutil.copytree(RUN, folder)
    return write_run_report(open_run(folder)).read_text(encoding="utf-8")


def test_details_are_folded(html: str) -> None:
    folded = re.findall(r"<summary><h2>(.*?)</h2>", html)
    assert {"Spray", "Trace", "Run times", "Computed with", "Pixels"} <= set(folded)
    assert "<details open" not in html and "temperatures_K:" not in html  # nor the scene's YAML


def test_the_result_is_under_the_figure(html: str) -> None:
    caption = re.search(r"<figcaption>(.*?)</figcaption>", html)
    assert caption is not None
    assert re.search(r"\d+ to \d+ K in \d+ of \d+ pixels", caption[1])


def test_a_share_that_is_nowhere_visible_has_no_panel() -> None:
    """Here the droplets send 1 % of the vapour's light: all of their panel would be black."""
    ones = np.ones((2, 3), np.float32)
    weights = Weights(0.0 * ones, 0.0 * ones, ones, 0.01 * ones)
    bare = Weights(ones, 0.0 * ones, 0.0 * ones, 0.0 * ones)
    panels, _ = shares_of_light(weights, bare, background=1.0, wall=1.0, patches={})
    assert [panel.title for panel in panels] == ["share of vapour in the signal"]


@pytest.mark.parametrize(
    ("key", "value", "name", "text"),
    [
        ("injected_mass_kg", 1.267e-5, "injected mass", "12.67 mg"),
        ("liquid_penetration_m", 0.032679, "liquid penetration", "32.68 mm"),
        ("sauter_mean_diameter_at_15_mm_m", 9e-6, "Sauter mean diameter at 15 mm", "9 µm"),
        ("coldest_K", 462.377, "coldest gas", "462.4 K (189 °C)"),
        ("droplet_scattering_per_m_max", 1234.56, "largest droplet scattering", "1235 1/m"),
        ("wet_bulb_K", 385.85, "wet-bulb temperature", "385.9 K (113 °C)"),
        ("parcels", 585924.0, "parcels", "585924"),
        ("flow_coefficient", 0.28005, "flow coefficient", "0.2801"),
        ("x", math.nan, "x", "nan"),
        ("droplets", 3.2305e300, "droplets", "3.23e+300"),
    ],
)
def test_name_and_unit(key: str, value: float, name: str, text: str) -> None:
    assert human(key, value) == (name, text)


@pytest.mark.parametrize(
    ("name", "coarse"),
    [
        ("gdi", {"spray.time_s": 1e-4, "spray.box.spacing_m": 4e-3}),
        ("gdi-cone", {"spray.spacing_m": 4e-3}),
        ("methane-jet", {"spray.time_s": 3e-4, "spray.box.spacing_m": 4e-3}),
        ("droplets-only", {"spray.spacing_m": 4e-3}),
        ("empty", {}),
    ],
)
def test_figures_of_shipped_scenes_have_names_of_their_own(
    name: str, coarse: dict[str, float], device: Device, tables: Path
) -> None:
    notes = make_spray(load_scene(name).with_(**coarse).spray, device, cache=tables).notes
    assert len(human_figures(notes)) == len(notes)


def test_two_keys_of_one_name_stay_two() -> None:
    with pytest.raises(ValueError, match="mass"):
        human_figures({"mass_kg": 1.0, "mass_m": 2.0})


PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def gdi(tables: Path) -> SceneOptics:
    return scene_optics(load_scene("gdi-cone"), cache=tables)


def test_rows(gdi: SceneOptics) -> None:
    rows = {row.quantity: row for row in gdi.rows}
    k = rows["k of the liquid"]
    assert (k.scene, k.paper) == ("0.0341", "0.0341")
    assert float(k.data) == pytest.approx(0.0483, abs=2e-4)
    assert k.note.startswith("estimate")
    assert rows["D32 at the nozzle, µm"].scene == "9.00"
    assert rows["D10 at the nozzle, µm"].scene == "6.00"
    error = rows["largest error of the table"].scene
    assert float(error.removesuffix(" %")) < 0.1
    assert any("estimate" in source for source in gdi.sources)


def test_picture_of_gas(tables: Path) -> None:
    methane = scene_optics(load_scene("methane-jet"), cache=tables)
    assert methane.droplets is None and methane.growth
    (curve,) = methane.growth
    assert (curve.emissivity <= curve.beer + 1e-9).all()
    assert png_of(optics_figure(methane)).startswith(PNG)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(
            {"spray": {"model": "cone", "droplets": {"diameter_um": 9.0}}}, marks=pytest.mark.slow
        ),
        pytest.param(
            {"spray": {"model": "cone", "droplets": {"d_um": 10.0, "q": 2.0}}},
            marks=pytest.mark.slow,
        ),
        {"spray": {"model": "none"}, "optics": {"filter_um": [8.0, 12.0], "wavelength_um": 10.0}},
    ],
)
def test_scenes_with_less_data(change: dict[str, object], tables: Path) -> None:
    """One size, infinitely many small ones, a filter outside all data."""
    found = scene_optics(parse_scene({"name": "x", **change}), cache=tables)
    assert png_of(optics_figure(found)).startswith(PNG)


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tables: Path) -> None:
    monkeypatch.setattr("cldit.cli.optics.default_cache", lambda: tables)
    picture = tmp_path / "new" / "gdi.png"
    said = command("show", "gdi", "--part", "optics", "--out", picture).output
    assert "k of the liquid" in said and "0.0483" in said
    assert picture.read_bytes().startswith(PNG)
    command("show", "no-such-scene", "--part", "optics", status=1)
