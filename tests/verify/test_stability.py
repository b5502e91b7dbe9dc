"""Stability: a case of each kind runs, and every bound holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.run import Run
from tests.bench.slabs import Slab, bench_slabs, exact, slabs
from tests.bench.stability import bench_stability
from tests.verify.blocks import Blocks
from tests.verify.cavity import EDGE_M
from tests.verify.extreme_media import Extreme, bench_extremes, extremes
from tests.verify.known_cases import cases
from tests.verify.slab import half_space_emission
from tests.verify.stated import Stated

# Thick cells that hardly absorb, or do not: four fifths of all the time. `verify/test_cavity.py`
# has neighbours of all four with few samples, in cells of depth 100, 1e4 and 1e6.
LONG = {"100, 0.999999", "1e+06, 0.999999", "100, 1", "1e+06, 1"}


@pytest.fixture
def blocks(device: Device, tmp_path: Path) -> Blocks:
    return Blocks(device, tmp_path, tmp_path / "cache")


@pytest.mark.parametrize(
    "long",
    [
        pytest.param(False, marks=pytest.mark.slow),
        pytest.param(True, marks=pytest.mark.long),
    ],
)
def test_bounds_hold(device: Device, long: bool) -> None:
    chosen = [case for case in cases(few=True) if long or case.name not in LONG]
    assert long or len(chosen) == len(cases(few=True)) - len(LONG)
    outcomes = bench_stability(device, chosen)
    assert not [(o.case.name, o.error, o.message) for o in outcomes if not o.holds]
    assert len({outcome.case.group for outcome in outcomes}) >= 5


@pytest.mark.parametrize(
    ("stated", "holds"),
    [
        (Stated(1.0, "1 K", 1.5), True),
        (Stated(1.0, "at least 1 K", 3.0), False),
        (Stated(1.0, "1 K", 3.0, doubt_K=1.1), True),  # the truth is as uncertain as that
        (Stated(None, "unknown", 2.0), False),
        (Stated(None, "unknown", None), True),  # no pixel has a T_app
    ],
)
def test_half_of_the_true_error_has_to_be_stated(stated: Stated, holds: bool) -> None:
    assert stated.holds is holds


@pytest.fixture(scope="module")
def absorbing(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An absorbing cube of depth 2 at 400 K."""
    folder = tmp_path_factory.mktemp("absorbing")
    return Blocks(device, folder, folder / "cache").run(
        {"droplet_absorption_per_m": 10.0, "droplet_temperature_K": 400.0},
        size_m=(EDGE_M,) * 3,
        domain={"edge_m": EDGE_M, "leaf_edge_m": 1.01 * EDGE_M / 2},
        camera={"pixels": [21, 17], "field_m": [0.19, 0.19]},
        walls={"temperature_K": 300.0},
        background={"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
    )


def test_true_error_is_free_of_the_truths_noise(absorbing: Run) -> None:
    """Two truths whose noise is 1 K about T_app + 0.5 K: the error is 0.5 K, the doubt 1 / sqrt 2.

    The standard error of the mean square of N pixels is about sqrt(1 + 2 * 0.25) K2 / sqrt(N).
    """
    rng = np.random.default_rng(5)
    right = absorbing.maps.apparent_temperature_K.astype(float) + 0.5
    truth = tuple(right + rng.normal(size=right.shape) for _ in range(2))
    stated = Stated.of(absorbing, (truth[0], truth[1]))
    count = np.isfinite(right).sum()
    assert stated.true_K is not None
    assert stated.true_K**2 == pytest.approx(0.25, abs=4 * 1.5**0.5 / count**0.5)
    assert stated.doubt_K == pytest.approx(0.5**0.5, rel=0.15)


@pytest.mark.long
@pytest.mark.parametrize("case", extremes()[:-1], ids=lambda case: case.name)
def test_extreme_media_hold(blocks: Blocks, case: Extreme) -> None:
    """All but the million parcels, which take minutes."""
    (outcome,) = bench_extremes(blocks, [case])
    assert outcome.message == ""
    assert outcome.holds


@pytest.mark.parametrize("albedo", [0.5, 0.99, 0.9999])
def test_deep_slab_is_a_half_space(albedo: float) -> None:
    """It emits sqrt(1 - albedo) H(1): 48 streams are within 1e-3 of that."""
    emission, _, transmission = exact(Slab(1e4, albedo, 0.0))
    assert emission == pytest.approx(half_space_emission(albedo), rel=1e-3)
    assert transmission < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("slab", slabs(few=True))
def test_slab_holds(blocks: Blocks, slab: Slab) -> None:
    (outcome,) = bench_slabs(blocks, [slab])
    assert outcome.message == ""
    assert outcome.stated is not None and outcome.stated.true_K is not None
    assert outcome.holds
    # Emission to 1 %, or of nine pixels by long paths, with their noise, 3 %.
    allowed = 1e-2 if slab.pixels > 3 else 3e-2
    assert outcome.reached[0] == pytest.approx(outcome.true[0], rel=allowed)
    # The sum of emission, reflection and transmission is 1.
    assert sum(outcome.reached) == pytest.approx(1.0, abs=2e-3)
