"""Runs made up for tests of `cldit view`, and a real Chromium to open its pages in."""

from __future__ import annotations

import base64
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.dit.evaluate import evaluated, sensor_of
from cldit.optics.response import edges_um, scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.radiance.weights import Weights
from cldit.run import Run, RunInfo
from cldit.scene import Scene, parse_scene
from cldit.show.view import save_page
from cldit.show.view.traced import traced_item

if TYPE_CHECKING:
    from playwright.sync_api import Page

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def chromium() -> str:
    """Path of a Chromium; skips where there is none, or nothing to drive it."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next((path for name in _NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no Chromium here ({', '.join(_NAMES)})")
    return found


def scene_for(**changes: Any) -> Scene:
    """40 x 30 pixels before a disc with a reflecting emissivity, both windows and a warm patch."""
    data: dict[str, Any] = {
        "name": "made",
        "spray": {"model": "none"},
        "camera": {"pixels": [40, 30], "field_m": [0.16, 0.12], "surroundings_K": 300.0},
        "background": {
            "temperatures_K": [420.0, 450.0, 500.0, 560.0],
            "radius_m": 0.05,
            "emissivity": 0.93,
            "surroundings_K": 330.0,
        },
        "walls": {"temperature_K": 440.0},
        "windows": [
            {"side": "front", "material": "sapphire", "temperature_K": 360.0},
            {"side": "rear", "material": "CaF2", "temperature_K": 400.0},
        ],
        "patches": [
            {
                "name": "flange",
                "centre_m": [0.06, 0.0, -0.05],
                "facing": "-x",
                "radius_m": 0.03,
                "temperature_K": 600.0,
                "emissivity": 0.7,
            }
        ],
        "plan": {"shots": 4, "references": 3},
    }
    return parse_scene({**data, **changes})


def made_run(scene: Scene, *, depth: float = 2.0, nodes: int = 1) -> Run:
    """A cold blob of this optical depth that also scatters, in so many spectral nodes.

    Args:
        scene: as `scene_for` gives it.
        depth: through its middle; from node to node it differs by a third.
        nodes: of the filter.
    """
    filter_um = scene_filter(scene)
    at_K = reference_temperature_K(scene.background.temperatures_K)
    quadrature = Quadrature.grey(filter_um, reference_K=at_K)
    if nodes > 1:
        low, high = edges_um(filter_um)
        edges = tuple(float(one) for one in np.linspace(low, high, 2 * nodes + 1))
        edges = (low, *edges[1:-1], high)
        shares = np.zeros((nodes, 2 * nodes))
        shares[np.arange(2 * nodes) % nodes, np.arange(2 * nodes)] = 1.0
        members = tuple(tuple(float(one) for one in row) for row in shares)
        quadrature = Quadrature(filter_um, edges, members, at_K)
    columns, rows = scene.camera.pixels
    width, height = scene.camera.field_m
    x = (np.arange(columns) + 0.5) / columns * width - width / 2
    z = (np.arange(rows) + 0.5) / rows * height - height / 2
    r = np.hypot(x[None, :], z[:, None])
    disc = np.clip((scene.background.radius_m - r) / 0.004 + 0.5, 0.0, 1.0)  # pixels across its rim
    flange = 0.2 * np.exp(-((x[None, :] - 0.07) ** 2 + z[:, None] ** 2) / 0.02**2)
    wall = (1.0 - disc) * (1.0 - flange)
    spread = np.where(r < 0.045, np.exp(-((r / 0.02) ** 2)), 0.0)  # nothing at all beyond

    def traced(node: int) -> Weights:
        tau = depth * (1.0 + node / 3.0) * spread
        through = np.exp(-tau)
        scattered = 0.2 * (1.0 - through)
        glow = 0.8 * (1.0 - through) * float(quadrature.nodes[node].radiance(370.0))
        images = (
            through * disc,
            through * wall + 0.8 * scattered,
            0.25 * glow,
            0.75 * glow,
            through * (1.0 - disc) * flange + 0.2 * scattered,
        )
        return _weights(scene, images)

    bare = _weights(scene, (disc, wall, 0.0 * disc, 0.0 * disc, (1.0 - disc) * flange))
    spectral = tuple(traced(node) for node in range(nodes))
    sensor = sensor_of(scene, quadrature, (spectral, bare))
    return Run(
        scene=scene,
        weights=spectral[0],
        reference=bare,
        maps=evaluated(scene, quadrature, spectral, bare, sensor),
        info=RunInfo(
            device="none",
            device_reason="made up",
            stages=(),
            accuracy_K=None,
            spray={},
            counts={},
            defines={},
            precision="float32",
            integration_time_s=sensor.integration_time_s,
        ),
        quadrature=quadrature,
        spectral=spectral,
        error_maps={"total": np.where(spread > 0, 0.5 + spread, np.nan).astype(np.float32)},
    )


def as_asked(scene: Scene, asked: dict[str, Any]) -> Scene:
    """The scene with the temperatures, errors and shots that a page says it evaluated."""
    return scene.with_(
        **{
            "walls.temperature_K": asked["wall_K"],
            "background.temperatures_K": asked["backgrounds_K"],
            "background.emissivity": asked["emissivity"],
            "camera.sensor.read_noise_electrons": asked["read_noise_electrons"],
            "plan.shots": asked["shots"],
        }
    )


def _weights(scene: Scene, images: tuple[NDArray[Any], ...]) -> Weights:
    plain = [np.asarray(image, np.float32) for image in images]
    patches = {"flange": plain[4]} if scene.patches else {}
    return Weights(*plain[:4], patches=patches)


class Viewer:
    """A page in Chromium, and what it asked for and complained of."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.asked: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on(
            "console",
            lambda line: self.complaints.append(line.text) if line.type == "error" else None,
        )

    def open(self, path: Path) -> None:
        """Opens a file and waits until all of it is there."""
        self.page.goto(path.resolve().as_uri())
        self.page.wait_for_selector("body[data-all=yes]", timeout=60_000)
        self.run("cldit.look(null)")  # the whole image

    def run(self, code: str, given: object = None) -> Any:
        """What a line of JavaScript gives."""
        return self.page.evaluate(code, given)

    def set(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Moves sliders from the run's own values; what item 0 then computes with."""
        self.page.click("#reset")
        for name, value in values.items():
            self.run("([name, value]) => cldit.set(name, value)", [name, value])
        self.drawn()
        scene: dict[str, Any] = self.run("cldit.scene(0)")
        return scene

    def drawn(self) -> None:
        """Waits until the newest state is drawn."""
        self.run("cldit.drawn()")

    def numbers(self, **given: object) -> NDArray[np.float32]:
        """(H, W) of `item` and `name`, or of a `panel`."""
        return self._image(self.run("(given) => cldit.numbers(given)", given), "values")

    def errors(self, panel: int) -> NDArray[np.float32]:
        """(H, W) stated errors of a panel."""
        return self._image(self.run("(given) => cldit.numbers(given)", {"panel": panel}), "error")

    def _image(self, found: Mapping[str, Any], name: str) -> NDArray[np.float32]:
        flat = np.frombuffer(base64.b64decode(found[name]), np.float32)
        return flat.reshape(found["rows"], found["columns"])


def open_page(viewer: Viewer, folder: Path, *runs: Run) -> None:
    """Saves the page of these runs in the folder, and opens it."""
    save_page(folder / "page.html", [traced_item(run, source="made.yaml") for run in runs])
    viewer.open(folder / "page.html")


def screenshot(page: Path, picture: Path) -> None:
    """The picture of docs/view.md: warmer walls, and a profile across the spray.

    Args:
        page: that `cldit view` wrote of gdi.
        picture: the PNG.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium())
        viewer = Viewer(browser.new_page(viewport={"width": 1180, "height": 1080}))
        viewer.open(page)
        viewer.set({"wall_K": 500.0})
        viewer.page.click("#spray")
        box = viewer.page.locator(".map canvas").first.bounding_box()
        assert box is not None
        left, right = (box["x"] + share * box["width"] for share in (0.08, 0.92))
        height = box["y"] + 0.55 * box["height"]
        viewer.page.mouse.move(left, height)
        viewer.page.mouse.down()
        viewer.page.mouse.move(right, height, steps=5)
        viewer.page.mouse.up()
        viewer.page.wait_for_selector("#profile path.curve")
        viewer.run("document.activeElement.blur()")
        viewer.page.wait_for_timeout(300)
        viewer.page.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":  # python -m tests.viewed runs/gdi/view.html docs/view.png
    screenshot(Path(sys.argv[1]), Path(sys.argv[2]))
