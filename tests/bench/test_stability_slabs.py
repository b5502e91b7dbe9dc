"""Slabs of the stability page: what is exact, and that a false row is marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.bench.stability_case import Bench
from cldit.bench.stability_slabs import Slab, SlabOutcome, bench_slabs, exact, slab_table, slabs
from cldit.gpu.device import Device

pytest.importorskip("PythonicDISORT")


def _chandrasekhar_h(albedo: float) -> Callable[[float], float]:
    """H of a half space that scatters evenly (Chandrasekhar 1960, V, by iteration)."""
    x, w = np.polynomial.legendre.leggauss(64)
    mu, w = (x + 1) / 2, w / 2
    root = np.sqrt(1 - albedo)
    h = np.ones(64)

    def step(at: np.ndarray) -> np.ndarray:
        inner = ((w * mu * h) / (at[:, None] + mu)).sum(axis=1)
        return np.asarray(1 / (root + albedo / 2 * inner))

    for _ in range(5000):
        h = (h + step(mu)) / 2
    return lambda at: float(step(np.array([at]))[0])


@pytest.mark.parametrize("albedo", [0.5, 0.99, 0.9999])
def test_deep_slab_is_a_half_space(albedo: float) -> None:
    """It emits sqrt(1 - albedo) H(1): 48 streams are within 1e-3 of that."""
    emission, _, transmission = exact(Slab(1e4, albedo, 0.0))
    assert emission == pytest.approx(np.sqrt(1 - albedo) * _chandrasekhar_h(albedo)(1.0), rel=1e-3)
    assert transmission < 1e-7


def test_a_false_row_is_marked() -> None:
    """Only where emission is off by more than 1 % and T_app by more than is stated."""
    bad = SlabOutcome(
        Slab(1.0, 0.5, 0.0), (0.5, 0.2, 0.3), (0.52, 0.18, 0.3), 0.5, "at least 0.5 K", 2.0
    )
    assert not bad.holds
    assert "| at least 0.5 K | **2 K** |" in slab_table([bad])
    assert replace(bad, stated_K=3.0).holds
    assert replace(bad, reached=(0.504, 0.196, 0.3)).holds
    assert not replace(bad, stated_K=None).holds
    assert not replace(bad, reached=(np.nan,) * 3, message="refused").holds


def test_a_slab_holds(device: Device, tmp_path: Path) -> None:
    (outcome,) = bench_slabs(Bench(device, tmp_path), slabs(few=True)[:1])
    assert outcome.holds


@pytest.mark.slow
def test_few_slabs_hold(device: Device, tmp_path: Path) -> None:
    outcomes = bench_slabs(Bench(device, tmp_path), slabs(few=True))
    assert all(outcome.holds for outcome in outcomes)


@pytest.mark.slow
def test_all_slabs_hold(device: Device, tmp_path: Path) -> None:
    outcomes = bench_slabs(Bench(device, tmp_path), slabs())
    assert not [outcome for outcome in outcomes if not outcome.holds]
