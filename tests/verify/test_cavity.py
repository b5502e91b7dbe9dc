"""A cavity at one temperature is a flat image; see `cavity.py`.

Expected: 1 to 3e-5, some hundred roundings of single precision, where light scatters few times (up
to an optical depth of 100 a cell; vapour absorbs 0.3 of the droplets' extinction besides). To 1e-3
up to 1e6 and an albedo of 1: the solver is asked for 3e-4 of each of three parts of the light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from cldit.run import Run
from tests.verify.cavity import EDGE_M as EDGE
from tests.verify.cavity import T_K as T
from tests.verify.cavity import cavity as whole_cavity
from tests.verify.cavity import departure


def closure(run: Run) -> float:
    """Largest departure of the sum of weights from 1."""
    return float(np.max(np.abs(departure(run))))


def cavity(
    run_block: Callable[..., Run],
    *,
    model: str = "pinhole",
    pixels: tuple[int, int] = (21, 17),
    transport: Mapping[str, Any] | None = None,
    **more: Any,
) -> Run:
    """Few samples in thick cells: each of them closes, or none does."""
    camera = {"model": model, "pixels": list(pixels)}
    few = {"max_samples": 128, **(transport or {})}
    return whole_cavity(run_block, camera=camera, transport=few, **more)


@pytest.mark.parametrize("albedo", [0.0, 0.5, 0.999])
@pytest.mark.parametrize("depth", [1e-6, 0.1, 10.0, 100.0])
def test_flat(run_block: Callable[..., Run], depth: float, albedo: float) -> None:
    assert closure(cavity(run_block, depth=depth, albedo=albedo, vapour=0.3)) < 3e-5


@pytest.mark.parametrize(
    ("depth", "albedo", "vapour"),
    [
        (1.0, 1.0, 0.3),
        (1e4, 1.0, 0.3),
        (1e6, 0.999, 0.3),
        pytest.param(1e6, 1.0, 0.0, marks=pytest.mark.slow),
    ],
)
def test_flat_at_the_extremes(
    run_block: Callable[..., Run], depth: float, albedo: float, vapour: float
) -> None:
    pixels = (11, 9)  # paths are long there, and what closes in these closes in more
    run = cavity(run_block, depth=depth, albedo=albedo, vapour=vapour, pixels=pixels)
    assert closure(run) < 1e-3
    assert all(np.isfinite(image).all() for image in (run.weights.background, run.weights.wall))


@pytest.mark.parametrize(
    ("phase", "model", "order"),
    [
        ("isotropic", "pinhole", 1),
        ({"henyey_greenstein": 0.85}, "pinhole", None),
        pytest.param({"henyey_greenstein": -0.4}, "orthographic", 1, marks=pytest.mark.slow),
    ],
)
def test_flat_with_a_phase_function_and_at_every_order(
    run_block: Callable[..., Run], phase: Any, model: str, order: int | None
) -> None:
    """The weights towards the camera are divided by their sum, so nothing is made or lost. Beyond
    the last order is the wall, so truncated answers close as well."""
    transport = {"phase": phase, "order": order}
    run = cavity(run_block, depth=0.5, albedo=0.7, vapour=0.1, transport=transport, model=model)
    assert closure(run) < 1e-5


@pytest.mark.parametrize("cells", [1, 2, 4])
def test_flat_in_few_cells(run_block: Callable[..., Run], cells: int) -> None:
    run = cavity(run_block, depth=2.0, albedo=0.9, vapour=0.2, cells=cells)
    assert closure(run) < 3e-5


@pytest.mark.slow
def test_flat_all_round(run_block: Callable[..., Run]) -> None:
    """A background that surrounds everything: no light from the wall at all."""
    per_m = 0.4 / (EDGE / 16)
    run = run_block(
        {
            "droplet_scattering_per_m": per_m,
            "droplet_absorption_per_m": 0.1 * per_m,
            "droplet_temperature_K": T,
        },
        size_m=(0.1, 0.1, 0.1),
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 16},
        camera={"pixels": 15},
        background={"shape": "enclosure", "temperatures_K": [T, T + 20]},
        transport={"accuracy_K": 0.01},
    )
    assert closure(run) < 1e-5
    assert float(np.max(np.abs(run.weights.wall))) < 1e-5


def test_conservative_medium_is_solved_not_only_closed(run_block: Callable[..., Run]) -> None:
    """Albedo 1 at 1e4 a cell: closed by the first guess already, so closure proves little here.

    A conservative slab of large optical depth reflects nearly everything: light from behind comes
    through as 4/3 / (tau + 1.42) of it (diffusion with Milne's extrapolation, on both sides), here
    1e-5 or less; the wall's weight is the rest.
    """
    asked: dict[str, Any] = {"background": {"radius_m": 0.09}, "pixels": (11, 9)}
    run = cavity(run_block, depth=1e4, albedo=1.0, vapour=0.0, **asked)
    middle = run.weights.background[4, 5]
    assert 0 < middle < 0.05
