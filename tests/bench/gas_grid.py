"""Stated error of a computed gas's grid against the gas of half the cells.

    python -m tests.bench gas_grid
    python -m tests.bench gas_grid --accuracy-K 3 --seeds 1 --injector gdi-flow

Two injectors, during and after the injection, three seeds: half an hour. The step is the RMS
difference of T_app between the gas that the run chose and one of half its cells, on the run's cells
of the octree, and on cells of 0.5 mm.
Random numbers belong to parcel and time, so both have the same eddies.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Any

from cldit.bench.case import changed
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.prepare.spray_factory import make_spray
from cldit.run import simulate
from cldit.scene import Scene, load_scene
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cache import times_together
from tests.bench.flow_seeds import apart_K, picture
from tests.unit.spray.flow.references import SPRAY_G

TIMES_S = (0.4e-3, 0.95e-3)  # during the injection, and after it
_CELL_m = 0.5e-3  # voxels of the gas
_HEAD = (
    "| injector | ms | seed | gas, mm | stated, K | gas grid, K | step to half, K "
    "| in cells of 0.5 mm | core-s |"
)
# Assumed to be about those of n-heptane: preset `paper` refuses its own for another fuel.
_OPTICS = {"n": 1.339, "k": 0.0342, "vapour_m2_mol": 50.1}


def scene_of(injector: str, *, seed: int, time_s: float, accuracy_K: float) -> Scene:
    """gdi-flow, or Spray G in its place, in 100 x 100 pixels."""
    spray: dict[str, Any] = {"seed": seed, "time_s": time_s}
    optics: dict[str, Any] = {"compare_paper": False}
    if injector == "Spray G":
        names = ("fuel", "fuel_temperature_K", "ambient", "plumes")
        spray |= {name: SPRAY_G.model_dump(mode="json")[name] for name in names}
        optics |= _OPTICS
    return changed(
        load_scene("gdi-flow"),
        spray=spray,
        camera={"pixels": [100, 100]},
        transport={"accuracy_K": accuracy_K},
        optics=optics,
    )


def in_cells(scene: Scene, cell_m: float) -> Scene:
    """The scene in cells of the octree that are in line with the gas's, and not audited."""
    return changed(
        scene,
        domain={"edge_m": 256 * _CELL_m, "leaf_edge_m": cell_m * (1 + 1e-6)},
        transport={"audit": False, "accuracy_K": 0.3},
        camera={"rays_per_pixel": 1},
    )


def rows(injector: str, seed: int, accuracy_K: float, device: Device) -> Iterator[str]:
    """Lines of the table for one spray at `TIMES_S`."""
    for time_s in TIMES_S:
        scene = scene_of(injector, seed=seed, time_s=time_s, accuracy_K=accuracy_K)
        start = time.process_time()
        run = simulate(scene, device=device)
        cost_s = time.process_time() - start
        assert run.errors is not None and isinstance(scene.spray, LagrangianSpray)
        (gas,) = (one for one in run.errors.causes if one.name == "gas grid")
        gas_m = run.info.spray["gas_spacing_m"]
        sprays = [
            make_spray(scene.spray.on_gas(gas_m / parts), cache=default_cache()) for parts in (1, 2)
        ]
        octree = [one.note for one in run.info.stages if one.name == "octree"][-1]
        own_m = 1e-3 * float(octree.split()[-2])  # "... leaves, finest 1 mm"
        steps = [
            apart_K(*(picture(in_cells(scene, cell_m), spray, device) for spray in sprays))
            for cell_m in (own_m, _CELL_m)
        ]
        yield (
            f"| {injector} | {1e3 * time_s:g} | {seed} | {1e3 * gas_m:.2g} | {run.errors.text} "
            f"| {gas.text} | {steps[0]:.2f} ({1e3 * own_m:g} mm) | {steps[1]:.2f} | {cost_s:.0f} |"
        )


def main() -> None:
    """Prints the table, line by line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accuracy-K", type=float, default=6.0)
    parser.add_argument("--seeds", type=int, default=3)
    injectors = ("gdi-flow", "Spray G")
    parser.add_argument("--injector", action="append", default=[], choices=injectors)
    given = parser.parse_args()
    device = open_device()
    print(_HEAD, "|" + " --- |" * (_HEAD.count("|") - 1), sep="\n", flush=True)
    for injector in given.injector or injectors:
        for seed in range(1, given.seeds + 1):
            with times_together(TIMES_S):
                for row in rows(injector, seed, given.accuracy_K, device):
                    print(row, flush=True)


if __name__ == "__main__":
    main()
