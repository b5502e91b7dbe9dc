"""The nozzle from parcels that drag slows, and nozzles that cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.orientation import extrapolated
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import refused

NOZZLE = np.array([1e-3, 50e-3, -2e-3])
AXIS = np.array([0.0, -1.0, 0.0])


def slowed(count: int, seed: int, *, oldest_s: float = 1e-4) -> tuple[Any, Any, Any]:
    """Parcels that Stokes' drag slows on their way, exact: x = v tau (1 - exp(-t/tau))."""
    random = np.random.default_rng(seed)
    age = random.uniform(0.0, oldest_s, count)
    relaxation = random.uniform(1e-4, 3e-4, count)
    spread = random.normal(0.0, 0.08, (count, 3))
    start = 300.0 * (AXIS + spread - np.outer(spread @ AXIS, AXIS))
    fallen = relaxation * (1.0 - np.exp(-age / relaxation))
    position = NOZZLE + start * fallen[:, None]
    return position, start * np.exp(-age / relaxation)[:, None], age


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("count", [30, 300, 3000])
def test_extrapolation_to_age_zero(count: int, seed: int) -> None:
    """The error said covers the true one, and is a small part of what drag adds without it."""
    position, velocity, age = slowed(count, seed)
    found, error = extrapolated(position, velocity, age, AXIS)
    assert np.linalg.norm(found - NOZZLE) < error
    straight = np.median((position - velocity * age[:, None])[np.argsort(age)[:100]], axis=0)
    assert np.linalg.norm(found - NOZZLE) < 0.7 * np.linalg.norm(straight - NOZZLE)
    assert error < (4e-3 if count == 30 else 1e-3)


@pytest.mark.parametrize("youngest_s", [6e-5, 1e-4, 2e-4])
def test_after_the_end_of_injection(youngest_s: float) -> None:
    """Newton's drag, x = v tau ln(1 + t/tau): a parabola alone was 2.4 mm off, and said 0.9 mm."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        age, tau = random.uniform(youngest_s, 1e-3, 2000), random.uniform(1e-4, 3e-4, 2000)
        start = random.uniform(150.0, 350.0) * AXIS
        position = NOZZLE + start * (tau * np.log1p(age / tau))[:, None]
        found, error = extrapolated(position, start / (1.0 + age / tau)[:, None], age, AXIS)
        assert np.linalg.norm(found - NOZZLE) < max(error, 1e-3)


@pytest.mark.parametrize(
    ("nozzle", "hint"),
    [
        ((0.5, 9.0, 0.1), r"are metres: \(0\.0005, 0\.009, 0\.0001\) m if mm were meant"),
        ((0.05, 0.6, 0.01), r"are metres: .*\(0\.0005, 0\.006, 0\.0001\) m if cm were meant"),
        ((0.0, 0.0, -90.0), "coordinates are metres$"),
    ],
)
def test_a_nozzle_far_away(tmp_path: Path, nozzle: tuple[float, float, float], hint: str) -> None:
    case = foam.case(tmp_path)
    refused(case, rf"spray\.nozzle_m: .* m away from the case.*{hint}", nozzle_m=nozzle, axis="-y")


def test_liquid_upstream(tmp_path: Path) -> None:
    case = foam.case(tmp_path)
    refused(
        case,
        r"100 % of the liquid is upstream .* axis \(0, 1, 0",
        nozzle_m=(0.5e-3, 9e-3, 0.1e-3),
        axis="+y",
    )
