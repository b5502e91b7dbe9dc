"""The choice of cells by coarse traces, on images whose error is known."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.image_pair import ImageDifference
from cldit.accuracy.predict import choose_cells
from cldit.accuracy.richardson import RichardsonEstimate, error_at
from cldit.errors import MediumError, SprayError
from cldit.medium.frame import Frame

M = [0.2 / 2**depth for depth in range(15)]  # cells by the number of halvings


class KnownTracer:
    """Images with an error of `factor` times the cell's edge (mm) to the power `order`."""

    def __init__(
        self,
        order: float,
        *,
        factor: float = 1.0,
        finest: int = 12,
        coarsest: int = 0,
        on_lattice: bool = False,
        ends: type[Exception] = MediumError,
    ) -> None:
        self.order, self.factor, self.ends = order, factor, ends
        self.coarsest, self.finest = coarsest, finest
        cube = Frame((0.0, 0.0, 0.0), edge_m=0.2, depth=0)
        self.prepared = SimpleNamespace(cube=cube, on_lattice=on_lattice)
        self.scene = SimpleNamespace(camera=SimpleNamespace(field_m=(0.16, 0.16)))
        self.traced: list[float] = []
        self.emissivity = 0.5  # error over that of T_app, in kelvin

    @property
    def step(self) -> float:
        return 1.5 if self.prepared.on_lattice else 2.0

    def true_K(self, cell_m: float) -> float:
        return float(self.factor * (1e3 * cell_m) ** self.order)

    def level(self, cell_m: float) -> Any:
        if cell_m < M[self.finest] * (1 - 1e-9):
            raise self.ends("too fine")
        if cell_m > M[self.coarsest] * (1 + 1e-9):
            raise SprayError("no middle of a cell lies in a plume")
        self.traced.append(cell_m)
        return self.true_K(cell_m)

    def grids(self, cell_m: float) -> Any:
        return [(up, self.level(up * cell_m)) for up in (1.0, self.step, self.step**2)]

    def difference(self, one: float, other: float) -> tuple[ImageDifference, ...]:
        sizes = abs(one - other), self.emissivity * abs(one - other)
        return tuple(ImageDifference(size, np.full((2, 2), size)) for size in sizes)


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_error_is_that_of_the_finest(order: float) -> None:
    tracer: Any = KnownTracer(order)
    found = error_at(tracer, M[8])
    assert found is not None
    assert [one.order for one in found] == pytest.approx([order, order])
    assert [one.error_K for one in found] == pytest.approx(
        [tracer.true_K(M[8]), 0.5 * tracer.true_K(M[8])]
    )


def test_orders_are_bounded() -> None:
    """A step that is small by chance is no proof of a high order, nor a large one of none."""
    one = np.ones((1, 1))
    lucky = RichardsonEstimate.of(ImageDifference(8.0, one), ImageDifference(0.1, one))
    assert lucky.order == 1.0 and lucky.difference.error_K == 0.1 and lucky.bound_K == 8.0 / (4 - 2)
    assert RichardsonEstimate.of(ImageDifference(8.0, one), ImageDifference(2.0, one)).order == 2.0
    fast = RichardsonEstimate.of(ImageDifference(10.0, one), ImageDifference(2.0, one))
    assert fast.order == 1.5 and fast.bound_K is None and not fast.shown
    slow = RichardsonEstimate.of(ImageDifference(1.0, one), ImageDifference(2.0, one))
    assert slow.order == 1.0 and not slow.shown and not lucky.shown
    assert RichardsonEstimate.of(ImageDifference(6.0, one), ImageDifference(2.0, one)).shown
    none = RichardsonEstimate.of(ImageDifference(1.0, one), ImageDifference(0.0, one))
    assert none.difference.error_K == 0.0


@pytest.mark.parametrize("order", [1.0, 1.4, 2.0])
@pytest.mark.parametrize(("once", "twice"), [(2.0, 4.0), (1.5, 4.5), (2.86, 5.0)])
def test_order_by_any_sizes(order: float, once: float, twice: float) -> None:
    error_K = [0.7 * size**order for size in (1.0, once, twice)]
    steps = [
        ImageDifference(finer - coarser, np.ones((1, 1))) for coarser, finer in pairwise(error_K)
    ]
    found = RichardsonEstimate.of(steps[1], steps[0], once=once, twice=twice)
    assert found.order == pytest.approx(order, abs=1e-5)
    assert found.difference.error_K == pytest.approx(error_K[0], rel=1e-4)


@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("wanted_K", [2.0, 0.5, 0.1])
def test_largest_cells_that_do(order: float, wanted_K: float) -> None:
    """And none finer than one level above them is traced on the way."""
    tracer: Any = KnownTracer(order)
    chosen = choose_cells(tracer, wanted_K, lambda _: None)
    assert chosen is not None and not chosen[1]
    assert tracer.true_K(chosen[0]) <= wanted_K * (1 + 1e-9)
    least = math.ceil(math.log2(200.0 / wanted_K ** (1 / order)))
    assert chosen[0] == M[max(least, 7)]
    assert min(tracer.traced) >= min(2 * chosen[0], M[8])


