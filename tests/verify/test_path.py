"""Path tracing: slabs against PythonicDISORT, cavities, and orders against source iteration.

All is within noise, which the scatter of equivalent pixels tells, independently of the tracer's own
estimate (which is checked against it).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.run import Run
from cldit.transport.trace import Trace, trace
from tests.phase_tables import henyey_greenstein

from .blocks import compared
from .cavity import cavity, departure
from .slab import EDGE, disort, droplets_of_9_um, run_slab

CELLS = 128
LAYERS = 2


def slab(
    run_block: Callable[..., Run], depth: float, albedo: float, phase: Any, **other: Any
) -> Run:
    fixed = {"accuracy_K": 1e-3, "max_samples": 512, "cutoff": 1e-6}
    asked = {"method": "path", "phase": phase, **fixed, **other}
    return run_slab(run_block, depth, albedo, layers=LAYERS, transport=asked)


def check(run: Run, expected: tuple[float, float], depth: float, albedo: float) -> None:
    """Both weights within three standard errors, and what the slab's edges may do.

    Rays flatter than thickness / half width leave through the edges: that share of the sphere, of
    which exp(-depth x half width / thickness) at most is not yet extinguished there.
    """
    flat = 2 * LAYERS / CELLS
    edges = albedo * -np.expm1(-depth) * flat * np.exp(-depth / flat)
    for image, truth in zip((run.weights.background, run.weights.wall), expected, strict=True):
        values = image.astype(float).reshape(-1)
        error = values.std(ddof=1) / len(values) ** 0.5
        # 1e-5: rounding, and the cut-off's 1e-6 times the radiance beyond it.
        assert abs(values.mean() - truth) < 3 * error + edges + 1e-5


QUICK = [(1.0, 0.9), (10.0, 0.5)]
EXTREMES = [(0.01, 0.9), (0.1, 0.999), (10.0, 0.999), (100.0, 0.5)]


@pytest.mark.parametrize(
    ("depth", "albedo"),
    [*QUICK, *(pytest.param(*case, marks=pytest.mark.slow) for case in EXTREMES)],
)
@pytest.mark.parametrize("g", [None, 0.8])
def test_slab(run_block: Callable[..., Run], depth: float, albedo: float, g: float | None) -> None:
    phase = "isotropic" if g is None else {"henyey_greenstein": g}
    moments = np.ones(1) if g is None else henyey_greenstein(g).moments(48)
    run = slab(run_block, depth, albedo, phase)
    check(run, disort(depth, albedo, moments, streams=32 if g is None else 48), depth, albedo)


@pytest.mark.parametrize(
    ("depth", "albedo"), [pytest.param(0.3, 0.5, marks=pytest.mark.slow), (3.0, 0.9)]
)
def test_mie_slab(run_block: Callable[..., Run], depth: float, albedo: float) -> None:
    with droplets_of_9_um() as phase:
        run = slab(run_block, depth, albedo, "mie")
    check(run, disort(depth, albedo, phase.moments(65), streams=64), depth, albedo)


def test_mie_needs_diameters(run_block: Callable[..., Run]) -> None:
    with pytest.raises(ValueError, match="mie needs droplet diameters"):
        slab(run_block, 1.0, 0.5, "mie")


def cube(
    run_block: Callable[..., Run], *, depth: float, albedo: float, cells: int = 32, **transport: Any
) -> Run:
    """A cube of half the domain's cells, `depth` across it, in a cavity at one temperature."""
    return cavity(
        run_block,
        depth=2 * depth / cells,
        albedo=albedo,
        vapour=0.2,
        cells=cells,
        size_m=(EDGE / 2,) * 3,
        camera={"field_m": [0.12, 0.12]},
        transport=transport,
    )


@pytest.mark.parametrize(
    ("depth", "albedo", "phase"),
    [
        (2.0, 0.999, {"henyey_greenstein": 0.9}),
        (20.0, 1.0, "isotropic"),
        pytest.param(1e4, 0.9, {"henyey_greenstein": -0.5}, marks=pytest.mark.slow),
    ],
)
def test_cavity_is_flat(
    run_block: Callable[..., Run], depth: float, albedo: float, phase: Any
) -> None:
    """Weights sum to one in the mean: to four standard errors of it, and rounding."""
    run = cube(run_block, depth=depth, albedo=albedo, method="path", phase=phase, max_samples=256)
    left = departure(run).reshape(-1)
    assert abs(left.mean()) < 4 * left.std() / len(left) ** 0.5 + 1e-6
    assert np.abs(left).max() < 0.3


