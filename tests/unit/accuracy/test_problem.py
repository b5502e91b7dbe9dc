"""Lattices that do not suit the cone, or do not fit the memory, become coarser."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy import problem as problems
from cldit.accuracy.problem import Problem, clamp_to_memory
from cldit.accuracy.resolution import Resolution
from cldit.errors import SprayError
from cldit.prepare import cell_choice
from cldit.prepare.medium import Prepared
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene
from cldit.scene.spray import ConeSpray


def first(scene: Scene) -> Resolution:
    return Resolution.first(scene, ordinates_K=1.0, spectral_K=1.0)


def problem_of(scene: Scene) -> Problem:
    device: Any = None
    return Problem(scene, device, Stages(None), Path("unused"), None)


@pytest.fixture
def tried_m(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Lattices that were asked for, of a cone that suits those of 0.14 to 0.8 mm."""
    tried: list[float] = []

    def prepare(*_: Any, spec: ConeSpray, **__: Any) -> Any:
        tried.append(spec.lattice_m)
        if not 0.14e-3 <= spec.lattice_m <= 0.8e-3:
            raise SprayError("spray.spacing_m: does not suit a plume")
        return object()

    monkeypatch.setattr(problems, "prepare", prepare)
    return tried


def prepared(resolution: Resolution, scene: Scene) -> Resolution:
    return problem_of(scene).prepared(resolution)[0]


def test_too_fine(tried_m: list[float]) -> None:
    """In steps of 15 %, and the resolution has the reason why cells are no finer."""
    scene = load_scene("gdi-cone")
    found = prepared(first(scene).on_lattice(0.1e-3), scene)
    assert found.spacing_m is not None and 0.14e-3 <= found.spacing_m < 1.15 * 0.14e-3
    assert tried_m == pytest.approx([0.1e-3 * 1.15**n for n in range(4)])
    assert list(found.limits) == ["cells"]
    assert found.limits["cells"].startswith("the cone allows no lattice finer than 0.152 mm")
    assert found.cube_m is not None and found.depth is not None
    assert found.cube_m / 2**found.depth == pytest.approx(found.spacing_m)


def test_the_first_lattice_is_too_coarse(tried_m: list[float]) -> None:
    """For a short plume, the scene's own lattice is used first, and cells are chosen later."""
    scene = load_scene("gdi-cone")
    found = prepared(first(scene), scene)
    assert tried_m == [1e-3, 0.5e-3]
    assert found.depth is None and found.cube_m is not None and not found.limits


def test_the_finest_lattice_limits_the_gas_grid(tried_m: list[float]) -> None:
    """The lattice limits the cells if both are one (above)."""
    scene = load_scene("gdi-cone").with_(**{"domain.leaf_edge_m": 1e-3})
    found = prepared(replace(first(scene), spacing_m=0.13e-3), scene)
    assert list(found.limits) == ["gas grid"] and "finer than 0.149 mm" in found.limits["gas grid"]


@pytest.mark.parametrize("spacing_m", [0.05e-3, 2e-3])
def test_what_the_scene_fixes_is_refused(tried_m: list[float], spacing_m: float) -> None:
    scene = load_scene("gdi-cone").with_(**{"spray.spacing_m": spacing_m})
    with pytest.raises(SprayError, match="does not suit"):
        prepared(first(scene), scene)
    assert tried_m == [spacing_m]


PARCELS = 10_000
CONE_m = 0.4e-3  # of the lattice that was made
BYTES = (320 + 55) * PARCELS / 0.7  # of free memory, that hold just this lattice


def prepared_cone() -> Any:
    """A spray of so many parcels."""
    cone = load_scene("gdi-cone").spray.model_copy(update={"spacing_m": CONE_m, "size_classes": 4})
    points = SimpleNamespace(position_m=np.zeros((PARCELS, 3)))
    made: Any = SimpleNamespace(cone=cone, properties=SimpleNamespace(sources=[(points, [])]))
    made.finest_lattice_m = partial(Prepared.finest_lattice_m, made)
    return made


def resolution(spacing_m: float) -> Resolution:
    return replace(first(load_scene("gdi-cone")), size_classes=4).on_lattice(spacing_m)


def hardly_finer(finer: Resolution, than: Resolution) -> str:
    problem = problem_of(load_scene("gdi-cone"))
    problem._prepared = (), prepared_cone()
    return problem.hardly_finer(finer, than)


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Any:
    def holds(spacing_m: float) -> None:
        free = BYTES * (CONE_m / spacing_m) ** 3
        monkeypatch.setattr(cell_choice, "free_bytes", lambda: free)

    return holds


def test_lattice_as_fine_as_memory_holds(memory: Any) -> None:
    memory(0.25e-3)
    assert clamp_to_memory(resolution(0.26e-3), prepared_cone()) == resolution(0.26e-3)
    coarser = clamp_to_memory(resolution(0.2e-3), prepared_cone())
    assert coarser.spacing_m == pytest.approx(0.25e-3)
    assert "0.2 mm cells exceed memory" in coarser.limits["cells"]


def test_a_spray_that_was_made_is_kept(memory: Any) -> None:
    """Memory is less once its octrees are there: that makes no other spray for the estimates."""
    memory(0.4e-3)
    problem = problem_of(load_scene("gdi-cone"))
    fine, spray = resolution(0.3e-3), prepared_cone()
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
