"""Extreme media, with stated and true error of T_app.

The truth of a medium in voxels is `path`, twice, with nine rays through each pixel; that of parcels
is the spray that they sample, in boxes of a tenth of its width.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import ClditError
from cldit.run import Run
from cldit.show.page import Table
from cldit.spray.extent import Box
from cldit.spray.result import Parcels, Spray
from tests.verify.blocks import Blocks
from tests.verify.cavity import EDGE_M
from tests.verify.stated import Stated, apparent_K

_PIXELS = 15
_RAYS = 3  # along an edge of a pixel, of the truth
_SAMPLES = 4096
_SIZE_m = EDGE_M / 2  # of the block of voxels
_WIDTH_m = 0.01  # standard deviation of the plume that parcels are drawn from
_REACH = 3.0  # of these, where the plume ends
_DROPLET_m = 10e-6
_PLUME_DEPTH = 2.0  # about, through its middle
_SEED = 3


@dataclass(frozen=True)
class Extreme:
    """measure: returns the run and the truth, T_app (H, W) twice."""

    name: str
    measure: Callable[[Blocks], tuple[Run, tuple[Floats, Floats]]]


@dataclass(frozen=True)
class ExtremeOutcome:
    """stated: None if the case ended with the message instead."""

    name: str
    stated: Stated | None
    seconds: float = np.nan
    message: str = ""

    @property
    def holds(self) -> bool:
        """True if at least half of the true error is stated."""
        return self.stated is not None and self.stated.holds


def bench_extremes(
    blocks: Blocks, chosen: list[Extreme], *, say: Callable[[str], None] | None = None
) -> list[ExtremeOutcome]:
    """Runs the cases one after the other; `say` takes a line for each."""
    outcomes = []
    for case in chosen:
        try:
            run, truth_K = case.measure(blocks)
            seconds = sum(stage.seconds for stage in run.info.stages)
            outcome = ExtremeOutcome(case.name, Stated.of(run, truth_K), seconds)
        except ClditError as error:
            outcome = ExtremeOutcome(case.name, None, message=str(error))
        outcomes.append(outcome)
        if say is not None:
            say(" | ".join(_row(outcome)))
    return outcomes


def extremes_table(outcomes: list[ExtremeOutcome]) -> Table:
    """Rows; a true error of which less than half is stated is in bold."""
    return Table(("case", "stated", "true", "stated / true", "s"),
                    [_row(outcome) for outcome in outcomes])  # fmt: skip


def _row(outcome: ExtremeOutcome) -> list[str]:
    stated = outcome.stated
    if stated is None:
        return [outcome.name, f"**{outcome.message}**", "", "", ""]
    return [outcome.name, stated.text, stated.true, stated.ratio, f"{outcome.seconds:.1f}"]


def extremes() -> list[Extreme]:
    """Cases of the page."""
    return [*_blocks(), *_plumes()]


def _blocks() -> Iterator[Extreme]:
    even = (1, 1, 1)
    for depth, albedo in ((2.0, 0.9), (2.0, 1.0), (1e6, 0.5), (1e6, 0.9)):
        name = f"an even cube of depth {depth:g}, albedo {albedo:g}"
        yield Extreme(name, _block(np.full(even, depth), np.full(even, albedo)))
    core = np.zeros((9, 9, 9))
    core[4, 4, 4] = 9 * 100.0
    name = "one core of depth 100 in nothing, albedo 0.9"
    yield Extreme(name, _block(core, np.full(core.shape, 0.9)))
    # Hotter by more, and the sensor saturates wherever that light comes to.
    name = "3000 K of depth 1e-4 beside a scatterer of depth 0.5, albedo 0.9"
    pair = np.array([2e-4, 1.0]).reshape(2, 1, 1)
    scatters = np.array([0.0, 0.9]).reshape(2, 1, 1)
    hot_K = np.array([3000.0, 300.0]).reshape(2, 1, 1)
    yield Extreme(name, _block(pair, scatters, hot_K))


def _block(
    depth: Floats, albedo: Floats, temperature_K: Floats | float = 400.0
) -> Callable[[Blocks], tuple[Run, tuple[Floats, Floats]]]:
    """A block of voxels; depth: of its whole edge, if all of it were such a voxel."""
    scene: dict[str, Any] = {
        "size_m": (_SIZE_m,) * 3,
        "walls": {"temperature_K": 300.0},
        "background": {"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
        "domain": {"edge_m": EDGE_M},
    }
    arrays = {
        "droplet_absorption_per_m": (1 - albedo) * depth / _SIZE_m,
        "droplet_scattering_per_m": albedo * depth / _SIZE_m,
        "droplet_temperature_K": np.broadcast_to(temperature_K, depth.shape),
    }

    def measure(blocks: Blocks) -> tuple[Run, tuple[Floats, Floats]]:
        run = blocks.run(arrays, camera=_camera(_PIXELS, 1.2 * _SIZE_m), **scene)
        one, other = (
            blocks.run(
                arrays,
                camera=_camera(_RAYS * _PIXELS, 1.2 * _SIZE_m),
                transport={
                    "method": "path",
                    "seed": seed,
                    "max_samples": _SAMPLES // _RAYS**2,
                    "accuracy_K": 0.01,
                    "audit": False,
                },
                **scene,
            )
            for seed in (7001, 7002)
        )
        return run, (_of_pixels(one), _of_pixels(other))

    return measure


def _camera(pixels: int, field_m: float) -> dict[str, Any]:
    return {"pixels": [pixels, pixels], "field_m": [field_m, field_m]}


def _of_pixels(run: Run) -> Floats:
    """T_app of pixels of several rays each."""

    def mean(image: NDArray[np.float32]) -> NDArray[np.float64]:
        blocks = image.reshape(_PIXELS, _RAYS, _PIXELS, _RAYS).astype(float)
        return np.asarray(blocks.mean(axis=(1, 3)))

    return apparent_K(run.weights.map(mean), run.scene)


def _plumes() -> Iterator[Extreme]:
    for count, name in ((1, "one parcel"), (100, "100"), (10_000, "1e4"), (1_000_000, "1e6")):
        yield Extreme(f"{name} of a plume" if count == 1 else f"{name} parcels of a plume",
                      partial(_plume, count=count))  # fmt: skip


def _droplets(position_m: Floats, share: Floats, extent: Box | None) -> Parcels:
    count = len(position_m)
    in_all = _PLUME_DEPTH * 2 * np.pi * _WIDTH_m**2 / (2 * np.pi / 4 * _DROPLET_m**2)
    return Parcels(
        position_m=position_m,
        diameter_m=np.full(count, _DROPLET_m),
        droplets=in_all * share,
        temperature_K=350.0 + 1000.0 * position_m[:, 0],
        density_kg_m3=np.full(count, 600.0),
        extent=extent,
    )


def _plume(blocks: Blocks, *, count: int) -> tuple[Run, tuple[Floats, Floats]]:
    """Parcels of a round plume, a normal distribution without its tails."""
    reach_m, cell_m = _REACH * _WIDTH_m, _WIDTH_m / 10
    scene: dict[str, Any] = {
        "spray": {"model": "cfd", "file": "made-by-the-case"},
        "camera": _camera(2 * _PIXELS, 2 * reach_m),
        "walls": {"temperature_K": 300.0},
        "background": {"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
        "domain": {"edge_m": EDGE_M / 2},
    }
    drawn = np.random.default_rng(_SEED).normal(scale=_WIDTH_m, size=(int(1.2 * count) + 8, 3))
    drawn = drawn[np.abs(drawn).max(axis=1) < reach_m][:count]
    parcels = _droplets(drawn, np.full(count, 1 / count), None)
    run = blocks.simulated(scene, Spray(parcels=parcels))
    middle = np.arange(-reach_m, reach_m - cell_m / 2, cell_m) + cell_m / 2
    law = np.exp(-((middle / _WIDTH_m) ** 2) / 2)
    share = (law[:, None, None] * law[:, None] * law).reshape(-1)
    places = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1).reshape(-1, 3)
    field = _droplets(places, share / share.sum(), Box(np.full(3, cell_m)))
    scene["transport"] = {"accuracy_K": 0.1, "audit": False}
    true = blocks.simulated(scene, Spray(parcels=field))
    truth_K = apparent_K(true.weights, true.scene)
    return run, (truth_K, truth_K)
