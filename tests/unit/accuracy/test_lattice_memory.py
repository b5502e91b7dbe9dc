"""Lattices of the cone that fit the memory, and when a finer one is worth a trace."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.problem import Problem, clamp_to_memory
from cldit.accuracy.resolution import Resolution
from cldit.prepare import cell_choice
from cldit.prepare.stages import Stages
from cldit.scene import load_scene

PARCELS = 10_000
CONE_m = 0.4e-3  # of the lattice that was made
BYTES = (320 + 55) * PARCELS / 0.7  # of free memory, that hold just this lattice


def made() -> Any:
    """A spray of so many parcels."""
    cone = load_scene("gdi-cone").spray.model_copy(update={"spacing_m": CONE_m, "size_classes": 4})
    points = SimpleNamespace(position_m=np.zeros((PARCELS, 3)))
    return SimpleNamespace(cone=cone, properties=SimpleNamespace(sources=[(points, [])]))


def resolution(spacing_m: float) -> Resolution:
    first = Resolution.first(load_scene("gdi-cone"), ordinates_K=1.0, spectral_K=1.0)
    return replace(first, size_classes=4).on_lattice(spacing_m)


def hardly_finer(finer: Resolution, than: Resolution) -> str:
    device: Any = None
    problem = Problem(load_scene("gdi-cone"), device, Stages(None), Path(), None)
    problem._prepared = (), made()
    return problem.hardly_finer(finer, than)


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Any:
    def holds(spacing_m: float) -> None:
        free = BYTES * (CONE_m / spacing_m) ** 3
        monkeypatch.setattr(cell_choice, "free_bytes", lambda: free)

    return holds


def test_lattice_as_fine_as_memory_holds(memory: Any) -> None:
    memory(0.25e-3)
    assert clamp_to_memory(resolution(0.26e-3), made()) == resolution(0.26e-3)
    coarser = clamp_to_memory(resolution(0.2e-3), made())
    assert coarser.spacing_m == pytest.approx(0.25e-3)
    assert "0.2 mm cells exceed memory" in coarser.limits["cells"]


def test_a_spray_that_was_made_is_kept(memory: Any, tables: Path) -> None:
    """Memory is less once its octrees are there: that makes no other spray for the estimates."""
    memory(0.4e-3)
    device: Any = None
    problem = Problem(load_scene("gdi-cone"), device, Stages(None), tables, None)
    fine, spray = resolution(0.3e-3), made()
    problem._prepared = fine.prepared_key, spray
    assert problem.prepared(fine) == (fine, spray)


@pytest.mark.parametrize(("holds_m", "worth"), [(0.2e-3, True), (0.25e-3, True), (0.28e-3, False)])
def test_hardly_finer_cells_are_not_traced(memory: Any, holds_m: float, worth: bool) -> None:
    """Of 0.3 mm: 0.27 mm and less are worth it."""
    memory(holds_m)
    why = hardly_finer(resolution(0.2e-3), resolution(0.3e-3))
    assert (why == "") == worth
    assert ("0.2 mm cells exceed memory" in why) != worth


def test_cells_that_stay_are_no_reason(memory: Any) -> None:
    memory(0.28e-3)
    than = resolution(0.3e-3)
    assert hardly_finer(replace(than, ordinates_K=0.01), than) == ""
