"""Slabs of the stability page: what is exact, and that a false row is marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.bench.stability_case import Bench
from cldit.bench.stability_slabs import Slab, SlabOutcome, bench_slabs, exact, slab_table, slabs
from cldit.bench.stability_stated import Stated
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


def test_every_cell_depth_is_among_the_slabs() -> None:
    """From 0.1 to 1e3, and no slab twice."""
    chosen = slabs()
    cells = {slab.depth / slab.layers for slab in chosen}
    assert {0.1, 1.0, 10.0, 100.0, 1000.0} <= cells
    assert len(set(chosen)) == len(chosen)


def test_a_false_row_is_marked() -> None:
    """Where less than half of the error is stated, or there is no run."""
    stated = Stated(0.5, "at least 0.5 K", 2.0)
    bad = SlabOutcome(Slab(1.0, 0.5, 0.0), (0.5, 0.2, 0.3), (0.52, 0.18, 0.3), stated)
    assert not bad.holds
    assert "| at least 0.5 K | **2 K** | 0.25 |" in slab_table([bad])
    assert replace(bad, stated=replace(stated, known_K=1.1)).holds
    assert not replace(bad, stated=replace(stated, known_K=None)).holds
    assert replace(bad, stated=Stated(None, "unknown", None)).holds
    refused = replace(bad, stated=None, message="refused")
    assert not refused.holds
    assert "**refused**" in slab_table([refused])


@pytest.mark.parametrize(
    "slab",
    [slabs(few=True)[0], *(pytest.param(s, marks=pytest.mark.slow) for s in slabs(few=True)[1:])],
)
def test_slab_holds(device: Device, tmp_path: Path, slab: Slab) -> None:
    (outcome,) = bench_slabs(Bench(device, tmp_path), [slab])
    assert outcome.message == ""
    assert outcome.stated is not None and outcome.stated.true_K is not None
    assert outcome.holds
    # Emission to 1 %, or of nine pixels by long paths, with their noise, 3 %.
    allowed = 1e-2 if slab.pixels > 3 else 3e-2
    assert outcome.reached[0] == pytest.approx(outcome.true[0], rel=allowed)
    # What is emitted, reflected and let through is all.
    assert sum(outcome.reached) == pytest.approx(1.0, abs=2e-3)
