"""What a plan chooses, what it leaves fixed, and when it refines."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from cldit.accuracy.errors import Cause, Errors
from cldit.accuracy.plan import MOST_REFINEMENTS, Plan, follows_cells, free_causes
from cldit.scene import Scene, load_scene, parse_scene


def scene_of(name: str = "gdi", **sections: dict[str, Any]) -> Scene:
    data = load_scene(name).model_dump(mode="json")
    for section, values in sections.items():
        data[section].update(values)
    return parse_scene(data)


def errors_of(**causes_K: float) -> Errors:
    return Errors.of(Cause(name.replace("_", " "), error, "x") for name, error in causes_K.items())


def test_all_that_is_left_out_is_free() -> None:
    assert free_causes(scene_of()) == ("cells", "trace", "size classes")  # lattice: the cells'
    own = scene_of(domain={"leaf_edge_m": 1e-3})
    assert free_causes(own) == ("trace", "size classes", "gas grid")
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


def test_what_pilots_foretell_is_left_out_of_the_cells() -> None:
    plan = Plan.first(scene_of(transport={"accuracy_K": 0.5}))
    small = replace(plan, foretold_K={"trace": 0.1, "pixel sampling": 0.0})
    assert plan.cells_K < small.cells_K < 0.5
    seen = replace(small, foretold_K={**small.foretold_K, "pixel sampling": 0.24})
    assert seen.cells_K**2 == pytest.approx(small.cells_K**2 - 0.24**2)
    # Where what may be an upper bound is more than was asked for, cells do not grow without end.
    much = replace(plan, foretold_K={"pixel sampling": 0.9})
    assert much.cells_K == 0.5 * plan.shares_K["cells"]
    # Pixels are no choice of the plan: beside 3 K of theirs finer cells are in vain.
    coarse = replace(plan.knowing(scene_of(), []), foretold_K={"trace": 0.1, "pixel sampling": 3.0})
    assert coarse.cells_K == pytest.approx(0.1**0.5 * 3.0, rel=0.05)  # classes have some of it


def fixed(error_K: float, *, at_most: bool = False, name: str = "gas grid") -> Cause:
    return Cause(name, error_K, "x", at_most=at_most)


def test_what_is_fixed_bounds_what_is_chosen() -> None:
    """Of a sum of squares that fixed causes make 10/11 of, the others have the rest."""
    scene = scene_of("gdi-flow", transport={"accuracy_K": 0.5})
    first = Plan.first(scene)
    plan = first.knowing(scene, [fixed(9.0), fixed(1.2, name="parcels")]).shared(scene)
    fixed_K2 = 9.0**2 + 1.2**2
    assert plan.aim_K**2 == pytest.approx(1.1 * fixed_K2)
    assert sum(one**2 for one in plan.shares_K.values()) == pytest.approx(0.1 * fixed_K2)
    assert plan.trace_K == plan.shares_K["trace"] > first.trace_K
    trace_K = 0.6 * plan.trace_K
    assert plan.cells_K**2 + trace_K**2 == pytest.approx(0.1 * fixed_K2)
    (remark,) = plan.bounded()
    assert "gas grid 9 K, parcels 1.2 K" in remark and "the rest is chosen for 2.9 K" in remark
    assert plan.scene(scene).spray == scene.spray


def test_a_larger_wanted_error_never_makes_finer_cells() -> None:
    """Without a step where what is fixed becomes less than what is asked for."""
    cells_K, trace_K = [], []
    for asked_K in [0.1 * 1.03**k for k in range(200)]:  # to 36 K
        scene = scene_of("gdi-flow", transport={"accuracy_K": asked_K})
        plan = Plan.first(scene).knowing(scene, [fixed(3.0), fixed(1.0, name="parcels")])
        plan = plan.shared(scene)
        seen = replace(plan, foretold_K={**plan.foretold_K, "trace": 0.02})
        cells_K.append(seen.cells_K)
        trace_K.append(plan.trace_K)
    for values in (cells_K, trace_K):
        assert all(a <= b * (1 + 1e-9) for a, b in pairwise(values))
    # Where the sum of squares is (1 + 0.1) F^2, a step of 3 % in it makes one of a third in what
    # is left, the most that there is.
    assert max(b / a for a, b in pairwise(cells_K)) < (1 + (1.03**2 - 1) * 1.1 / 0.1) ** 0.5
    assert cells_K[-1] ** 2 == pytest.approx(asked_K**2 - 3.0**2 - 1.0**2 - 0.02**2)


def test_an_upper_bound_makes_nothing_coarser() -> None:
    """It leaves cells less, and half of their share at least."""
    scene = scene_of("gdi-flow", transport={"accuracy_K": 1.0})
    first = Plan.first(scene)
    plan = first.knowing(scene, [fixed(9.0, at_most=True)]).shared(scene)
    assert plan.bounded() == ()
    assert plan.trace_K == first.trace_K
    assert plan.cells_K == 0.5 * first.shares_K["cells"]
    beside = [fixed(9.0, at_most=True), fixed(5.0, name="parcels")]
    both = first.knowing(scene, beside).shared(scene)  # nor does it hide what is no bound
    assert sum(one**2 for one in both.shares_K.values()) == pytest.approx(0.1 * 5.0**2)
    assert both.bounded()
    some = first.knowing(scene, [fixed(0.5, at_most=True)])
    assert some.cells_K**2 == pytest.approx(first.cells_K**2 - 0.25)


def test_directions_of_the_scene_are_fixed() -> None:
    """What a pilot shows of their error bounds the cells."""
    scene = scene_of(transport={"accuracy_K": 0.5, "directions": 8})
    plan = Plan.first(scene).knowing(scene, [])
    seen = replace(plan, foretold_K={"trace": 4.0})
    assert seen.aim_K == pytest.approx(1.1**0.5 * 4.0)
    assert seen.cells_K == pytest.approx(0.1**0.5 * 4.0, rel=0.05)  # classes have some of it
    free = scene_of(transport={"accuracy_K": 0.5})
    noise = replace(Plan.first(free).knowing(free, []), foretold_K={"trace": 4.0})
    assert noise.aim_K == 0.5  # ordinates can make it smaller


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
    scene = scene_of(transport={"accuracy_K": 1.0}, domain={"leaf_edge_m": 1e-3})
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
    plan = replace(plan, depth=8, lattice_of_m=None)  # cells alone
    errors = errors_of(cells=2.0, trace=0.1, pixel_sampling=0.2)
    better = plan.refined(errors, scene, reducible={"cells", "trace"}, orders={})
    assert better is not None and better.depth == 9 and better.trace_K == plan.trace_K
    errors = errors_of(cells=0.1, trace=2.0)
    better = plan.refined(errors, scene, reducible={"cells", "trace"}, orders={})
    assert better is not None and better.depth == 8
    # Ordinates grow as 1 / trace_K, the error falls with their number to the power 2/3.
    assert better.trace_K == pytest.approx(plan.trace_K * ((1 - 0.1**2) ** 0.5 / 2.0) ** 1.5)


def test_nothing_is_refined_in_vain() -> None:
    """Where what is fixed errs by more than was asked for, or nothing is free, or twice is over."""
    scene = scene_of()
    plan = Plan.first(scene)
    errors = errors_of(cells=2.0, trace=0.9)
    assert plan.refined(errors, scene, reducible={"trace"}, orders={}) is None
    assert plan.refined(errors, scene, reducible=set(), orders={}) is None
    over = Plan(**{**vars(plan), "refinements": MOST_REFINEMENTS, "depth": 8})
    assert over.refined(errors, scene, reducible={"cells", "trace"}, orders={}) is None


def test_lattice_and_cells_are_one_where_both_are_free() -> None:
    """Not where the scene fixes either, has the paper's cells, or asks for no errors."""
    assert follows_cells(scene_of())
    first = Plan.first(scene_of())
    assert first.lattice_of_m == first.domain_m and first.depth is None
    for fixed in (
        scene_of(domain={"leaf_edge_m": 1e-3}),
        scene_of(domain={"rule": "paper"}),
        scene_of(spray={"spacing_m": 0.7e-3}),
        scene_of(transport={"audit": False}),
        load_scene("gdi-flow"),  # its lattice is no choice of the plan
    ):
        assert not follows_cells(fixed)
        plan = Plan.first(fixed)
        assert plan.lattice_of_m is None
        assert plan.at_depth(7) == replace(plan, depth=7)


