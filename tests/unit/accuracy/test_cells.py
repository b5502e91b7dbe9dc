"""The choice of cells by coarse traces, on images whose error is known."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest

from cldit.accuracy.predict import choose_cells
from cldit.accuracy.richardson import RichardsonEstimate, error_at
from cldit.errors import MediumError, SprayError
from tests.unit.accuracy.number_images import NumberTracer, step

M = [0.2 / 2**depth for depth in range(15)]  # cells by the number of halvings


def tracer_of(
    order: float = 1.0,
    *,
    finest: int = 12,
    coarsest: int = 0,
    ends: type[Exception] = MediumError,
    **options: Any,
) -> Any:
    """Images with an error of the cell's edge in mm to the power `order`."""

    def level_K(cell_m: float) -> float:
        if cell_m < M[finest] * (1 - 1e-9):
            raise ends("too fine")
        if cell_m > M[coarsest] * (1 + 1e-9):
            raise SprayError("no middle of a cell lies in a plume")
        return float((1e3 * cell_m) ** order)

    return NumberTracer(level_K, **options)


def known_tracer(*errors_K: float) -> Any:
    """Images with these errors on cells of 0.2 m / 64, 0.2 m / 128 and so on."""
    return NumberTracer(dict(zip(M[6:], errors_K, strict=False)).__getitem__)


def chosen(tracer: Any, tolerance_K: float) -> tuple[float, str]:
    """Cells for a tolerance, and why they are not smaller."""
    cells = choose_cells(tracer, tolerance_K)
    assert cells is not None
    return cells


def test_error_is_that_of_the_finest() -> None:
    tracer = tracer_of(1.5)
    estimates = error_at(tracer, M[8])
    assert estimates is not None
    assert [estimate.order for estimate in estimates] == pytest.approx([1.5, 1.5])
    true_K = tracer.level_K(M[8])
    errors_K = [estimate.error_K for estimate in estimates]
    assert errors_K == pytest.approx([true_K, 0.5 * true_K])


@pytest.mark.parametrize(
    ("steps_K", "order", "bound_K", "shown"),
    [
        ((8.0, 0.1), 1.0, 8.0 / (4 - 2), False),  # small by chance: no proof of a high order
        ((10.0, 2.0), 1.5, None, False),
        ((8.0, 2.0), 2.0, None, True),
        ((6.0, 2.0), math.log2(3.0), None, True),
        ((1.0, 2.0), 1.0, None, False),  # nor is a large one proof of none
        ((1.0, 0.0), 1.0, None, False),
    ],
)
def test_orders_are_bounded(
    steps_K: tuple[float, float], order: float, bound_K: float | None, shown: bool
) -> None:
    estimate = RichardsonEstimate.of(*map(step, steps_K))
    assert estimate.order == pytest.approx(order, abs=1e-5)
    assert (estimate.bound_K, estimate.shown) == (bound_K, shown)
    assert estimate.error_K == pytest.approx(steps_K[1] / (2**order - 1.0), rel=1e-4)


@pytest.mark.parametrize("order", [1.0, 1.4, 2.0])
@pytest.mark.parametrize(("once", "twice"), [(1.5, 4.5), (2.86, 5.0)])
def test_order_by_any_sizes(order: float, once: float, twice: float) -> None:
    error_K = [0.7 * size**order for size in (1.0, once, twice)]
    fine, coarse = (step(finer - coarser) for coarser, finer in pairwise(error_K))
    estimate = RichardsonEstimate.of(coarse, fine, once=once, twice=twice)
    assert estimate.order == pytest.approx(order, abs=1e-5)
    assert estimate.error_K == pytest.approx(error_K[0], rel=1e-4)


@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("tolerance_K", [2.0, 0.5, 0.1])
def test_largest_cells_that_do(order: float, tolerance_K: float) -> None:
    """And none finer than one level above them is traced on the way."""
    tracer = tracer_of(order)
    cell_m, why = chosen(tracer, tolerance_K)
    assert not why and tracer.level_K(cell_m) <= tolerance_K * (1 + 1e-9)
    least = math.ceil(math.log2(200.0 / tolerance_K ** (1 / order)))
    assert cell_m == M[max(least, 7)]
    assert min(tracer.traced) >= min(2 * cell_m, M[8])


