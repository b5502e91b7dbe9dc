"""Rays that a run chooses for each pixel, against the exact mean over its area."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run
from cldit.scene.spray import GridSpray

EDGE = 0.2
PIXELS = 48


def blocks(run_block: Callable[..., Run], radius_m: float = 0.05, **sections: Any) -> Run:
    """Even gas on the left, blocks of droplets and gaps on the right; nothing scatters.

    The voxels are cells, and sources constant in them: pixel sampling is the only error.
    """
    filled = np.ones((8, 8, 8), bool)
    filled[4:] = np.random.default_rng(1).random((4, 8, 8)) < 0.4
    camera = {"pixels": [PIXELS, PIXELS], "field_m": [0.14, 0.14], "model": "orthographic"}
    return run_block(
        {
            "droplet_absorption_per_m": 40.0 * filled,
            "droplet_temperature_K": np.where(filled[:, ::-1] & filled, 340.0, 380.0),
        },
        size_m=(EDGE / 2,) * 3,
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 16},
        camera={**camera, **sections.pop("camera", {})},
        background={"temperatures_K": [400.0, 500.0], "radius_m": radius_m},
        transport={"audit": True, "accuracy_K": 1.0, **sections.pop("transport", {})},
    )


def means(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Emissivity and T_app of pixels, by the area of each column of voxels in it."""
    assert isinstance(run.scene.spray, GridSpray)
    with np.load(run.scene.spray.file) as grid:
        depth = grid["droplet_absorption_per_m"] * grid["spacing_m"][1]
        warm = np.asarray(grid["droplet_temperature_K"])
        low, step = grid["origin_m"], grid["spacing_m"]
    filter_um = scene_filter(run.scene)
    light, through = np.zeros((8, 8)), np.ones((8, 8))
    for y in range(8):  # away from the camera
        absorbed = through * -np.expm1(-depth[:, y])
        light += absorbed * band_radiance(warm[:, y], filter_um=filter_um)
        through -= absorbed
    sides = np.linspace(-0.07, 0.07, PIXELS + 1)

    def shares(axis: int) -> np.ndarray:
        """Part (pixels, voxels) of each pixel in front of each voxel."""
        edges = low[axis] + np.arange(9) * step[axis]
        inner = np.minimum(sides[1:, None], edges[1:]) - np.maximum(sides[:-1, None], edges[:-1])
        return np.asarray(np.clip(inner, 0.0, None) * PIXELS / 0.14)

    across, up = shares(0), shares(2)
    emissivity, seen = (up @ each.T @ across.T for each in (1.0 - through, light))
    apparent = np.divide(seen, emissivity, out=np.ones_like(seen), where=emissivity > 0.01)
    return emissivity[::-1], temperature_of_radiance(apparent[::-1], filter_um=filter_um)


@pytest.mark.parametrize("asked_K", [1.0, 0.4])
def test_asked_is_stated_and_kept(run_block: Callable[..., Run], asked_K: float) -> None:
    """Against exact areas. The sample states the error to a fifth or so, and a standard error is
    added."""
    run = blocks(run_block, radius_m=0.2, transport={"accuracy_K": asked_K, "seed": 3})
    one = blocks(run_block, radius_m=0.2, camera={"rays_per_pixel": 1}, transport={"audit": False})
    emissivity, temperature_K = means(run)
    assert np.mean(np.abs(run.maps.emissivity - emissivity)) < 0.02
    assert run.errors is not None and run.info.plan is not None
    (cause,) = run.errors.causes
    share_K = run.info.plan["shares_K"]["pixel sampling"]
    assert cause.name == "pixel sampling" and cause.error_K is not None
    assert cause.error_K <= 1.1 * share_K < asked_K

    def error_K(other: Run) -> float:
        both = other.maps.has_temperature & (emissivity > 0.05)
        apart = other.maps.apparent_temperature_K - temperature_K
        return float(np.sqrt(np.mean(apart[both].astype(float) ** 2)))

    assert error_K(one) > 2.0 * asked_K  # else there is nothing to choose
    assert 0.6 < cause.error_K / error_K(run) < 1.7, error_K(run)


def test_rays_go_where_they_are_needed(run_block: Callable[..., Run]) -> None:
    """The even half keeps one ray; edges of blocks, and the rim of a disc, get more."""
    run = blocks(run_block)
    one = blocks(run_block, camera={"rays_per_pixel": 1}, transport={"audit": False})
    changed = run.weights.background != one.weights.background
    inner = np.zeros((PIXELS, PIXELS), bool)
    inner[20:28, 14:22] = True  # 0.5 to 3 cm left of the middle, within the disc
    assert one.maps.has_temperature[inner].all()
    assert not changed[inner].any()
    mirrored = inner[:, ::-1]
    assert changed[mirrored].mean() > 0.3
    shares = run.reference.background
    rim = (shares > 0.5) & (shares < 1.0)
    assert np.count_nonzero(rim) > 20  # of single rays there is none
    assert run.info.counts["rays"] < 16 * PIXELS**2


def test_no_audit_no_choice(run_block: Callable[..., Run]) -> None:
    run = blocks(run_block, transport={"audit": False})
    assert "rays" not in run.info.counts


def test_the_most_rays_are_said(run_block: Callable[..., Run]) -> None:
    """Edges of blocks lie anywhere in 256 rows of rays: some 40 K / 256 / 12^(1/2) are left."""
    run = blocks(run_block, 0.2, transport={"accuracy_K": 0.01}, camera={"pixels": [6, 6]})
    assert run.errors is not None and (run.errors.total_K or 0.0) > 0.01
    assert any("no pixel has more than 256 rays" in text for text in run.info.remarks)
