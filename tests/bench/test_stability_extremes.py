"""Extreme media of the stability page: what is compared, and that a false row is marked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.bench.stability_case import Bench
from cldit.bench.stability_extremes import (
    Extreme,
    ExtremeOutcome,
    bench_extremes,
    extremes,
    extremes_table,
)
from cldit.bench.stability_stated import Stated, apparent_K
from cldit.errors import TransportError
from cldit.gpu.device import Device
from cldit.run import Run


@pytest.fixture(scope="module")
def absorbing(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An absorbing cube of depth 2 at 400 K."""
    bench = Bench(device, tmp_path_factory.mktemp("absorbing"))
    return bench.run(
        {"droplet_absorption_per_m": 10.0, "droplet_temperature_K": 400.0},
        cells=2,
        walls={"temperature_K": 300.0},
        background={"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
    )


def test_apparent_temperature_is_that_of_the_evaluation(absorbing: Run) -> None:
    """By weights, and by the fit over backgrounds, whose maps are float32."""
    mine, maps = apparent_K(absorbing.weights, absorbing.scene), absorbing.maps
    seen = np.isfinite(maps.apparent_temperature_K)
    assert seen.any()
    assert np.abs(mine - maps.apparent_temperature_K)[seen].max() < 1e-3


def test_true_error_is_free_of_the_truths_noise(absorbing: Run) -> None:
    """Two truths whose noise is 1 K about T_app + 0.5 K: the error is 0.5 K, the doubt 1 / sqrt 2.

    Of N pixels the mean square errs by about sqrt(1 + 2 * 0.25) K2 / sqrt(N).
    """
    rng = np.random.default_rng(5)
    right = absorbing.maps.apparent_temperature_K.astype(float) + 0.5
    truth = tuple(right + rng.normal(size=right.shape) for _ in range(2))
    stated = Stated.of(absorbing, (truth[0], truth[1]))
    count = np.isfinite(right).sum()
    assert stated.true_K is not None
    assert stated.true_K**2 == pytest.approx(0.25, abs=4 * 1.5**0.5 / count**0.5)
    assert stated.doubt_K == pytest.approx(0.5**0.5, rel=0.15)


def test_rows() -> None:
    good = ExtremeOutcome("a", Stated(1.0, "1 K", 1.5), 2.0)
    assert good.holds
    assert "| a | 1 K | 1.5 K | 0.67 | 2.0 |" in extremes_table([good])
    bad = replace(good, stated=Stated(1.0, "at least 1 K", 3.0))
    assert not bad.holds
    assert "**3 K**" in extremes_table([bad])
    # Of a truth that is itself in doubt by that much, nothing is known to be false.
    assert replace(bad, stated=Stated(1.0, "1 K", 3.0, doubt_K=1.1)).holds


def test_refused_case_is_told(device: Device, tmp_path: Path) -> None:
    def fail(bench: Bench) -> object:
        raise TransportError("light is lost")

    (outcome,) = bench_extremes(Bench(device, tmp_path), [Extreme("dark", fail)])  # type: ignore[arg-type]
    assert not outcome.holds
    assert "**light is lost**" in extremes_table([outcome])


@pytest.mark.slow
@pytest.mark.parametrize("case", extremes()[:-1], ids=lambda case: case.name)
def test_extreme_media_hold(device: Device, tmp_path: Path, case: Extreme) -> None:
    """All but the million parcels, which take minutes."""
    (outcome,) = bench_extremes(Bench(device, tmp_path), [case])
    assert outcome.message == ""
    assert outcome.holds