def test_cells_traced_for_their_order_are_not_those_of_the_image() -> None:
    """The first three images show no order, so that a fourth one is traced, with an error of 0.5 K.
    Cells twice as large have 1 K, which is enough, and an eighth of the cost."""
    tracer = known_tracer(9.1, 1.7, 1.0, 0.5)
    assert chosen(tracer, 1.2)[0] == M[8] and min(tracer.traced) == M[9]


@pytest.mark.parametrize(("tolerance_K", "depth"), [(5.0, 8), (0.7, 9), (0.5, 9), (0.2, 11)])
def test_cells_that_miss_what_finer_ones_see(tolerance_K: float, depth: int) -> None:
    """The coarsest step is large, the next small by chance: no order, and finer cells tell more.

    By first order the larger step predicts 4 K, the smaller 0.1: where 4 K are too much, the next
    cells are traced, with an error of 0.5 K of first order.
    """
    tracer = known_tracer(9.1, 1.1, 1.0, 0.5, 0.25, 0.125)
    estimates = error_at(tracer, M[8])
    assert estimates is not None
    assert estimates[0].order == 1.0 and estimates[0].bound_K == pytest.approx(4.0)
    assert chosen(tracer, tolerance_K)[0] == M[depth]


def test_the_result_that_needs_more_chooses_the_cells() -> None:
    tracer = tracer_of(emissivity=4.0)
    assert 0.5 < 4.0 * tracer.level_K(chosen(tracer, 1.0)[0]) <= 1.0


@pytest.mark.parametrize(
    ("finest", "tolerance_K", "why"),
    [
        (9, 0.01, f"{200 / 2**10:.3g} mm cells exceed memory; allowed"),
        (12, 1e-3, "the cube is halved 12 times at most; allowed: a smaller domain.edge_m"),
    ],
)
def test_what_ends_the_search(finest: int, tolerance_K: float, why: str) -> None:
    cell_m, limit = chosen(tracer_of(finest=finest), tolerance_K)
    assert cell_m == M[finest] and limit.startswith(why)


@pytest.mark.parametrize("order", [1.0, 1.4])
@pytest.mark.parametrize("tolerance_K", [5.0, 0.7, 0.15])
def test_a_lattice_takes_any_edge(order: float, tolerance_K: float) -> None:
    """The largest traced cells within the error, or smaller ones than any for 0.92 of it."""
    tracer = tracer_of(order, on_lattice=True)
    cell_m, why = chosen(tracer, tolerance_K)
    error_K = tracer.level_K(cell_m)
    assert not why and error_K <= tolerance_K * (1 + 1e-9)
    if cell_m < 0.99 * min(tracer.traced):
        assert error_K == pytest.approx(0.92 * tolerance_K)
        assert cell_m >= 0.35 * min(tracer.traced)
    elif cell_m < 1.01e-3:
        assert 1.5**order * error_K > tolerance_K


def test_coarse_lattices_that_no_cone_takes_are_passed_over() -> None:
    tracer = tracer_of(on_lattice=True, coarsest=8)
    cell_m, _ = chosen(tracer, 0.2)
    assert max(tracer.traced) <= M[8]
    assert tracer.level_K(cell_m) == pytest.approx(0.92 * 0.2)
    with pytest.raises(SprayError):
        choose_cells(tracer_of(on_lattice=True, coarsest=13), 1.0)


def test_a_lattice_too_fine_for_the_cone_is_chosen_all_the_same() -> None:
    """The run steps back from it, to the finest that the cone takes; memory is not to blame."""
    tracer = tracer_of(on_lattice=True, finest=9, ends=SprayError)
    cell_m, why = chosen(tracer, 0.01)
    assert not why and M[10] < cell_m < M[9]