@pytest.mark.parametrize("spacing_m", [1.6e-3, 0.7e-3, 0.14e-3, 0.2 / 256])
def test_any_edge_is_a_cell_of_the_cube(spacing_m: float) -> None:
    """The cube holds the domain, by less than twice its edge, and halves to the lattice."""
    plan = Plan.first(scene_of()).on_lattice(spacing_m)
    assert plan.depth is not None and plan.lattice_of_m is not None
    assert plan.spacing_m == spacing_m
    assert plan.lattice_of_m / 2**plan.depth == pytest.approx(spacing_m, rel=1e-12)
    assert plan.domain_m * (1 - 1e-8) <= plan.lattice_of_m < 2 * plan.domain_m
    assert plan.at_depth(plan.depth, "why") == replace(plan, limited="why")
    spray: Any = plan.scene(scene_of()).spray
    assert spray.spacing_m == spacing_m


def test_memory_makes_lattice_and_cells_coarser_together() -> None:
    plan = Plan.first(scene_of()).on_lattice(0.3e-3)
    assert plan.depth is not None
    coarser = plan.at_depth(plan.depth - 1, "why")
    assert coarser.depth == plan.depth - 1 and coarser.spacing_m == pytest.approx(0.6e-3)
    assert coarser.limits == {"cells": "why"}


