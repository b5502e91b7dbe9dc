"""Shares of the sources, and the refinement of a resolution."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.allocation import Allocation, free_sources, shares_of, split
from cldit.accuracy.converge import Result, refine
from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution, lattice_is_cells
from cldit.accuracy.sources import BY_NAME
from cldit.accuracy.sources.discretisation import spectral_K
from cldit.medium.frame import Cube
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.spray import ConeSpray

NOTHING: Any = None


def scene_of(name: str = "gdi-cone", **sections: dict[str, Any]) -> Scene:
    """A shipped scene with one ray a pixel."""
    data = load_scene(name).model_dump(mode="json")
    data["camera"]["rays_per_pixel"] = 1
    if name == "gdi-flow":
        data["spray"]["box"]["spacing_m"] = 1e-3  # given: the gas grid is not free
    for section, values in sections.items():
        data[section].update(values)
    return parse_scene(data)


def allocation_of(scene: Scene) -> Allocation:
    return Allocation.of(scene, scene.transport.accuracy_K)


def first(scene: Scene) -> Resolution:
    allocation = allocation_of(scene)
    return Resolution.first(
        scene,
        ordinates_K=allocation["trace"],
        spectral_K=spectral_K(scene, allocation["wavelengths"]),
    )


def refined(
    resolution: Resolution,
    scene: Scene,
    errors_K: dict[str, float],
    *,
    fixed: tuple[str, ...] = (),
    orders: dict[str, float] | None = None,
    can_shrink: bool = True,
) -> Resolution | None:
    """The next resolution for these errors; sources in `fixed` have reached a limit."""
    estimates = []
    for name, error_K in errors_K.items():
        order = (orders or {}).get(name, 1.0)
        estimates.append(Estimate(Cause(name, error_K, "x"), order=order))
    for name in fixed:
        resolution = resolution.limited(name, "a limit")
    result = Result(
        resolution=resolution,
        allocation=allocation_of(scene),
        medium=NOTHING,
        traces=SimpleNamespace(short=()),  # type: ignore[arg-type]
        reference=NOTHING,
        maps=NOTHING,
        sensor=NOTHING,
        trace_errors=(SimpleNamespace(can_shrink=can_shrink),),  # type: ignore[arg-type]
        estimates=tuple(estimates),
    )
    problem = Problem(scene, NOTHING, Stages(None), Path(), None)
    cube = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.2, depth=1)
    empty = SimpleNamespace(
        properties=SimpleNamespace(sources=[(None, [])]),
        finest_lattice_m=lambda **_: 0.0,
        frame=cube,
        sources=(None, []),
        limit=1_000_000,
    )
    problem._prepared = (), empty  # type: ignore[assignment]
    finer = refine(problem, result)[1]
    return None if finer is None else finer[0]


def test_sources_without_a_key_are_free() -> None:
    """The lattice of a cone is free where it is not that of the cells."""
    assert free_sources(scene_of()) == ("trace", "cells", "size classes")
    own = scene_of(domain={"leaf_edge_m": 1e-3})
    assert free_sources(own) == ("trace", "gas grid", "size classes")
    given = scene_of(optics={"preset": "spectral", "spectral_error_K": 0.3})
    assert first(given).spectral_K == 0.3
    assert "trace" not in free_sources(load_scene("methane-jet"))  # nothing scatters
    auto = scene_of(camera={"rays_per_pixel": "auto"})
    assert free_sources(auto) == ("trace", "cells", "pixel sampling", "size classes")
    path = auto.with_(**{"transport.method": "path"})
    assert "pixel sampling" not in free_sources(path)
    better = refined(first(auto), auto, {"cells": 0.1, "pixel sampling": 2.0})
    assert better is not None and better.pixels_K == pytest.approx((1 - 0.1**2) ** 0.5)


def test_shares_cost_least() -> None:
    """Cells and ordinates multiply each other's cost: no other shares of an error cost less."""
    sources = {name: BY_NAME[name] for name in ("cells", "trace")}
    shares_K = split(2.0, sources)
    assert sum(share_K**2 for share_K in shares_K.values()) == pytest.approx(4.0)
    assert split(1.0, {}) == {}

    def cost(cells_K: float) -> float:
        return float(cells_K**-3.0 * (4.0 - cells_K**2) ** (-1.5 / 2))

    others = np.linspace(0.1, 1.98, 400)
    assert cost(shares_K["cells"]) <= min(map(cost, others)) * (1 + 1e-9)


