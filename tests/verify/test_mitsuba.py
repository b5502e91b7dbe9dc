"""Weights against Mitsuba 3, an independent path tracer, where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.bench.case import BenchError
from cldit.gpu.device import Device
from tests.bench.case import Case
from tests.bench.error import path_settings
from tests.verify.blocks import grid_scene
from tests.verify.mitsuba_stage import Stage, mitsuba, row_lattice

EDGE = 0.2
ROWS = 4
SAMPLES = 512


def test_weights_are_mitsubas(device: Device, tmp_path: Path) -> None:
    """A grey block before the disc: background and wall, each in the mean over the pixels that look
    at it, within four standard errors of both tracers.

    The block fills the picture, and its faces are those of cells, so that no pixel mixes.
    """
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed: cldit[peers]")
    per_m = 1.2 / (EDGE / 4)
    data = grid_scene(
        tmp_path,
        {
            "droplet_absorption_per_m": 0.3 * per_m,
            "droplet_scattering_per_m": 0.7 * per_m,
            "droplet_temperature_K": 400.0,
        },
        size_m=(EDGE / 4,) * 3,
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 32},
        camera={"pixels": [12, 12], "field_m": [0.04, 0.04]},
        background={"radius_m": 0.06, "temperatures_K": [400.0, 500.0]},
    )
    scene = cldit.Scene.from_dict(data)
    case = Case.of(scene, device, cache=tmp_path)
    lattice = row_lattice(case, ROWS)
    _, lines = lattice.numbers(scene)
    part = case.seen(lattice.of(scene))
    stage = Stage.of(case, mitsuba("scalar_rgb"))
    theirs, ours = [], []
    for seed in (1, 2):
        lit = [stage.render(line, samples=SAMPLES, seed=seed) for line in lines]
        theirs.append(np.stack(lit, axis=1))
        weights = part.run(path_settings(part, 512, phase="isotropic", seed=seed))[0].weights
        ours.append(np.stack([weights.background, weights.wall]).astype(float))
    for c, name in enumerate(("background", "wall")):
        a, b = theirs[0][c], theirs[1][c]
        d, e = ours[0][c], ours[1][c]
        noise = np.sqrt((np.mean((a - b) ** 2) + np.mean((d - e) ** 2)) / 4 / a.size)
        gap = np.mean(a + b - d - e) / 2
        assert 0.05 < np.mean(d) < 0.95, name
        # 1e-4: pixels of 3 mm are areas there, rays here; path lengths vary by 1e-3 over one.
        assert abs(gap) < 4 * noise + 1e-4, name


def test_a_variant_that_is_not_there_is_said() -> None:
    with pytest.raises(BenchError, match=r"not installed|does not run here"):
        mitsuba("no_such_variant")
