"""Isothermal slabs, thin to thick and dark to white, held against discrete ordinates.

For PythonicDISORT a slab is cut at 25 lengths of 1 / sqrt(3 (1 - albedo) (1 - albedo g)) optical
depths, which is how light that diffuses falls to 1 / e where albedo is near 1. No slab of the table
that is cut passes more than 6e-7 there; the most is at albedo 0, where that is e^-14.4.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise, product

import numpy as np

from cldit.bench.case import BenchError
from cldit.bench.report import Table
from cldit.bench.stability_case import EDGE_M, Bench
from cldit.errors import ClditError
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter

_SPRAY_K, _WALL_K = 400.0, 300.0
_CELLS = 64
_STREAMS = 48
_LENGTHS = 25.0
_PANELS = (0.0, 0.1, 0.5, 2.0, 6.0, 15.0, 40.0)  # optical depths; e^-40 is nothing
_ALLOWED = 0.01  # of emission


@dataclass(frozen=True)
class Slab:
    """depth: optical. layers: cells across it."""

    depth: float
    albedo: float
    g: float
    layers: int = 8


@dataclass(frozen=True)
class SlabOutcome:
    """reached, true: emission, reflection and transmission along the normal.

    stated_K: known part of the run's error, None where nothing is known; stated: the same in
    words. true_K: RMS error of T_app. message: why there is no run.
    """

    slab: Slab
    true: tuple[float, float, float]
    reached: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    stated_K: float | None = None
    stated: str = "unknown"
    true_K: float = np.nan
    seconds: float = np.nan
    message: str = ""

    @property
    def holds(self) -> bool:
        """Whether emission is within 1 %, or T_app errs by no more than the known part."""
        near = abs(self.reached[0] - self.true[0]) <= _ALLOWED * self.true[0]
        return near or (self.stated_K is not None and self.true_K <= self.stated_K)


def exact(slab: Slab, *, streams: int = _STREAMS) -> tuple[float, float, float]:
    """Emission, reflection, transmission along the normal, by the formal solution through what
    PythonicDISORT gives at its quadrature nodes (Henyey-Greenstein)."""
    from PythonicDISORT.pydisort import pydisort  # type: ignore[import-untyped,unused-ignore]

    loss = np.sqrt(3 * (1 - slab.albedo) * (1 - slab.albedo * slab.g))
    depth = min(slab.depth, _LENGTHS / loss)
    moments = slab.g ** np.arange(streams + 1.0)
    degrees = np.arange(streams)
    nodes = np.tile(np.polynomial.legendre.leggauss(streams // 2)[1] / 2, 2)
    x, w = np.polynomial.legendre.leggauss(12)
    edges = [*(edge for edge in _PANELS if edge < depth), min(depth, _PANELS[-1])]
    out = []
    for behind in (0.0, 1.0):
        mu, *_, u0, _ = pydisort(
            np.array([depth]), np.array([slab.albedo]), streams, moments[None, :], 0.5, 0.0, 0.0,
            b_pos=behind, b_neg=1.0 - behind,
        )  # fmt: skip
        towards = np.polynomial.legendre.legvander(mu, streams - 1) @ (
            (2 * degrees + 1) * moments[:streams] / 2
        )
        total = behind * float(np.exp(-depth))
        for low, high in pairwise(edges):
            for node, weight in zip(x, w, strict=True):
                at = low + (node + 1) * (high - low) / 2
                source = slab.albedo * float(np.sum(nodes * towards * u0(at)))
                total += source * float(np.exp(-at)) * float(weight) * (high - low) / 2
        out.append(float(total))
    return 1.0 - out[0] - out[1], out[0], out[1]


def need_discrete_ordinates() -> None:
    """Raises BenchError where PythonicDISORT is not installed."""
    if find_spec("PythonicDISORT") is None:
        raise BenchError(
            "the slabs need PythonicDISORT, which is not installed; get it with: "
            "pip install PythonicDISORT"
        )


def slabs(*, few: bool = False) -> list[Slab]:
    """All slabs; few: of each kind one, in seconds."""
    if few:
        return [Slab(0.1, 0.5, 0.0), Slab(10.0, 0.9, 0.0), Slab(1e4, 0.5, 0.0)]
    depths, albedos = (0.1, 1.0, 10.0, 100.0, 1e3, 1e4), (0.0, 0.5, 0.9, 0.99, 0.999, 0.9999)
    every = [Slab(d, a, g) for d, a, g in product(depths, albedos, (0.0, 0.8)) if a or not g]
    return every + [Slab(1e3, a, 0.0, layers=1) for a in (0.9, 0.9999)]


def measure_slab(bench: Bench, slab: Slab) -> SlabOutcome:
    """Traces a slab at 400 K between walls at 300 K, before a background behind all of it."""
    true = exact(slab)
    thickness_m = slab.layers * EDGE_M / _CELLS
    start = time.perf_counter()
    try:
        run = bench.run(
            {
                "droplet_absorption_per_m": (1 - slab.albedo) * slab.depth / thickness_m,
                "droplet_scattering_per_m": slab.albedo * slab.depth / thickness_m,
                "droplet_temperature_K": _SPRAY_K,
            },
            size_m=(EDGE_M, thickness_m, EDGE_M),
            cells=_CELLS,
            camera={"model": "orthographic", "pixels": [9, 9], "field_m": [0.01, 0.01]},
            walls={"temperature_K": _WALL_K},
            background={"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
            transport={"phase": {"henyey_greenstein": slab.g} if slab.g else "isotropic"},
        )
    except ClditError as error:
        return SlabOutcome(slab, true, message=str(error))
    seconds = time.perf_counter() - start
    filter_um = scene_filter(run.scene)
    own, wall = (float(band_radiance(t, filter_um=filter_um)) for t in (_SPRAY_K, _WALL_K))
    emission, reflection, transmission = true
    radiance = np.array((emission * own + reflection * wall) / (1.0 - transmission))
    true_K = float(temperature_of_radiance(radiance, filter_um=filter_um))
    error_K = run.maps.apparent_temperature_K.astype(float) - true_K
    weights = run.weights
    reached = (
        float(weights.liquid.mean(dtype=float)) / own,
        float(weights.wall.mean(dtype=float)),
        float(weights.background.mean(dtype=float)),
    )
    return SlabOutcome(
        slab,
        true,
        reached,
        stated_K=None if run.errors is None else run.errors.total_K,
        stated="unknown" if run.errors is None else run.errors.text,
        true_K=float(np.sqrt(np.nanmean(error_K**2))),
        seconds=seconds,
    )


def bench_slabs(
    bench: Bench, chosen: list[Slab], *, say: Callable[[str], None] | None = None
) -> list[SlabOutcome]:
    """Runs the slabs, one after the other; `say` takes a line for each."""
    outcomes = []
    for slab in chosen:
        outcomes.append(measure_slab(bench, slab))
        if say is not None:
            say(" | ".join(_row(outcomes[-1])))
    return outcomes


def _row(outcome: SlabOutcome) -> list[str]:
    slab = outcome.slab
    pairs = zip(outcome.reached, outcome.true, strict=True)
    return [
        f"{slab.depth:g}",
        f"{slab.depth / slab.layers:g}",
        f"{slab.albedo:g}",
        f"{slab.g:g}",
        *(f"{one:.4f} ({other:.4f})" for one, other in pairs),
        outcome.stated,
        f"{outcome.true_K:.2g} K" if outcome.holds else f"**{outcome.true_K:.2g} K**",
        outcome.message or f"{outcome.seconds:.1f}",
    ]


def slab_table(outcomes: list[SlabOutcome]) -> str:
    """Markdown; a true error in bold is that of a row that does not hold."""
    head = ("depth", "of a cell", "albedo", "g", "emission (exact)", "reflection (exact)",
            "transmission (exact)", "stated", "true", "s")  # fmt: skip
    return Table.of(head, [_row(outcome) for outcome in outcomes]).markdown()