def test_shares_of_added_costs() -> None:
    """Sources that add their own costs, 4 / e and 1 / e^2: their shares are those at the least."""
    ways = np.linspace(0.01, 0.999, 20_000)  # of the first error
    first, second = 4.0 / ways, 1.0 / (1 - ways**2)
    least = int(np.argmin(first + second))
    whole = first[least] + second[least]
    added: Any = {
        "a": SimpleNamespace(cost_power=1.0, cost_share=first[least] / whole),
        "b": SimpleNamespace(cost_power=2.0, cost_share=second[least] / whole),
    }
    assert split(1.0, added)["a"] == pytest.approx(ways[least], abs=2e-3)


def test_shares_go_by_the_list_of_sources() -> None:
    """Sums of squares are then the same to the last bit, whatever the hashes of names."""
    errors_K = {
        "cells": 0.31, "trace": 0.13, "wavelengths": 0.07, "size classes": 0.011, "gas grid": 2.0,
        "pixel sampling": 0.17,
    }  # fmt: skip
    shares = [shares_of(1.0, dict(order)) for order in permutations(errors_K.items())]
    assert all(share == shares[0] for share in shares)


def test_shares_fill_the_whole() -> None:
    allocation = allocation_of(scene_of(transport={"accuracy_K": 2.0}))
    assert sum_K2(allocation) == pytest.approx(4.0)
    assert allocation["trace"] == allocation.shares_K["trace"] < allocation.cells_K < 2.0


def fixed(error_K: float, *, at_most: bool = False, name: str = "gas grid") -> Estimate:
    return Estimate(Cause(name, error_K, "x", at_most=at_most))


def sum_K2(allocation: Allocation) -> float:
    return sum(share_K**2 for share_K in allocation.shares_K.values())


def of(scene: Scene, *known: Estimate) -> Allocation:
    return Allocation.of(scene, scene.transport.accuracy_K, known)


def test_fixed_errors_bound_the_others() -> None:
    """Fixed errors make 10/11 of a sum of squares, and the others have the rest."""
    scene = scene_of("gdi-flow", transport={"accuracy_K": 0.5})
    allocation = of(scene, fixed(9.0), fixed(1.2, name="parcels"))
    fixed_K2 = 9.0**2 + 1.2**2
    assert sum_K2(allocation) == pytest.approx(0.1 * fixed_K2)
    assert allocation["trace"] == allocation.shares_K["trace"] > of(scene)["trace"]
    trace_K = 0.6 * allocation["trace"]
    assert allocation.cells_K**2 + trace_K**2 == pytest.approx(0.1 * fixed_K2)
    assert allocation.fixed_K == {"gas grid": 9.0, "parcels": 1.2}


def test_a_larger_tolerance_never_makes_finer_cells() -> None:
    """Without a step where fixed errors fall below the tolerance."""
    cells_K, trace_K = [], []
    for asked_K in [1.0 * 1.06**k for k in range(50)]:  # to 17 K
        scene = scene_of("gdi-flow", transport={"accuracy_K": asked_K})
        allocation = of(scene, fixed(3.0), fixed(1.0, name="parcels"))
        cells_K.append(allocation.cells_K)
        trace_K.append(allocation["trace"])
    for values in (cells_K, trace_K):
        assert all(a <= b * (1 + 1e-9) for a, b in pairwise(values))
    # Where the sum of squares is (1 + 0.1) F^2, a step of 6 % in it makes one of a half in what
    # is left, the most that there is.
    assert max(b / a for a, b in pairwise(cells_K)) < (1 + (1.06**2 - 1) * 1.1 / 0.1) ** 0.5


