"""Which lattices of the cone memory holds, and when a finer one is worth a trace."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.lattice_memory import hardly_finer, held
from cldit.accuracy.plan import Plan
from cldit.prepare import cell_choice
from cldit.scene import Scene, load_scene

PARCELS = 10_000
CONE_m = 0.4e-3  # of the lattice that was made
BYTES = (320 + 55) * PARCELS / 0.7  # of free memory, that hold just this lattice


def scene() -> Scene:
    return load_scene("gdi")


def made() -> Any:
    """A spray of so many parcels, and its scene."""
    known = scene()
    spray = known.spray.model_copy(update={"spacing_m": CONE_m, "size_classes": 4})
    points = SimpleNamespace(position_m=np.zeros((PARCELS, 3)))
    prepared = SimpleNamespace(properties=SimpleNamespace(sources=[(points, [])]))
    return known.model_copy(update={"spray": spray}), prepared


def plan(spacing_m: float) -> Plan:
    first = replace(Plan.first(scene()), size_classes=4)
    return first.on_lattice(spacing_m)


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Any:
    def holds(spacing_m: float) -> None:
        free = BYTES * (CONE_m / spacing_m) ** 3
        monkeypatch.setattr(cell_choice, "free_bytes", lambda: free)

    return holds


def test_lattice_as_fine_as_memory_holds(memory: Any) -> None:
    memory(0.25e-3)
    assert held(plan(0.26e-3), made()) == plan(0.26e-3)
    coarser = held(plan(0.2e-3), made())
    assert coarser.spacing_m == pytest.approx(0.25e-3)
    assert "does not hold cells of 0.2 mm" in coarser.limited
    assert held(plan(0.2e-3), None) == plan(0.2e-3)  # nothing is known of the spray yet


@pytest.mark.parametrize(("holds_m", "worth"), [(0.2e-3, True), (0.25e-3, True), (0.28e-3, False)])
def test_hardly_finer_cells_are_not_traced(memory: Any, holds_m: float, worth: bool) -> None:
    """Of 0.3 mm: 0.27 mm and less are worth it."""
    memory(holds_m)
    why = hardly_finer(plan(0.2e-3), plan(0.3e-3), made())
    assert (why == "") == worth
    assert ("does not hold cells of 0.2 mm" in why) != worth


def test_cells_that_stay_are_no_reason(memory: Any) -> None:
    memory(0.28e-3)
    than = plan(0.3e-3)
    assert hardly_finer(replace(than, trace_K=0.01), than, made()) == ""
