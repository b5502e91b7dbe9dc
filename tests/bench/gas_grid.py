"""Stated errors of a computed spray's gas grid and parcels, against finer gas and another seed.

    python -m tests.bench gas_grid --injector one --seeds 2
    python -m tests.bench gas_grid --injector eight --seeds 2 --gas-cells-m 1e-3 --quarter
    python -m tests.bench gas_grid --injector one --droplets-per-parcel 190

A row for each injector, seed, time and size of pixels: some 2 core-minutes for `one` at 1 mm, all
rows of a seed together. The stated error is that of a run: from gas of twice and four times the
cells. True is the RMS difference of T_app from gas of half the cells (`--quarter`: of a quarter).
Random numbers belong to parcel and time, so all gas grids have the same eddies, and the difference
is the grid's. The true error of parcels is the difference from the next seed over sqrt(2). All
images are of the same octree, with cells of 0.5 mm.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from cldit.accuracy.sources.gas_grid import Rest, head_error_m
from cldit.bench.case import changed
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.prepare.spray_factory import make_spray
from cldit.scene import Scene, load_scene
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cache import times_together
from tests.bench.flow_seeds import apart_K, by_halves, picture

TIMES_S = (0.4e-3, 0.6e-3, 0.95e-3)  # two during the injection, and one after it
PIXELS_m = (2e-3, 0.5e-3)
_CELL_m = 0.5e-3  # of the octree
_HEAD = (
    "| injector | ms | seed | gas, mm | pixel, mm | steps, K | | correlation | gas grid stated, K "
    "| true, K | stated / true | vapour to, mm | on finer gas | parcels stated, K | true, K |"
)
_ONE: dict[str, Any] = {
    "plumes": [{"inclination_deg": 0.0, "azimuth_deg": 0.0}],
    "injected_mass_kg": 1.25e-6,
}
_FIELD_m = {"one": (0.04, 0.08), "eight": (0.1, 0.08), "unequal": (0.1, 0.08)}


def scene_of(given: argparse.Namespace, *, seed: int, time_s: float, pixel_m: float) -> Scene:
    """gdi-flow, one of its plumes straight down, or with one of its holes off by 0.5 degrees."""
    spray: dict[str, Any] = {"seed": seed, "time_s": time_s}
    scene = load_scene("gdi-flow")
    if given.injector == "one":
        spray |= _ONE
    if given.injector == "unequal":
        plumes = scene.spray.model_dump(mode="json")["plumes"]
        plumes[0]["inclination_deg"] += 0.5
        spray["plumes"] = plumes
    if given.droplets_per_parcel is not None:
        spray["droplets_per_parcel"] = given.droplets_per_parcel
    field_m = _FIELD_m[given.injector]
    return changed(
        scene,
        spray=spray,
        domain={"edge_m": 256 * _CELL_m, "leaf_edge_m": _CELL_m * (1 + 1e-6)},
        camera={
            "pixels": [round(size / pixel_m) for size in field_m],
            "field_m": field_m,
            "rays_per_pixel": 4 if pixel_m > _CELL_m else 1,
        },
        transport={"audit": False, "accuracy_K": 0.3, "directions": 48},
        optics={"compare_paper": False},
    )


def rows(given: argparse.Namespace, seed: int, device: Device) -> Iterator[str]:
    """Lines of the table for one seed, at `TIMES_S`."""
    h_m, finest = given.gas_cells_m, 4 if given.quarter else 2
    for time_s in TIMES_S:
        scene = scene_of(given, seed=seed, time_s=time_s, pixel_m=PIXELS_m[0])
        other = changed(scene, spray={"seed": seed + 1})
        assert isinstance(scene.spray, LagrangianSpray)
        assert isinstance(other.spray, LagrangianSpray)
        four, twice, here, finer = (
            make_spray(scene.spray.on_gas(part * h_m), device, cache=default_cache())
            for part in (4, 2, 1, 1 / finest)
        )
        chance = make_spray(other.spray.on_gas(h_m), device, cache=default_cache())
        heads_m = [one.notes["vapour_penetration_m"] for one in (four, twice, here, finer)]
        head_m = head_error_m(heads_m[2::-1])
        for pixel_m in PIXELS_m:
            seen = scene_of(given, seed=seed, time_s=time_s, pixel_m=pixel_m)
            largest, larger, image, truth = (
                picture(seen, spray, device) for spray in (four, twice, here, finer)
            )
            before_K, last_K, true_K = (
                apart_K(*pair) for pair in pairwise((largest, larger, image, truth))
            )
            rest = Rest.of(last_K, before_K, apart_K(largest, image))
            parcels = ""
            if pixel_m == PIXELS_m[0]:
                halves_K = by_halves(seen, {seed: here}, device)[0]
                parcels = (
                    f"{halves_K:.2f} | {apart_K(image, picture(seen, chance, device)) / 2**0.5:.2f}"
                )
            correlation = "" if isinstance(rest, str) else f"{rest.correlation:.2f}"
            stated_K = last_K * (1.0 if isinstance(rest, str) else rest.factor)
            yield (
                f"| {given.injector} | {1e3 * time_s:g} | {seed} | {1e3 * h_m:.2g} "
                f"| {1e3 * pixel_m:g} | {before_K:.2f} | {last_K:.2f} | {correlation} "
                f"| {'at least ' * isinstance(rest, str)}{stated_K:.2f} "
                f"| {true_K:.2f} | {stated_K / true_K:.2f} "
                f"| {1e3 * heads_m[2]:.1f} +- {1e3 * head_m:.1f} | {1e3 * heads_m[3]:.1f} "
                f"| {parcels or ' | '} |"
            )


def main() -> None:
    """Prints the table, line by line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--injector", choices=tuple(_FIELD_m), default="one")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 9])
    parser.add_argument("--gas-cells-m", type=float, default=1e-3)
    parser.add_argument("--droplets-per-parcel", type=float, help="in place of the scene's")
    parser.add_argument("--quarter", action="store_true", help="truth by a quarter of the cells")
    given = parser.parse_args()
    device = open_device()
    print(_HEAD, "|" + " --- |" * (_HEAD.count("|") - 1), sep="\n", flush=True)
    with times_together(TIMES_S):
        for seed in given.seeds:
            for row in rows(given, seed, device):
                print(row, flush=True)


if __name__ == "__main__":
    main()