def test_an_upper_bound_makes_nothing_coarser() -> None:
    """It leaves cells less, and half of their share at least."""
    scene = scene_of("gdi-flow", transport={"accuracy_K": 1.0})
    before, bound = of(scene), fixed(9.0, at_most=True)
    allocation = of(scene, bound)
    assert allocation["trace"] == before["trace"]
    assert allocation.cells_K == pytest.approx(0.5 * before.shares_K["cells"])
    both = of(scene, bound, fixed(5.0, name="parcels"))  # nor does it hide what is no bound
    assert sum_K2(both) == pytest.approx(0.1 * 5.0**2)
    some = of(scene, fixed(0.5, at_most=True))
    assert some.cells_K**2 == pytest.approx(0.75 * before.cells_K**2)
    unknown = Estimate.unknown("gas grid", "x")
    assert of(scene, unknown) == before


def test_gas_is_halved_so_that_coarser_sprays_are_those_of_before() -> None:
    """The error of 0.4 mm needs the sprays on 0.8 and 1.6 mm, which 0.8 mm had; below 0.35 mm a run
    chooses nothing, so 0.64 mm is not refined."""
    scene = load_scene("gdi").with_(**{"transport.accuracy_K": 5.0})
    start = Resolution.first(scene, ordinates_K=5.0, spectral_K=1.0)
    assert start.gas_m == 0.8e-3 and "gas grid" not in start.limits
    finer = BY_NAME["gas grid"].finer(start, share_K=3.0, ratio=1.2, order=1.0)
    assert finer.gas_m is not None and 2 * finer.gas_m == start.gas_m
    assert "below 0.35 mm" in finer.limits["gas grid"]
    shipped = Resolution.first(load_scene("gdi"), ordinates_K=4.0, spectral_K=1.0)
    assert shipped.gas_m == 0.64e-3 and "gas grid" in shipped.limits


def test_what_is_too_large_is_refined() -> None:
    scene = scene_of()
    resolution = replace(first(scene), depth=8, cube_m=None)  # cells alone
    better = refined(resolution, scene, {"cells": 2.0, "trace": 0.1, "pixel sampling": 0.2})
    assert better is not None and better.depth == 9
    assert better.ordinates_K == resolution.ordinates_K
    better = refined(resolution, scene, {"cells": 0.1, "trace": 2.0})
    assert better is not None and better.depth == 8
    # Ordinates grow as 1 / ordinates_K, the error falls with their number to the power 2/3.
    expected = resolution.ordinates_K * ((1 - 0.1**2) ** 0.5 / 2.0) ** 1.5
    assert better.ordinates_K == pytest.approx(expected)
    most = refined(resolution, scene, {"cells": 0.1, "trace": 30.0})
    assert most is not None  # four times less at once
    assert most.ordinates_K == pytest.approx(resolution.ordinates_K / 4**1.5)
    # One trace of any error above 0.4 K has as few ordinates as any: they are multiplied.
    few = max(1.0, 0.4 / expected) / max(1.0, 0.4 / resolution.ordinates_K)
    assert few * better.more_ordinates == pytest.approx(resolution.ordinates_K / expected)


def test_what_only_the_audit_shows_is_tried_by_ordinates_then_by_cells(tmp_path: Path) -> None:
    """Each trial leaves the paths alone; cells of a grid are halved, and within the memory."""
    spray = {"model": "grid", "file": str(tmp_path / "grid.npz")}
    scene = parse_scene({"name": "x", "spray": spray})
    resolution = replace(first(scene), depth=6)
    errors_K = {"trace": 4.0, "pixel sampling": 0.1}
    better = refined(resolution, scene, errors_K, can_shrink=False)
    assert better is not None and better.more_ordinates == pytest.approx(4.0**1.5, rel=0.01)
    assert (better.ordinates_K, better.depth) == (resolution.ordinates_K, 6)
    tried = ("more ordinates",)
    better = refined(resolution, scene, errors_K, can_shrink=False, fixed=tried)
    assert better is not None and (better.more_ordinates, better.depth) == (1.0, 7)
    fixed = parse_scene({"name": "x", "spray": spray, "domain": {"leaf_edge_m": 1e-3}})
    assert refined(resolution, fixed, errors_K, can_shrink=False, fixed=tried) is None


