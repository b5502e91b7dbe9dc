"""Slabs against discrete ordinates: weights, and stated and true error of T_app."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import product

import numpy as np

from cldit.bench.case import BenchError
from cldit.errors import ClditError
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.show.page import Table
from tests.verify.blocks import Blocks
from tests.verify.slab import EDGE, disort, run_slab
from tests.verify.stated import Stated

_SPRAY_K, _WALL_K = 400.0, 300.0
_STREAMS = 48
_FEW_PIXELS = 3


@dataclass(frozen=True)
class Slab:
    """depth: optical. layers: cells through it, `across` along an edge of the cube. pixels: along
    an edge of the image."""

    depth: float
    albedo: float
    g: float
    layers: int = 4
    across: int = 32
    pixels: int = 15


@dataclass(frozen=True)
class SlabOutcome:
    """reached, true: emission, reflection and transmission along the normal. stated: None without a
    run, for the reason in `message`."""

    slab: Slab
    true: tuple[float, float, float]
    reached: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    stated: Stated | None = None
    message: str = ""

    @property
    def holds(self) -> bool:
        """True if at least half of the true error is stated."""
        return self.stated is not None and self.stated.holds


def exact(slab: Slab) -> tuple[float, float, float]:
    """Emission, reflection, transmission along the normal (Henyey-Greenstein); their sum is 1."""
    moments = slab.g ** np.arange(_STREAMS + 1.0)
    transmission, reflection = disort(slab.depth, slab.albedo, moments, streams=_STREAMS)
    return 1.0 - transmission - reflection, reflection, transmission


def need_discrete_ordinates() -> None:
    """Raises BenchError if PythonicDISORT is not installed."""
    if find_spec("PythonicDISORT") is None:
        raise BenchError(
            "the slabs need PythonicDISORT, which is not installed; get it with: "
            "pip install PythonicDISORT"
        )


def slabs(*, few: bool = False) -> list[Slab]:
    """Slabs of the page, or one of each kind.

    Thin slabs are wider, as light travels far along them. Where light scatters more than fifty
    times the image has few pixels.
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


def measure_slab(blocks: Blocks, slab: Slab) -> SlabOutcome:
    """Traces a slab at 400 K between walls at 300 K."""
    true = exact(slab)
    cell_m = EDGE / slab.across
    try:
        run = run_slab(
            blocks.run,
            slab.depth,
            slab.albedo,
            layers=slab.layers,
            cells=slab.across,
            # The middle of an odd number of layers is the middle of a cell.
            domain={"centre_m": [0.0, slab.layers % 2 * cell_m / 2, 0.0]},
            camera={
                "model": "orthographic",
                "pixels": [slab.pixels, slab.pixels],
                "field_m": [0.01, 0.01],
            },
            walls={"temperature_K": _WALL_K},
            transport={"phase": {"henyey_greenstein": slab.g} if slab.g else "isotropic"},
        )
    except ClditError as error:
        return SlabOutcome(slab, true, message=str(error))
    filter_um = scene_filter(run.scene)
    own, wall = (float(band_radiance(t, filter_um=filter_um)) for t in (_SPRAY_K, _WALL_K))
    emission, reflection, transmission = true
    radiance = np.array((emission * own + reflection * wall) / (1.0 - transmission))
    shape = run.maps.emissivity.shape
    truth_K = np.full(shape, temperature_of_radiance(radiance, filter_um=filter_um))
    weights = run.weights
    reached = (
        float(weights.liquid.mean(dtype=float)) / own,
        float(weights.wall.mean(dtype=float)),
        float(weights.background.mean(dtype=float)),
    )
    return SlabOutcome(slab, true, reached, Stated.of(run, (truth_K, truth_K)))


def bench_slabs(
    blocks: Blocks, chosen: list[Slab], *, say: Callable[[str], None] | None = None
) -> list[SlabOutcome]:
    """Traces the slabs one after the other; `say` takes a line for each."""
    outcomes = []
    for slab in chosen:
        outcomes.append(outcome := measure_slab(blocks, slab))
        if say is not None:
            say(f"{slab}: {cell(outcome)}")
    return outcomes


def slab_table(outcomes: list[SlabOutcome]) -> Table:
    """Stated / true error in K, a column for each depth; bold if less than half is stated."""
    depths = sorted({outcome.slab.depth for outcome in outcomes})
    rows: dict[tuple[str, ...], dict[float, str]] = {}
    for outcome in outcomes:
        slab = outcome.slab
        thick = slab.layers == 1 and slab.depth >= 1
        key = f"{slab.albedo:g}", f"{slab.g:g}", "1" if thick else ""
        rows.setdefault(key, {})[slab.depth] = cell(outcome)
    return Table(
        ("albedo", "g", "layers", *(f"depth {depth:g}" for depth in depths)),
        [[*key, *(row.get(depth, "") for depth in depths)] for key, row in rows.items()],
    )


def cell(outcome: SlabOutcome) -> str:
    """Entry of the table."""
    if outcome.stated is None:
        return f"**{outcome.message}**"
    if outcome.stated.true_K is None:
        return "-"
    known_K = outcome.stated.known_K
    text = f"{'?' if known_K is None else f'{known_K:.2g}'}/{outcome.stated.true_K:.2g}"
    text = f"≥{text}" if outcome.stated.text.startswith("at least") else text
    return text if outcome.holds else f"**{text}**"
