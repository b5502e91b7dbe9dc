"""How many nodes are enough, on curves that were made up."""

from __future__ import annotations

import pytest

from cldit.optics.node_count import enough, stays_K

RISES_AGAIN = (2.9, 0.8, 0.5, 0.099, 0.39, 0.37, 0.2, 0.08, 0.09, 0.05)


def test_the_first_below_is_not_enough_where_the_curve_rises_again() -> None:
    assert enough(RISES_AGAIN, bound_K=0.1, limit=10) == 8
    assert stays_K(RISES_AGAIN, 4) == 0.39
    assert stays_K(RISES_AGAIN, 8) == 0.09


@pytest.mark.parametrize(
    ("bound_K", "count"), [(3.0, 1), (0.8, 2), (0.4, 4), (0.38, 6), (0.05, 10)]
)
def test_the_smallest_from_which_all_stay(bound_K: float, count: int) -> None:
    assert enough(RISES_AGAIN, bound_K=bound_K, limit=10) == count


def test_what_lies_beyond_the_most_counts() -> None:
    """4 nodes would do if no more were tried; with 3 allowed and nothing reached, 3 stay lowest."""
    assert enough(RISES_AGAIN[:4], bound_K=0.1, limit=4) == 4
    assert enough(RISES_AGAIN, bound_K=0.1, limit=3) == 3
    assert stays_K(RISES_AGAIN, 3) == 0.5


def test_not_reached_takes_no_more_than_it_is_worth() -> None:
    """From 2 on the error stays at 0.5, however many are taken: 2 are as good as 4."""
    assert enough((1.0, 0.3, 0.2, 0.5), bound_K=0.1, limit=4) == 2


def test_one_node_that_is_exact() -> None:
    assert enough((0.0,), bound_K=0.1, limit=24) == 1