@pytest.mark.parametrize(
    ("errors_K", "limited", "refines"),
    [
        ({"cells": 0.8, "trace": 0.6, "pixel sampling": 0.2}, (), False),  # 1.02, printed as 1
        # 2.2 K, of which 1.95 K by pixels: at best 2.05 K.
        ({"pixel sampling": 1.95, "cells": 0.75, "trace": 0.5}, (), False),
        ({"pixel sampling": 1.1, "cells": 4.0, "trace": 0.05}, (), True),
        ({"cells": 2.0, "trace": 0.9}, ("cells",), False),
        ({"cells": 2.0, "trace": 0.9}, ("cells", "trace"), False),
    ],
)
def test_nothing_is_refined_in_vain(
    errors_K: dict[str, float], limited: tuple[str, ...], refines: bool
) -> None:
    """Errors within 1 K, of which too little can be reduced, or none."""
    resolution = replace(first(scene_of()), depth=8, cube_m=None)
    assert (refined(resolution, scene_of(), errors_K, fixed=limited) is not None) == refines


def test_lattice_and_cells_are_one_where_both_are_free() -> None:
    """Not where the scene fixes either, has the paper's cells, or asks for no errors."""
    assert lattice_is_cells(scene_of())
    free = first(scene_of())
    assert free.cube_m == free.domain_m and free.depth is None
    for fixed in (
        scene_of(domain={"leaf_edge_m": 1e-3}),
        scene_of(domain={"rule": "paper"}),
        scene_of(spray={"spacing_m": 0.7e-3}),
        scene_of(transport={"audit": False}),
        load_scene("gdi-flow"),  # no resolution includes its lattice
    ):
        assert not lattice_is_cells(fixed)
        resolution = first(fixed)
        assert resolution.cube_m is None
        assert resolution.at_depth(7) == replace(resolution, depth=7)


@pytest.mark.parametrize("spacing_m", [1.6e-3, 0.7e-3, 0.14e-3, 0.2 / 256])
def test_any_edge_is_a_cell_of_the_cube(spacing_m: float) -> None:
    """The cube holds the domain, by less than twice its edge, and halves to the lattice."""
    resolution = first(scene_of()).on_lattice(spacing_m)
    assert resolution.depth is not None and resolution.cube_m is not None
    assert resolution.spacing_m == spacing_m
    assert resolution.cube_m / 2**resolution.depth == pytest.approx(spacing_m, rel=1e-12)
    assert resolution.domain_m * (1 - 1e-8) <= resolution.cube_m < 2 * resolution.domain_m
    assert resolution.at_depth(resolution.depth) == resolution
    assert resolution.at_depth(resolution.depth - 1).spacing_m == pytest.approx(2 * spacing_m)
    cone = resolution.spray(scene_of())
    assert isinstance(cone, ConeSpray) and cone.spacing_m == spacing_m


@pytest.mark.parametrize(("cells_K", "order"), [(1.3, 1.0), (1.3, 2.0), (9.0, 1.0)])
def test_a_refined_lattice_is_as_fine_as_its_share_needs(cells_K: float, order: float) -> None:
    """0.92 of the share by the measured order, but no finer than half."""
    scene = scene_of()
    resolution = first(scene).on_lattice(0.4e-3)
    better = refined(resolution, scene, {"cells": cells_K, "trace": 0.1}, orders={"cells": order})
    assert better is not None and better.spacing_m is not None
    assert resolution.spacing_m is not None
    less = better.spacing_m / resolution.spacing_m
    share_K = (1.0 - 0.1**2) ** 0.5
    wanted = (0.92 * share_K / cells_K) ** (1 / order)
    assert less == pytest.approx(max(wanted, 0.5))
    assert better.cube_m is not None and better.depth is not None
    assert better.cube_m / 2**better.depth == pytest.approx(better.spacing_m)


def test_a_resolution_of_run_json_is_read_again() -> None:
    resolution = first(scene_of()).on_lattice(0.4e-3)
    assert Resolution.from_dict(resolution.to_dict()) == resolution
