"""`cldit view` on what the other commands made: gdi, a CFD run, a measurement; size and time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from cldit.cli import main
from cldit.dit.maps import Maps
from cldit.gpu.device import Device
from cldit.radiance.weights import Weights
from cldit.run import open_run, reevaluated, simulate
from cldit.scene import Scene, load_scene
from cldit.show.view import Item, page_html
from cldit.show.view.traced import traced_item
from tests.small_scenes import WHOLE_KEYS
from tests.viewed import Viewer, chromium, made_run, scene_for

pytestmark = pytest.mark.slow
SMALL: dict[str, Any] = {
    "camera.pixels": [80, 80],
    **WHOLE_KEYS,
    "transport.accuracy_K": 8.0,
    "plan.shots": 2,
}
MOST_BYTES = 15e6


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path)
        viewer = Viewer(browser.new_page())
        yield viewer
        assert viewer.complaints == []
        browser.close()


def cfd_case(folder: Path) -> Path:
    """A ball of vapour with 300 parcels in it, as text tables."""
    edge = 4e-3
    place = (np.indices((12, 12, 12)).reshape(3, -1).T - 5.5) * edge + [0.0, 0.0, -0.02]
    fuel = 0.2 * np.exp(-(((place - [0.0, 0.0, -0.02]) ** 2).sum(axis=1)) / 0.01**2)
    cells = [
        f"{x:.6f},{y:.6f},{z:.6f},{edge**3:.6e},{500 - 500 * q:.2f},6e5,{q:.6f}"
        for (x, y, z), q in zip(place, fuel, strict=True)
    ]
    drops = np.random.default_rng(1).normal(0.0, 0.006, (300, 3)) - np.array([0.0, 0.0, 0.02])
    parcels = [f"{x:.6f},{y:.6f},{z:.6f},0,0,-50,2e-5,3e3,350" for x, y, z in drops]
    for name, head, rows in (
        ("cells", "x,y,z,Vol,Temp,Pres,Y", cells),
        ("parcels", "x,y,z,u,v,w,d,N,T", parcels),
    ):
        (folder / f"{name}.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    case = folder / "case.yaml"
    case.write_text(
        "time_s: 0.001\n"
        "cells: {file: cells.csv, position: [x, y, z], volume: Vol, temperature: Temp,\n"
        "  pressure: Pres, fuel: Y}\n"
        "parcels: {file: parcels.csv, position: [x, y, z], velocity: [u, v, w], diameter: d,\n"
        "  number: N, temperature: T, density: 684}\n",
        encoding="utf-8",
    )
    return case


def with_cfd(folder: Path) -> Scene:
    spray = {
        "model": "cfd",
        "file": str(cfd_case(folder)),
        "nozzle_m": [0.0, 0.0, 0.0],
        "axis": "-z",
    }
    return load_scene("gdi-cone").with_(spray=spray, name="cfd", **SMALL)


@pytest.mark.parametrize("kind", ["gdi", "cfd"])
def test_traced_runs(
    viewer: Viewer, device: Device, tables: Path, tmp_path: Path, kind: str
) -> None:
    scene = load_scene("gdi-cone").with_(**SMALL) if kind == "gdi" else with_cfd(tmp_path)
    folder = tmp_path / "run"
    simulate(scene, folder, device=device, cache=tables)
    page = tmp_path / "page.html"
    done = CliRunner().invoke(main, ["view", str(folder), "--save", str(page)])
    assert done.exit_code == 0, done.output
    viewer.open(page)
    run = open_run(folder)
    for change in ({}, {"wall_K": 350.0}, {"lowest_K": 380.0, "highest_K": 700.0, "shots": 9}):
        asked = viewer.set(change)
        other = scene.with_(
            **{
                "walls.temperature_K": asked["wall_K"],
                "background.temperatures_K": asked["backgrounds_K"],
                "plan.shots": asked["shots"],
            }
        )
        maps = reevaluated(run, other).maps
        assert np.array_equal(viewer.numbers(item=0, name="reason"), maps.reason)
        known = np.isfinite(maps.apparent_temperature_K)
        assert known.sum() > 100
        kelvin = viewer.numbers(item=0, name="temperature")[known]
        assert np.max(np.abs(kelvin / maps.apparent_temperature_K[known] - 1.0)) < 1e-5
        emissivity = viewer.numbers(item=0, name="emissivity")
        assert np.nanmax(np.abs(emissivity - maps.emissivity)) < 1e-5


def test_a_measurement(viewer: Viewer, tmp_path: Path) -> None:
    """What the simulated rig recorded of gdi, beside the run itself: they agree within errors."""
    folder, page = tmp_path / "run", tmp_path / "page.html"
    words = ["run", "gdi-cone", "--pixels", "80", "--accuracy", "8", "--out", str(folder)]
    done = CliRunner().invoke(main, [*words, "--set", "plan.shots=2"])
    assert done.exit_code == 0, done.output
    words = ["view", str(folder), str(folder / "acquisition"), "--save", str(page)]
    assert CliRunner().invoke(main, words).exit_code == 0
    viewer.open(page)
    stored = Maps.load(folder / "acquisition" / "maps").apparent_temperature_K
    shown = viewer.numbers(item=1, name="temperature")
    assert np.array_equal(np.isnan(shown), np.isnan(stored))
    assert np.nanmax(np.abs(shown / stored - 1.0)) < 1e-5
    viewer.page.select_option("#other", "1")
    viewer.drawn()
    apart, stated = viewer.numbers(panel=2), viewer.errors(2)
    known = np.isfinite(apart) & np.isfinite(stated)
    assert known.sum() > 200
    # Normal errors are within twice theirs in 95 % of the pixels; those stated of the simulation
    # are shared by both pictures here, so more are.
    assert np.mean(np.abs(apart[known]) < 2.0 * stated[known]) > 0.95


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


def test_a_million_pixels_of_spray_can_be_mailed() -> None:
    """The worst case: spray in every pixel."""
    item = million(0.05)
    assert item.arrays["covered"].mean() > 0.99
    assert len(page_html([item])) < MOST_BYTES
