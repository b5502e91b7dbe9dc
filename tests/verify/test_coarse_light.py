"""Light of larger cells through smaller ones: isothermal, and beside the error of the cells."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.scene import Scene, load_scene
from cldit.transport.trace import Trace, settings_for, trace

EDGE, RADIANCE = 0.04, 7.0


def scene(**more: Any) -> Scene:
    keys = {
        "domain.centre_m": [0.0, 0.0, 0.0],
        "domain.edge_m": EDGE,
        "background.radius_m": 0.03,
        "camera.pixels": [24, 24],
        "camera.field_m": [0.024, 0.024],
        "camera.target_m": [0.0, 0.0, 0.0],
        "camera.rays_per_pixel": 1,
        "transport.accuracy_K": 0.2,
    }
    return load_scene("empty").with_(**keys, **more)


def blob(depth: int, device: Device, *, largest: float) -> Octree:
    """A Gaussian of lumps of droplets in half of the cube's edge, albedo 0.8, of a mean optical
    depth up to `largest` in cells of 1/64 of the cube, given on 128^3 cells in any tree."""
    count, cell_m = 128, EDGE / 128
    at = np.indices((count,) * 3).reshape(3, -1).T[:, ::-1]
    lower = at * cell_m - EDGE / 2
    middle = (lower + cell_m / 2) / EDGE
    radius, inside = np.linalg.norm(middle, axis=1), np.abs(middle).max(axis=1) < 0.25
    lower, radius = lower[inside], radius[inside]
    extinction = largest * 64 / EDGE * np.exp(-((radius / 0.2) ** 2))
    extinction *= np.random.default_rng(2).uniform(0.0, 2.0, len(lower))
    none = np.zeros(len(lower))
    gas = CellSource(
        lower, lower + cell_m, none, none, 0.2 * extinction, 0.8 * extinction,
        0.2 * RADIANCE * extinction,
    )  # fmt: skip
    frame = Frame((-EDGE / 2,) * 3, edge_m=EDGE, depth=depth)
    return build_octree(frame, None, [gas], optical_depth_split=1e-5, device=device)


def image(tree: Octree, device: Device, light: int, *, forward: bool = False) -> Trace:
    given = scene(**{"transport.phase": {"henyey_greenstein": 0.8} if forward else "isotropic"})
    settings = replace(settings_for(given), audit=False, light=light, seed=3)
    return trace(tree, given, device, settings)


@pytest.mark.parametrize("largest", [0.1, 0.8])
def test_an_isothermal_cavity_is_flat(device: Device, largest: float) -> None:
    """Thin, and thick enough for the final gather: all weights, the emission over its radiance,
    sum to 1 to 1e-3 as on equal cells (`tests/verify/test_cavity.py`)."""
    weights = image(blob(6, device, largest=largest), device, 1).weights
    whole = weights.background + weights.wall + weights.liquid / RADIANCE
    assert weights.liquid.max() > 0.1 * RADIANCE
    np.testing.assert_allclose(whole, 1.0, atol=1e-3)


@pytest.mark.parametrize("forward", [False, True], ids=["isotropic", "forward"])
@pytest.mark.parametrize(("largest", "most"), [(0.1, 0.3), (0.8, 0.8)], ids=["thin", "thick"])
def test_the_error_of_cells_is_on_lines_of_sight(
    device: Device, largest: float, most: float, forward: bool
) -> None:
    """Half of the cells' edge for the image alone removes most of the error by the cells.

    Of thin cells 7 and 20 % of it are left. Of thick ones, whose sources vary within them, it is 25
    and 65 %, and 340 % if paths end at wrong places of the boundary. Noise is in both numbers.
    """
    trees = [blob(depth, device, largest=largest) for depth in (5, 6)]
    coarse, fine = (image(tree, device, 0, forward=forward).weights for tree in trees)
    lent = image(trees[1], device, 1, forward=forward).weights
    cells, light = (
        float(np.sqrt(np.mean((one.wall - fine.wall).astype(float) ** 2))) for one in (coarse, lent)
    )
    assert light < most * cells
