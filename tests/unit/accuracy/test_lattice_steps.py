"""A lattice that the cone does not take, or that memory does not hold, is stepped back from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cldit.accuracy import attempt
from cldit.accuracy.attempt import Attempts
from cldit.accuracy.plan import Plan
from cldit.errors import SprayError
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene, parse_scene


@pytest.fixture
def tried_m(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Lattices that were asked for, of a cone that takes those of 0.14 to 0.8 mm."""
    tried: list[float] = []

    def prepare(scene: Scene, *_: Any, **__: Any) -> Any:
        spray: Any = scene.spray
        tried.append(spray.spacing_m)
        if not 0.14e-3 <= spray.spacing_m <= 0.8e-3:
            raise SprayError("spray.spacing_m: does not suit a plume")
        return object()

    monkeypatch.setattr(attempt, "prepare", prepare)
    return tried


def prepared(plan: Plan, scene: Scene) -> Plan:
    device: Any = None
    return Attempts(scene, device, Stages(None), Path("unused"), None)._prepare(plan)[0]


def test_too_fine(tried_m: list[float]) -> None:
    """In steps of 15 %, and the plan says why cells are no finer."""
    scene = load_scene("gdi")
    plan = prepared(Plan.first(scene).on_lattice(0.1e-3), scene)
    assert plan.spacing_m is not None and 0.14e-3 <= plan.spacing_m < 1.15 * 0.14e-3
    assert tried_m == pytest.approx([0.1e-3 * 1.15**n for n in range(4)])
    assert plan.limited.startswith("the cone takes no lattice finer than 0.152 mm")
    assert plan.lattice_of_m is not None and plan.depth is not None
    assert plan.lattice_of_m / 2**plan.depth == pytest.approx(plan.spacing_m)
    assert list(plan.limits) == ["cells"]


def test_the_first_lattice_is_too_coarse(tried_m: list[float]) -> None:
    """Of a short plume: the usual one is learned from, and cells stay to be chosen."""
    scene = load_scene("gdi")
    plan = prepared(Plan.first(scene), scene)
    assert tried_m == [1e-3, 0.5e-3]
    assert plan.depth is None and plan.lattice_of_m is not None and not plan.limits


@pytest.mark.parametrize("spacing_m", [0.05e-3, 2e-3])
def test_what_the_scene_fixes_is_refused(tried_m: list[float], spacing_m: float) -> None:
    data = load_scene("gdi").model_dump(mode="json")
    data["spray"]["spacing_m"] = spacing_m
    scene = parse_scene(data)
    with pytest.raises(SprayError, match="does not suit"):
        prepared(Plan.first(scene), scene)
    assert tried_m == [spacing_m]
