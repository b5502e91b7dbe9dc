"""Steps back from a lattice that does not suit the cone, or does not fit the memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cldit.accuracy import problem
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.errors import SprayError
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.spray import ConeSpray


@pytest.fixture
def tried_m(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Lattices that were asked for, of a cone that suits those of 0.14 to 0.8 mm."""
    tried: list[float] = []

    def prepare(*_: Any, spec: ConeSpray, **__: Any) -> Any:
        tried.append(spec.lattice_m)
        if not 0.14e-3 <= spec.lattice_m <= 0.8e-3:
            raise SprayError("spray.spacing_m: does not suit a plume")
        return object()

    monkeypatch.setattr(problem, "prepare", prepare)
    return tried


def first(scene: Scene) -> Resolution:
    return Resolution.first(scene, ordinates_K=1.0, spectral_K=1.0)


def prepared(resolution: Resolution, scene: Scene) -> Resolution:
    device: Any = None
    return Problem(scene, device, Stages(None), Path("unused"), None).prepared(resolution)[0]


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
    data = load_scene("gdi-cone").model_dump(mode="json")
    data["domain"]["leaf_edge_m"] = 1e-3
    scene = parse_scene(data)
    found = prepared(replace(first(scene), spacing_m=0.13e-3), scene)
    assert list(found.limits) == ["gas grid"] and "finer than 0.149 mm" in found.limits["gas grid"]


@pytest.mark.parametrize("spacing_m", [0.05e-3, 2e-3])
def test_what_the_scene_fixes_is_refused(tried_m: list[float], spacing_m: float) -> None:
    data = load_scene("gdi-cone").model_dump(mode="json")
    data["spray"]["spacing_m"] = spacing_m
    scene = parse_scene(data)
    with pytest.raises(SprayError, match="does not suit"):
        prepared(first(scene), scene)
    assert tried_m == [spacing_m]
