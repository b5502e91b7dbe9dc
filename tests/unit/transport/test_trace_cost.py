"""Cost of a trace, measured and scaled to a larger one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.transport.trace_cost import TraceCost

COARSE = TraceCost(cells=32**3, ordinates=24, pixels=10_000, sweeps_s=1.0, rays_s=1.0)


def test_sweeps_grow_with_cells_and_ordinates_rays_with_pixels() -> None:
    assert COARSE.scaled_s(32**3, 24, 10_000, 1) == 2.0
    assert COARSE.scaled_s(64**3, 48, 10_000, 1) == pytest.approx(16 + 2)
    assert COARSE.scaled_s(32**3, 48, 40_000, 2) == pytest.approx(2 + 8)
    assert replace(COARSE, cells=0).scaled_s(0, 24, 10_000, 1) == 0.0


def test_a_trace_is_measured() -> None:
    """A tenth of the time was spent on rays; compilation, which is paid once, is not counted."""
    image = SimpleNamespace(background=np.zeros((3, 4)))
    device: Any = SimpleNamespace(is_cpu=False)
    settings: Any = SimpleNamespace(final_directions=24)
    for seconds, share in (({"scattering": 0.9, "image": 0.1}, 0.9), ({}, 0.0)):
        made: Any = SimpleNamespace(seconds=seconds, weights=image)
        made.self = made
        found, cost = TraceCost.measured(device, 8, settings, partial(getattr, made, "self"))
        assert found is made and (cost.cells, cost.ordinates, cost.pixels) == (8, 24, 12)
        assert cost.sweeps_s == pytest.approx(share * (cost.sweeps_s + cost.rays_s))
