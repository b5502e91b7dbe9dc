"""T_app in the page's script and in `cldit.radiance.apparent_temperature`: one formula.

The script runs in Node.js, without a browser; `tests/system/test_view.py` opens whole pages.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.radiance.weights import Weights
from cldit.run import Run, reevaluated
from cldit.scene import Scene
from cldit.show.view import Item, page
from cldit.show.view.packing import packed
from cldit.show.view.traced import traced_item
from tests.viewed import as_asked, made_run, scene_for

SCRIPTS = ("quantities", "unpack", "planck", "boundary", "lines", "traced")
MAPS = {
    "temperature": "apparent_temperature_K",
    "temperature_error": "apparent_temperature_standard_error_K",
    "emissivity": "emissivity",
    "emissivity_error": "emissivity_standard_error",
    "reason": "reason",
}


def by_node(folder: Path, program: str, scripts: Sequence[str], *arguments: Path) -> Any:
    """Data that a program beside this file prints, given these scripts of the page as one file."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js here (node)")
    script = "\n".join(page._source(f"script/{name}.js") for name in scripts)
    (folder / "script.js").write_text(script, encoding="utf-8")
    words: list[str | Path] = [node, Path(__file__).with_name(program), folder / "script.js"]
    words += arguments
    finished = subprocess.run(words, capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


def item_data(item: Item) -> dict[str, Any]:
    """Head and packed arrays of an item, as the page passes them to its worker."""
    arrays = {name: packed(array) for name, array in item.arrays.items()}
    plain = {name: {"head": head, "text": text} for name, (head, text) in arrays.items()}
    return {"head": item.head, "arrays": plain}


def by_script(
    folder: Path, runs: Sequence[Run], changes: Sequence[Mapping[str, float]]
) -> list[tuple[Scene, dict[str, Floats]]]:
    """The scene and the maps (H, W) of each run and change, as the page computes them."""
    given = []
    for run, asked in zip(runs, changes, strict=True):
        given.append({**item_data(traced_item(run, source="made.yaml")), "asked": dict(asked)})
    (folder / "given.json").write_text(json.dumps(given), encoding="utf-8")
    read = by_node(folder, "maps.mjs", SCRIPTS, folder / "given.json")
    out = []
    for run, found in zip(runs, read, strict=True):
        images = {
            name: np.array(found[name], float).reshape(run.maps.emissivity.shape) for name in MAPS
        }
        out.append((as_asked(run.scene, found["scene"]), images))
    return out


def stacked(weights: Weights) -> Floats:
    """(C, N) weights in the order of `TraceTemperature`."""
    images = weights.images
    names = ("background", "wall", *weights.patches, "vapour", "liquid")
    return np.array([images[name].reshape(-1) for name in names], float)


def shifted(run: Run, error: Weights, sign: float) -> Run:
    """The run with an error of its weights."""
    images = run.weights.images
    moved = {name: images[name] + np.float32(sign) * one for name, one in error.images.items()}
    weights = Weights.of(moved)
    return replace(run, weights=weights, spectral=(weights,))


@pytest.mark.parametrize("patches", [True, False], ids=["patch", "walls alone"])
def test_temperature_and_its_first_order_error(tmp_path: Path, patches: bool) -> None:
    """A reference of background alone: to 1e-5, as weights have relative errors of 2e-6.

    Weights that are off by 1e-3 of what a spray changes move T_app by its first-order error: 0.1 to
    1 K, of which rounding leaves 2e-3 K in a difference of two.
    """
    run = made_run(scene_for(windows=[]) if patches else scene_for(windows=[], patches=[]))
    ramp = np.linspace(0.5, 1.5, run.weights.wall.shape[1], dtype=np.float32)
    uneven = replace(run.weights, wall=run.weights.wall * ramp)  # or T_app is the same all over
    run = replace(run, weights=uneven, spectral=(uneven,))
    change = {"wall_K": 515.0, "lowest_K": 350.0, "highest_K": 700.0}
    error = Weights.of(
        {
            name: 1e-3 * (one - run.reference.images[name]) * (2.0 if name == "wall" else 1.0)
            for name, one in run.weights.images.items()
        }
    )
    error.wall[:] += 1e-3 * (1.0 - run.weights.background)
    both = [shifted(run, error, sign) for sign in (1.0, -1.0)]
    (scene, maps), (_, more), (_, less) = by_script(tmp_path, [run, *both], [change] * 3)
    assert scene.walls.temperature_K == 515.0
    temperature = TraceTemperature.of(scene, [1.0, 1.0])
    planes = stacked(run.weights)
    here = (run.reference.background.reshape(-1) == 1.0) & (planes[0] < 0.95)
    assert np.count_nonzero(here) > 100
    shown_K = maps["temperature"].reshape(-1)[here]
    assert np.ptp(shown_K) > 10.0
    np.testing.assert_allclose(shown_K, temperature.temperature_K(planes[:, here]), rtol=1e-5)
    moved_K = (more["temperature"] - less["temperature"]).reshape(-1)[here] / 2
    expected = temperature.error_K(planes[:, here], stacked(error)[:, here])
    assert np.max(np.abs(expected)) > 0.1
    np.testing.assert_allclose(moved_K, expected, atol=2e-3)


@pytest.mark.parametrize("nodes", [1, 4])
def test_maps_and_standard_errors(tmp_path: Path, nodes: int) -> None:
    """With windows, and in several nodes: what `reevaluated` gives, to 1e-5."""
    preset = {"optics": {"preset": "spectral"}} if nodes > 1 else {}
    run = made_run(scene_for(**preset), nodes=nodes)
    changes: list[dict[str, float]] = [{}, {"emissivity": 0.6}, {"shots": 2}]
    for scene, maps in by_script(tmp_path, [run] * 3, changes):
        expected = reevaluated(run, scene).maps
        for name, of in MAPS.items():
            np.testing.assert_allclose(maps[name], getattr(expected, of), rtol=1e-5, atol=1e-5)


def test_a_link_restores_the_settings(tmp_path: Path) -> None:
    """Items, map, colours, part, profile, scale and sliders; what the page lacks is named."""
    out = by_node(tmp_path, "link.mjs", ["link"])
    assert out["untouched"] == ""
    assert out["read"] == {
        "state": {
            "one": 2,
            "other": 0,
            "quantity": "emissivity",
            "colours": "hue",
            "view": None,
            "line": [[-20, 0.5], [20, -1.25]],
            "limits": {"emissivity": [0, 0.25], "emissivity apart": [-0.1, 0.1]},
        },
        "asked": {"wall_K": 515.5},
        "refused": [],
    }
    assert out["refused"] == ["one", "colours", "view", "limits", "wall_K", "x"]


def test_moves_take_a_tenth_of_a_second(tmp_path: Path) -> None:
    """95 % of the moves of a slider with spray in all of 500 x 400 pixels, the shipped size.

    A tenth of a second is perceived as immediate (Card et al., 1991). The time is of the processor,
    as other processes run beside the tests.
    """
    camera = {"pixels": [500, 400], "field_m": [0.05, 0.04]}
    item = traced_item(made_run(scene_for(camera=camera)), source="made.yaml")
    assert item.arrays["covered"].mean() > 0.99
    (tmp_path / "given.json").write_text(json.dumps(item_data(item)), encoding="utf-8")
    moves_ms = by_node(tmp_path, "moves.mjs", page._WORKER, tmp_path / "given.json")
    assert len(moves_ms) == 40
    assert np.quantile(moves_ms, 0.95) < 100.0
