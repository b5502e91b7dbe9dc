"""Output of `cldit show --part optics`: right numbers, and every shipped scene."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from cldit.cli import main
from cldit.scene import load_scene, parse_scene
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.style import png_of
from cldit.show.report.optics_summary import SceneOptics, scene_optics

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
    result = CliRunner().invoke(main, ["show", "gdi", "--part", "optics", "--out", str(picture)])
    assert result.exit_code == 0
    assert "k of the liquid" in result.output and "0.0483" in result.output
    assert picture.read_bytes().startswith(PNG)
    result = CliRunner().invoke(main, ["show", "no-such-scene", "--part", "optics"])
    assert result.exit_code == 1
