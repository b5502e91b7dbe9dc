"""Isothermal slabs, thin to thick and dark to white, held against discrete ordinates.

For PythonicDISORT a slab is cut at 25 lengths of 1 / sqrt(3 (1 - albedo) (1 - albedo g)) optical
depths, which is how light that diffuses falls to 1 / e where albedo is near 1. No slab of the table
that is cut passes more than 6e-7 there; the most is at albedo 0, where that is e^-14.4.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import pairwise, product

import numpy as np

from cldit.bench.case import BenchError
from cldit.bench.report import Table
from cldit.bench.stability_case import EDGE_M, Bench
from cldit.bench.stability_stated import Stated
from cldit.errors import ClditError
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter

_SPRAY_K, _WALL_K = 400.0, 300.0
_STREAMS = 48
_LENGTHS = 25.0
_PANELS = (0.0, 0.1, 0.5, 2.0, 6.0, 15.0, 40.0)  # optical depths; e^-40 is nothing
_FEW_PIXELS = 3


@dataclass(frozen=True)
class Slab:
    """depth: optical. layers: cells through it, of `across` along an edge of the cube.

    pixels: along an edge of the picture.
    """

    depth: float
    albedo: float
    g: float
    layers: int = 4
    across: int = 32
    pixels: int = 15


@dataclass(frozen=True)
class SlabOutcome:
    """reached, true: emission, reflection and transmission along the normal.

    stated: None where there is no run; message: why.
    """

    slab: Slab
    true: tuple[float, float, float]
    reached: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    stated: Stated | None = None
    seconds: float = np.nan
    message: str = ""

    @property
    def holds(self) -> bool:
        """Whether at least half of the true error is stated."""
        return self.stated is not None and self.stated.holds


def exact(slab: Slab, *, streams: int = _STREAMS) -> tuple[float, float, float]:
    """Emission, reflection, transmission along the normal.

    By the formal solution through what PythonicDISORT gives at its quadrature nodes
    (Henyey-Greenstein).

    Args:
        slab: to be solved.
        streams: of discrete ordinates.

    Returns:
        Each as a share: their sum is 1.
    """
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
    """The slabs of the page.

    Thin slabs are wider, for light goes far along them. Where light is scattered more than fifty
    times the picture has few pixels.

    Args:
        few: of each kind one, in a minute.
    """
    if few:
        return [
            Slab(10.0, 0.9, 0.0),
            Slab(0.1, 0.5, 0.0, layers=1, across=64),
            Slab(1e4, 0.5, 0.8),
            Slab(100.0, 0.999, 0.0, pixels=_FEW_PIXELS),
        ]
    depths, albedos = (0.1, 1.0, 10.0, 100.0, 1e3, 1e4), (0.0, 0.5, 0.9, 0.99, 0.999, 0.9999)
    every = [_slab(d, a, g) for g, a, d in product((0.0, 0.8), albedos, depths) if a or not g]
    thick = ((1.0, 0.9), (10.0, 0.9), (100.0, 0.9), (100.0, 0.999), (1e3, 0.9), (1e3, 0.9999))
    return every + [replace(_slab(d, a, 0.0), layers=1) for d, a in thick]


def _slab(depth: float, albedo: float, g: float) -> Slab:
    layers, across = (1, 64) if depth < 1 else (4, 64) if depth < 10 else (4, 32)
    often = min(depth, 1 / (1 - albedo)) > 50
    return Slab(depth, albedo, g, layers, across, _FEW_PIXELS if often else Slab.pixels)


def measure_slab(bench: Bench, slab: Slab) -> SlabOutcome:
    """Traces a slab at 400 K between walls at 300 K, before a background behind all of it.

    Args:
        bench: where it runs.
        slab: to be traced.

    Returns:
        What it reaches, and its stated and true error; or why there is no run.
    """
    true = exact(slab)
    cell_m = EDGE_M / slab.across
    thickness_m = slab.layers * cell_m
    start = time.perf_counter()
    try:
        run = bench.run(
            {
                "droplet_absorption_per_m": (1 - slab.albedo) * slab.depth / thickness_m,
                "droplet_scattering_per_m": slab.albedo * slab.depth / thickness_m,
                "droplet_temperature_K": _SPRAY_K,
            },
            size_m=(EDGE_M, thickness_m, EDGE_M),
            cells=slab.across,
            domain={
                "edge_m": EDGE_M,
                "leaf_edge_m": 1.01 * cell_m,
                # The middle of an odd number of layers is the middle of a cell.
                "centre_m": [0.0, slab.layers % 2 * cell_m / 2, 0.0],
            },
            camera={
                "model": "orthographic",
                "pixels": [slab.pixels, slab.pixels],
                "field_m": [0.01, 0.01],
            },
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
    truth_K = np.full(
        run.maps.emissivity.shape, temperature_of_radiance(radiance, filter_um=filter_um)
    )
    weights = run.weights
    reached = (
        float(weights.liquid.mean(dtype=float)) / own,
        float(weights.wall.mean(dtype=float)),
        float(weights.background.mean(dtype=float)),
    )
    return SlabOutcome(slab, true, reached, Stated.of(run, (truth_K, truth_K)), seconds)


def bench_slabs(
    bench: Bench, chosen: list[Slab], *, say: Callable[[str], None] | None = None
) -> list[SlabOutcome]:
    """Runs the slabs, one after the other.

    Args:
        bench: where they run.
        chosen: the slabs.
        say: takes a line for each.

    Returns:
        An outcome for each slab.
    """
    outcomes = []
    for slab in chosen:
        outcomes.append(measure_slab(bench, slab))
        if say is not None:
            say(" | ".join(_row(outcomes[-1])))
    return outcomes


def _row(outcome: SlabOutcome) -> list[str]:
    slab, stated = outcome.slab, outcome.stated
    pairs = zip(outcome.reached, outcome.true, strict=True)
    said = (f"**{outcome.message}**", "", "")
    if stated is not None:
        said = stated.text, stated.true, stated.ratio
    return [
        f"{slab.depth:g}",
        f"{slab.depth / slab.layers:g}",
        f"{slab.albedo:g}",
        f"{slab.g:g}",
        *(f"{one:.4f} ({other:.4f})" for one, other in pairs),
        *said,
        f"{outcome.seconds:.1f}",
    ]


def slab_table(outcomes: list[SlabOutcome]) -> str:
    """Markdown; a true error in bold is that of a row that does not hold.

    Args:
        outcomes: of the slabs.
    """
    head = ("depth", "of a cell", "albedo", "g", "emission (exact)", "reflection (exact)",
            "transmission (exact)", "stated", "true", "stated / true", "s")  # fmt: skip
    return Table.of(head, [_row(outcome) for outcome in outcomes]).markdown()
