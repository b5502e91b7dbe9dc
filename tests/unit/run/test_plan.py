"""What a plan chooses, what it leaves fixed, and when it refines."""

from __future__ import annotations

from typing import Any

import pytest

from cldit.run.errors import Cause, Errors
from cldit.run.plan import MOST_REFINEMENTS, Plan, free_causes
from cldit.scene import Scene, load_scene, parse_scene


def scene_of(name: str = "gdi", **sections: dict[str, Any]) -> Scene:
    data = load_scene(name).model_dump(mode="json")
    for section, values in sections.items():
        data[section].update(values)
    return parse_scene(data)


def errors_of(**causes_K: float) -> Errors:
    return Errors.of(Cause(name.replace("_", " "), error, "x") for name, error in causes_K.items())


def test_all_that_is_left_out_is_free() -> None:
    assert free_causes(scene_of()) == ("cells", "trace", "size classes")
    leaf = scene_of(domain={"leaf_edge_m": 1e-3})  # the lattice is then a cause of its own
    assert free_causes(leaf) == ("trace", "size classes", "gas grid")
    assert "cells" not in free_causes(scene_of(domain={"rule": "paper"}))
    fixed = scene_of(
        domain={"leaf_edge_m": 1e-3},
        transport={"directions": 16},
        spray={"size_classes": 4, "spacing_m": 1e-3},
    )
    assert free_causes(fixed) == ()
    assert free_causes(scene_of(optics={"preset": "spectral"}))[2] == "wavelengths"
    given = scene_of(optics={"preset": "spectral", "spectral_error_K": 0.3})
    assert "wavelengths" not in free_causes(given)
    assert Plan.first(given).spectral_K == 0.3
    assert "trace" not in free_causes(load_scene("methane-jet"))  # nothing scatters


def test_the_lattice_is_that_of_the_cells() -> None:
    plan = Plan.first(scene_of())
    assert plan.lattice_of_m == plan.domain_m
    for spacing_m in (0.5e-3, 0.33e-3, 0.2 / 512):
        on = plan.on_lattice(spacing_m)
        assert on.spacing_m == spacing_m and on.depth is not None and on.lattice_of_m is not None
        assert on.lattice_of_m / 2**on.depth == pytest.approx(spacing_m)
        assert 1 - 1e-9 <= on.lattice_of_m / on.domain_m < 2.0
        assert on.at_depth(on.depth - 1).spacing_m == pytest.approx(2 * spacing_m)
    errors = errors_of(cells=2.0, trace=0.1)
    fine = plan.on_lattice(0.5e-3).refined(
        errors, scene_of(), reducible={"cells"}, orders={"cells": 1.5}
    )
    assert fine is not None and fine.spacing_m is not None
    assert 0.5 <= fine.spacing_m / 0.5e-3 < 1.0  # halved at most
    assert Plan.first(scene_of(spray={"spacing_m": 1e-3})).lattice_of_m is None
    assert Plan.first(scene_of(transport={"audit": False})).lattice_of_m is None


def test_shares_fill_the_whole() -> None:
    plan = Plan.first(scene_of(transport={"accuracy_K": 2.0}))
    assert sum(one**2 for one in plan.shares_K.values()) == pytest.approx(4.0)
    assert plan.trace_K == plan.shares_K["trace"] < plan.cells_K < 2.0


def test_without_an_audit_it_is_the_trace() -> None:
    plan = Plan.first(scene_of(transport={"accuracy_K": 2.0, "audit": False}))
    assert plan.trace_K == 2.0 and plan.depth is None
    assert plan.scene(scene_of()).transport.accuracy_K == 2.0


def test_fixed_keys_stay() -> None:
    scene = scene_of(spray={"size_classes": 7, "spacing_m": 0.7e-3})
    plan = Plan.first(scene).settled(
        scene, 0.1, {"size classes": (5.0, 1.0), "gas grid": (5.0, 1.5)}
    )
    assert plan.scene(scene).spray == scene.spray


def test_a_lattice_for_what_the_cells_leave() -> None:
    scene = scene_of(transport={"accuracy_K": 1.0}, domain={"leaf_edge_m": 0.5e-3})
    first = Plan.first(scene)
    known = {"size classes": (0.1, 1.0), "gas grid": (1.2, 1.5)}
    plan = first.settled(scene, 0.6, known)
    assert plan.size_classes == 4  # small as it is
    assert first.spacing_m is not None and plan.spacing_m is not None
    left = 1.2 * (plan.spacing_m / first.spacing_m) ** 1.5
    trace_K = 0.6 * first.shares_K["trace"]
    assert left**2 + 0.6**2 + 0.1**2 + trace_K**2 == pytest.approx(1.0, rel=1e-6)
    assert first.settled(scene, 1.1, known) == first  # cells leave nothing


def test_what_is_small_enough_is_left_alone() -> None:
    scene = scene_of()
    plan = Plan.first(scene)
    small = errors_of(cells=0.8, trace=0.6, pixel_sampling=0.2)  # 1.02, printed as 1
    assert plan.refined(small, scene, reducible={"cells", "trace"}, orders={}) is None


def test_what_is_too_large_is_refined() -> None:
    scene = scene_of()
    plan = Plan.first(scene)
    plan = Plan(**{**vars(plan), "depth": 8})
    errors = errors_of(cells=2.0, trace=0.1, pixel_sampling=0.2)
    better = plan.refined(errors, scene, reducible={"cells", "trace"}, orders={})
    assert better is not None and better.depth == 9 and better.trace_K == plan.trace_K
    errors = errors_of(cells=0.1, trace=2.0)
    better = plan.refined(errors, scene, reducible={"cells", "trace"}, orders={})
    assert better is not None and better.depth == 8
    assert better.trace_K == pytest.approx(plan.trace_K * (1 - 0.1**2) ** 0.5 / 2.0)


def test_nothing_is_refined_in_vain() -> None:
    """Where what is fixed errs by more than was asked for, or nothing is free, or twice is over."""
    scene = scene_of()
    plan = Plan.first(scene)
    errors = errors_of(cells=2.0, trace=0.9)
    assert plan.refined(errors, scene, reducible={"trace"}, orders={}) is None
    assert plan.refined(errors, scene, reducible=set(), orders={}) is None
    over = Plan(**{**vars(plan), "refinements": MOST_REFINEMENTS, "depth": 8})
    assert over.refined(errors, scene, reducible={"cells", "trace"}, orders={}) is None
