"""The jets of gas near the holes, of which droplets feel more than the grid shows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.spray.flow.gasjet import ENTRAINMENT, HALF_WIDTH, Jets

Floats = NDArray[np.float64]

DENSITY, FORCE_N, STEP_s = 3.5, 0.3, 2e-6


def jets() -> Jets:
    """Reach to 35 mm; the liquid is so fast that it does not bound them."""
    return Jets(2, speed_m_s=1e4, density_kg_m3=DENSITY, spacing_m=2e-3)


def pushed(time_s: float, *, still_s: float = 0.0) -> Jets:
    """By a force on the first one near the hole, and then by nothing."""
    made = jets()
    for rest in (False, True):
        for _ in range(round((still_s if rest else time_s) / STEP_s)):
            given = np.array([0.0 if rest else FORCE_N * STEP_s])
            made.push(np.array([0]), np.array([0.2e-3]), given, STEP_s)
    return made


def on_axis(made: Jets, hole: int = 0) -> tuple[Floats, Floats]:
    x = np.linspace(0.5e-3, 34.5e-3, 69)
    return x, made.speed_m_s(np.full(len(x), hole), x, np.zeros(len(x)))


def test_a_steady_jet_has_the_momentum_that_it_was_given() -> None:
    """rho u^2 over sections at any distance is the force, to the sections' sums."""
    made = pushed(2e-3)
    radius = np.linspace(0, 0.05, 20001)
    for x in (4e-3, 12e-3, 30e-3):
        speed = made.speed_m_s(np.zeros(len(radius), dtype=int), np.full(len(radius), x), radius)
        flux = DENSITY * np.trapezoid(speed**2 * 2 * np.pi * radius, radius)
        assert flux == pytest.approx(FORCE_N, rel=1e-3)
        half = float(np.interp(-0.5 * speed[0], -speed, radius))
        assert half == pytest.approx(HALF_WIDTH * x, rel=2e-3)  # the constants' digits
    assert not on_axis(made, hole=1)[1].any()


def test_the_head_of_a_jet() -> None:
    """Behind it m = K x sqrt(pi rho F / 4), and all of it is F t: x^2 = 4 F t / (K sqrt(pi rho F)).
    A bin and 5 %, for bins smear it."""
    x, speed = on_axis(pushed(0.15e-3))
    ahead = np.sqrt(4 * FORCE_N * 0.15e-3 / (ENTRAINMENT * np.sqrt(np.pi * DENSITY * FORCE_N)))
    assert 12e-3 < ahead < 20e-3
    steady = np.sqrt(36 * FORCE_N / (np.pi * DENSITY)) / (ENTRAINMENT * x)
    head = x[np.flatnonzero(speed > 0.5 * steady)[-1]]
    assert head == pytest.approx(ahead, rel=0.05, abs=0.5e-3)
    assert np.all(speed[x > 1.3 * ahead] < 0.02 * steady[x > 1.3 * ahead])


def test_momentum_is_not_lost_until_it_leaves() -> None:
    """Sum of rho u over all sections, pi/a each on the axis' speed, is force times time."""
    x, speed = on_axis(pushed(0.1e-3, still_s=0.05e-3))
    line = DENSITY * speed * np.pi * (ENTRAINMENT * x) ** 2 / 12
    assert np.sum(line) * 0.5e-3 == pytest.approx(FORCE_N * 0.1e-3, rel=1e-6)


def test_a_jet_that_nothing_pushes_any_more_dies_away() -> None:
    speeds = [on_axis(pushed(0.3e-3, still_s=still))[1][9] for still in (0.0, 0.1e-3, 1e-3)]
    assert speeds[1] < 0.3 * speeds[0]
    assert speeds[2] < 0.03 * speeds[0]


def test_gas_is_no_faster_than_the_liquid_and_counts_where_the_grid_is_too_coarse() -> None:
    made = Jets(1, speed_m_s=200.0, density_kg_m3=DENSITY, spacing_m=1e-3)
    for _ in range(200):
        made.push(np.zeros(1, dtype=int), np.array([0.1e-3]), np.array([5.0 * STEP_s]), STEP_s)
    x = np.array([-1e-3, 1e-3, 5e-3, 11e-3, 18e-3, 1.0])
    speed = made.speed_m_s(np.zeros(6, dtype=int), x, np.zeros(6))
    assert speed.max() <= 200.0
    assert speed[0] == 0.0
    # Half width of 1.5 cells at 17.6 mm; fades from two thirds of that on.
    np.testing.assert_array_equal(made.weight(x)[[0, 1, 2, 3, 4, 5]], [0, 1, 1, 1, 0, 0])


def test_what_is_pushed_elsewhere_does_not_count() -> None:
    made = jets()
    made.push(np.array([0, 1]), np.array([-1e-3, 1.0]), np.array([1.0, 1.0]), STEP_s)
    made.push(np.array([0]), np.array([1e-3]), np.array([-1.0]), STEP_s)  # never backwards
    assert not on_axis(made)[1].any()
    assert not on_axis(made, hole=1)[1].any()