def test_cells_traced_for_their_order_are_not_those_of_the_image() -> None:
    """The first three images show no order, so that a fourth one is traced, with an error of 0.5 K.
    Cells twice as large have 1 K, which is enough, and an eighth of the cost."""
    tracer: Any = KnownTracer(1.0)
    tracer.true_K = {M[6]: 9.1, M[7]: 1.7, M[8]: 1.0, M[9]: 0.5}.__getitem__
    chosen = choose_cells(tracer, 1.2, lambda _: None)
    assert chosen is not None and chosen[0] == M[8] and min(tracer.traced) == M[9]


@pytest.mark.parametrize(("wanted_K", "depth"), [(5.0, 8), (0.7, 9), (0.5, 9), (0.2, 11)])
def test_cells_that_miss_what_finer_ones_see(wanted_K: float, depth: int) -> None:
    """The coarsest step is large, the next small by chance: no order, and finer cells tell more.

    The larger step foretells 4 K by first order, the smaller 0.1: where 4 K are too much, the next
    cells are traced, and err by 0.5 K of first order.
    """
    errors_K = 9.1, 1.1, 1.0, 0.5, 0.25, 0.125
    tracer: Any = KnownTracer(1.0)
    tracer.true_K = dict(zip(M[6:], errors_K, strict=False)).__getitem__
    found = error_at(tracer, M[8])
    assert found is not None
    assert found[0].order == 1.0 and found[0].bound_K == pytest.approx(4.0)
    chosen = choose_cells(tracer, wanted_K, lambda _: None)
    assert chosen is not None and chosen[0] == M[depth]


def test_the_result_that_needs_more_chooses_the_cells() -> None:
    tracer: Any = KnownTracer(1.0)
    tracer.emissivity = 4.0
    chosen = choose_cells(tracer, 1.0, lambda _: None)
    assert chosen is not None and 0.5 < 4.0 * tracer.true_K(chosen[0]) <= 1.0


def test_memory_ends_it() -> None:
    tracer: Any = KnownTracer(1.0, finest=9)
    chosen = choose_cells(tracer, 0.01, lambda _: None)
    assert chosen is not None and chosen[0] == M[9]
    assert chosen[1].startswith(f"{200 / 2**10:.3g} mm cells exceed memory; allowed")


def test_halvings_end() -> None:
    tracer: Any = KnownTracer(1.0)
    chosen = choose_cells(tracer, 1e-3, lambda _: None)
    assert chosen is not None and chosen[0] == M[12]
    assert "halved 12 times at most; allowed: a smaller domain.edge_m" in chosen[1]


@pytest.mark.parametrize("order", [1.0, 1.4])
@pytest.mark.parametrize("wanted_K", [5.0, 1.3, 0.7, 0.4, 0.15])
def test_a_lattice_takes_any_edge(order: float, wanted_K: float) -> None:
    """The largest traced cells within the error, or smaller ones than any for 0.92 of it."""
    tracer: Any = KnownTracer(order, on_lattice=True)
    chosen = choose_cells(tracer, wanted_K, lambda _: None)
    assert chosen is not None and not chosen[1]
    at_K = tracer.true_K(chosen[0])
    assert at_K <= wanted_K * (1 + 1e-9)
    if chosen[0] < 0.99 * min(tracer.traced):
        assert at_K == pytest.approx(0.92 * wanted_K)
        assert chosen[0] >= 0.35 * min(tracer.traced)
    elif chosen[0] < 1.01e-3:
        assert 1.5**order * at_K > wanted_K


def test_coarse_lattices_that_no_cone_takes_are_passed_over() -> None:
    tracer: Any = KnownTracer(1.0, on_lattice=True, coarsest=8)
    chosen = choose_cells(tracer, 0.2, lambda _: None)
    assert chosen is not None and max(tracer.traced) <= M[8]
    assert tracer.true_K(chosen[0]) == pytest.approx(0.92 * 0.2)
    none: Any = KnownTracer(1.0, on_lattice=True, coarsest=13)
    with pytest.raises(SprayError):
        choose_cells(none, 1.0, lambda _: None)


def test_a_lattice_too_fine_for_the_cone_is_wanted_all_the_same() -> None:
    """The run steps back from it, to the finest that the cone takes; memory is not to blame."""
    tracer: Any = KnownTracer(1.0, on_lattice=True, finest=9, ends=SprayError)
    chosen = choose_cells(tracer, 0.01, lambda _: None)
    assert chosen is not None and not chosen[1]
    assert M[10] < chosen[0] < M[9]