@pytest.mark.parametrize(("cells_K", "order"), [(1.3, 1.0), (1.3, 2.0), (9.0, 1.0)])
def test_a_refined_lattice_is_as_fine_as_its_share_needs(cells_K: float, order: float) -> None:
    """0.9 of the share by the measured order, but no finer than half."""
    scene = scene_of()
    plan = Plan.first(scene).on_lattice(0.4e-3)
    errors = errors_of(cells=cells_K, trace=0.1)
    better = plan.refined(errors, scene, reducible={"cells", "trace"}, orders={"cells": order})
    assert better is not None and better.spacing_m is not None and plan.spacing_m is not None
    less = better.spacing_m / plan.spacing_m
    share_K = (1.0 - 0.1**2) ** 0.5
    wanted = (0.9 * share_K / cells_K) ** (1 / order)
    assert less == pytest.approx(max(wanted, 0.5))
    assert better.lattice_of_m is not None and better.depth is not None
    assert better.lattice_of_m / 2**better.depth == pytest.approx(better.spacing_m)


def test_other_causes_shrink_four_times_at_most() -> None:
    scene = scene_of()
    plan = replace(Plan.first(scene), depth=8)
    errors = errors_of(cells=0.1, trace=30.0, size_classes=0.1)
    better = plan.refined(errors, scene, reducible={"cells", "trace", "size classes"}, orders={})
    assert better is not None and better.trace_K == pytest.approx(plan.trace_K / 4**1.5)


def test_the_finest_lattice_limits_the_gas_grid() -> None:
    """Where lattice and cells are one, it limits the cells."""
    own = Plan.first(scene_of(domain={"leaf_edge_m": 1e-3}))
    own = replace(own, spacing_m=1.4e-4, finest_lattice=True)
    assert list(own.limits) == ["gas grid"] and "finer than 0.14 mm" in own.limits["gas grid"]
    assert replace(Plan.first(scene_of()), finest_lattice=True).limits == {}
