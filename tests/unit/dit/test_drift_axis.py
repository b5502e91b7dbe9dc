"""Where shots lie on the axis of a drift: even times as numbers, waits, breaks, times that lack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cldit.dit.drift_axis import BREAK_s, Places, drift_axis


@dataclass(frozen=True)
class _Shot:
    background_setpoint_K: float = 400.0
    time_s: float | None = None
    stable_s: float | None = None


def _at(*times_s: float | None) -> list[float]:
    return [place.at for place in drift_axis([_Shot(time_s=time_s) for time_s in times_s]).places]


def test_even_times_lie_where_numbers_do() -> None:
    assert _at(None, None, None, None) == [1.0, 2.0, 3.0, 4.0]
    assert _at(10.0, 12.5, 15.0, 17.5) == [1.0, 2.0, 3.0, 4.0]


def test_a_wait_takes_its_time_in_any_order_of_shots() -> None:
    assert _at(30.0, 0.0, 2.0, 32.0, 34.0, 4.0) == [16.0, 1.0, 2.0, 17.0, 18.0, 3.0]


@pytest.mark.parametrize(
    ("times_s", "cause"),
    [
        ((None, None, None), "shot number: no shot has a time"),
        ((1.0, None, 3.0), "1 of 3 shots have no time"),
        ((1.0, 1.0, 2.0), "some times are equal"),
    ],
)
def test_without_all_times_numbers_count(times_s: tuple[float | None, ...], cause: str) -> None:
    axis = drift_axis([_Shot(time_s=time_s) for time_s in times_s])
    assert [place.at for place in axis.places] == [1.0, 2.0, 3.0]
    assert cause in axis.line(through=False)


def test_a_break_takes_one_interval_and_is_said() -> None:
    times_s = (0.0, 2.0, 4.0, 4.0 + 3.0 * BREAK_s, 6.0 + 3.0 * BREAK_s)
    axis = drift_axis([_Shot(time_s=time_s) for time_s in times_s])
    assert [place.at for place in axis.places] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert [place.part for place in axis.places] == [0, 0, 0, 1, 1]
    assert axis.places[3].lag == pytest.approx(3.0 * BREAK_s / 2.0 - 1.0)
    assert axis.line(through=False).endswith("after a break (3 h) it restarts")
    assert axis.line(through=True).endswith("it continues, as the references show")
    places = Places.of(axis.places)
    np.testing.assert_allclose(places.through().at, 1.0 + np.array(times_s) / 2.0)
    np.testing.assert_allclose(places.about_part_means(places.at), [-1.0, 0.0, 1.0, -0.5, 0.5])


def test_a_wait_for_the_black_body_is_no_break() -> None:
    assert not drift_axis([_Shot(time_s=time_s) for time_s in (0.0, 2.0, 4.0, BREAK_s)]).breaks_s


def test_a_black_body_drifts_from_when_it_was_stable() -> None:
    """Or from the first shot before it, where nobody noted that."""
    noted = drift_axis([_Shot(time_s=time_s, stable_s=-6.0) for time_s in (0.0, 2.0, 4.0)])
    assert [place.since for place in noted.places] == [3.0, 4.0, 5.0]
    warm = [_Shot(500.0, time_s=time_s) for time_s in (40.0, 42.0, 44.0)]
    unnoted = drift_axis([*(_Shot(time_s=time_s) for time_s in (0.0, 2.0, 4.0)), *warm])
    assert [place.since for place in unnoted.places] == [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]