@pytest.mark.parametrize("order", [pytest.param(None, marks=pytest.mark.slow), 2])
def test_orders_are_those_of_source_iteration(
    run_block: Callable[..., Run], order: int | None
) -> None:
    """Same truncation, the same physics: the difference is noise, and the size of a cell.

    Noise of either is taken off by its mean square, from two independent runs of each (the sweeps'
    directions and offsets are random too). Left is what `source` loses by taking scattered light as
    the same all through a cell: with 16, 32, 64 cells across 2.4, 0.9, 0.2 times 1e-3 was seen at
    order 1, nearly second order in the size.
    """
    common: dict[str, Any] = {"depth": 1.6, "albedo": 0.6, "order": order}
    path = [
        cube(run_block, **common, method="path", accuracy_K=1e-3, max_samples=512, seed=seed)
        for seed in (1, 2)
    ]
    source = [cube(run_block, cells=64, **common, directions=256, seed=seed) for seed in (1, 2)]
    for name in ("background", "wall"):
        difference, noise = compared(path, source, name)
        # An estimate of noise from 357 pixels is good to sqrt(2 / 357) = 7.5 %; four of these.
        assert np.mean(difference**2) < 1.3 * noise + 1.1e-3**2
        assert abs(np.mean(difference)) < 4 * np.sqrt(noise / difference.size) + 5e-4


@pytest.mark.slow
def test_gathering_at_order_2(run_block: Callable[..., Run]) -> None:
    """Cells of an optical depth of 1, all of them thick: every chain stays within what `path`
    follows as well, by the same phase function; noise is left between the two, and what a finite
    set of directions does alike in every pixel (with 32 of them 2.7e-3 was seen). The first
    scattering is by three moments of the phase function, and 2.5e-3 was seen. All orders:
    `test_thick.py`."""
    phase = {"henyey_greenstein": 0.8}
    common: dict[str, Any] = {"depth": 16.0, "albedo": 0.6, "phase": phase, "order": 2}
    noisy: dict[str, Any] = {"accuracy_K": 1e-3, "max_samples": 256}
    path = [cube(run_block, **common, **noisy, method="path", seed=s) for s in (1, 2)]
    gathered = [
        cube(run_block, **common, **noisy, gather=True, directions=128, seed=s) for s in (3, 4)
    ]
    difference, noise = compared(path, gathered, "wall")
    assert np.mean(difference**2) < 1.3 * noise + 4e-3**2
    open_ = departure(gathered[0])
    assert abs(open_.mean()) < 4 * open_.std() / open_.size**0.5 + 1e-5


def test_the_error_is_known(run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates against the scatter of 81 equivalent pixels; both variances are good to 16 %."""
    traced = []

    def spy(*arguments: Any, **named: Any) -> Trace:
        traced.append(trace(*arguments, **named))
        return traced[-1]

    monkeypatch.setattr("cldit.transport.trace.trace", spy)
    run = slab(run_block, 1.0, 0.5, "isotropic", seed=3)
    assert run.info.counts["samples"] == 512
    halves = traced[0].weights_difference
    assert halves is not None
    for name in ("background", "wall"):
        scatter = getattr(run.weights, name).astype(float).var(ddof=1)
        assert np.mean(getattr(halves, name) ** 2) == pytest.approx(scatter, rel=0.5)


def test_stops_at_the_wanted_error(run_block: Callable[..., Run]) -> None:
    """More samples for less error, and what was asked for is reached.

    The run's own estimate is of the evaluated maps; the tracer's, which stops it, is of first order
    before one wall temperature: 1.2 times was seen between them.
    """
    loose, tight = (
        slab(run_block, 1.0, 0.5, "isotropic", accuracy_K=kelvin, max_samples=100_000)
        for kelvin in (1.0, 0.2)
    )
    for run, wanted in ((loose, 1.0), (tight, 0.2)):
        assert run.info.accuracy_K is not None and 0 < run.info.accuracy_K < 1.5 * wanted
    assert loose.info.counts["samples"] < tight.info.counts["samples"] < 100_000
