"""Scatter between seeds of a computed spray, gas included, and its split-half estimate.

    python -m tests.bench flow_seeds --seeds 4
    python -m tests.bench flow_seeds --seeds 4 --droplets-per-parcel 6000
    python -m tests.bench flow_seeds --seeds 4 --gas-cells-m 2e-3
    python -m tests.bench flow_seeds --seeds 2 --gas-cells-m 5e-4 --one-plume
    python -m tests.bench flow_seeds --seeds 6 --accuracy-K 4

A minute a seed. All is RMS of T_app over the pixels that have one, on cells of 0.39 mm. The error
of one image is the difference between two seeds over sqrt(2). Droplets of one seed in the gas of
another separate both parts.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.bench.budget import beside_reference
from cldit.bench.budget_scenes import Reference, budget_scene
from cldit.bench.case import changed
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.medium.cloud import SAMPLING, Kernel, variants
from cldit.prepare.spray_factory import make_spray
from cldit.run import Run, simulate
from cldit.scene import Scene, load_scene
from cldit.spray.result import Spray

Floats = NDArray[np.float64]

# Of the difference from another sample of half as many, whose square holds both errors, by the
# power -1/3 of the number; by -1/2 it would be 0.58 for 0.62.
_OTHER_SAMPLE = (1.0 + 2.0 ** (2 / 3)) ** -0.5
_OF_REFERENCE = range(2, 9)  # seeds of tests/bench/budget_reference.py
_PLUME = {"inclination_deg": 0.0, "azimuth_deg": 0.0}


def scene_of(given: argparse.Namespace) -> Scene:
    """gdi-flow in few pixels, traced so well that the spray's errors are left; or a plume of it."""
    camera: dict[str, Any] = {"pixels": [given.pixels, given.pixels], "rays_per_pixel": 4}
    domain = {"leaf_edge_m": 0.5e-3}
    spray: dict[str, Any] = {}
    if given.one_plume:
        camera |= {"field_m": [0.04, 0.06]}
        domain = {"edge_m": 0.12, "leaf_edge_m": 0.25e-3}
        spray = {"plumes": [_PLUME], "injected_mass_kg": 1.25e-6}
    return changed(
        load_scene("gdi-flow"),
        spray=spray,
        camera=camera,
        domain=domain,
        transport={"accuracy_K": 0.3, "audit": False, "directions": 48},
        optics={"compare_paper": False},
    )


def sprays_of(scene: Scene, count: int, device: Device, **spray: float) -> dict[int, Spray]:
    """Sprays of seeds 1 to `count`, with these keys."""
    seeds = range(1, count + 1)
    scenes = {seed: changed(scene, spray={"seed": seed, **spray}) for seed in seeds}
    return {
        seed: make_spray(one.spray, device, cache=default_cache()) for seed, one in scenes.items()
    }


def picture(scene: Scene, spray: Spray, device: Device) -> Floats:
    """T_app (H, W), NaN where it does not count."""
    return temperature_K(simulate(scene, device=device, spray=spray))


def temperature_K(run: Run) -> Floats:
    """T_app (H, W) of a run, NaN where it does not count."""
    maps = run.maps
    return np.where(maps.has_temperature, maps.apparent_temperature_K.astype(float), np.nan)


def apart_K(one: Floats, other: Floats) -> float:
    """RMS over the pixels that count in both."""
    return float(np.sqrt(np.nanmean((one - other) ** 2)))


def tell(what: str, each_K: Iterable[float]) -> None:
    """One line: RMS of some errors, and their range."""
    values = list(each_K)
    rms = float(np.sqrt(np.mean(np.square(values))))
    print(
        f"{what}: {rms:.2f} K ({min(values):.2f} to {max(values):.2f}, {len(values)})", flush=True
    )


def by_halves(scene: Scene, sprays: Mapping[int, Spray], device: Device) -> list[float]:
    """What each spray says of itself by halves of its parcels, which share its gas."""
    found = (variants(spray, kernel=Kernel(), seed=1).halves for spray in sprays.values())
    return [
        SAMPLING * apart_K(*(picture(scene, half, device) for half in halves)) for halves in found
    ]


def stated(scene: Scene, seeds: int, device: Device) -> None:
    """A line for each seed: what a run states, and what it errs by against the reference.

    The reference errs by chance, too: as much as is taken off. A seed that is in it shares that,
    and misses as much.
    """
    reference = Reference.load("gdi-flow", pixels=scene.camera.pixels[0])
    assert reference is not None
    for seed, spray in sprays_of(scene, seeds, device).items():
        run = simulate(scene, device=device, spray=spray)
        shared = 1 if seed in _OF_REFERENCE else -1
        found_K = apart_K(temperature_K(run), reference.temperature_K)
        true_K = (found_K**2 + shared * reference.error_K**2) ** 0.5
        assert run.errors is not None
        errors = beside_reference(run.errors, scene)
        assert errors.total_K is not None
        ratio, text = errors.total_K / true_K, errors.text
        print(f"seed {seed}: stated {text}, true {true_K:.2f} K: {ratio:.2f}", flush=True)
        (gas,) = (cause for cause in run.errors.causes if cause.name == "gas grid")
        print(f"  in all {run.errors.text}, gas grid {gas.text}: {gas.how}", flush=True)


def main() -> None:
    """Prints the scatter of seeds, and the parts of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--droplets-per-parcel", type=float, default=1500.0)
    parser.add_argument("--one-plume", action="store_true", help="one of the eight, straight down")
    parser.add_argument("--accuracy-K", type=float, help="asked of runs, against the reference")
    parser.add_argument("--gas-cells-m", type=float, help="against those of the scene, and no more")
    given = parser.parse_args()
    device, scene = open_device(), scene_of(given)
    if given.accuracy_K is not None:
        with TemporaryDirectory() as folder:
            wanted = budget_scene("gdi-flow", pixels=given.pixels, folder=Path(folder))
        asked = changed(wanted, transport={"accuracy_K": given.accuracy_K})
        stated(asked, given.seeds, device)
        return
    droplets = given.droplets_per_parcel
    sprays = sprays_of(scene, given.seeds, device, droplets_per_parcel=droplets)
    pictures = {seed: picture(scene, spray, device) for seed, spray in sprays.items()}
    pairs = list(combinations(sprays, 2))
    tell("seeds", (apart_K(pictures[a], pictures[b]) / 2**0.5 for a, b in pairs))
    if given.gas_cells_m is not None:
        other = changed(scene, spray={"box": {"spacing_m": given.gas_cells_m}})
        again = sprays_of(other, given.seeds, device, droplets_per_parcel=droplets)
        coarse = {seed: picture(scene, spray, device) for seed, spray in again.items()}
        alike = (apart_K(pictures[a], coarse[a]) for a in sprays)
        tell("same seed, other cells of gas", alike)
        others = (apart_K(pictures[a], coarse[b]) for a in sprays for b in sprays if a != b)
        tell("another seed, other cells of gas", others)
        means = (np.mean(list(each.values()), axis=0) for each in (pictures, coarse))
        print(f"mean over seeds, other cells of gas: {apart_K(*means):.2f} K", flush=True)
        return
    tell("said by halves", by_halves(scene, sprays, device))
    swapped = {
        (a, b): picture(scene, replace(sprays[a], vapour=sprays[b].vapour), device)
        for pair in zip(range(1, given.seeds, 2), range(2, given.seeds + 1, 2), strict=False)
        for a, b in (pair, pair[::-1])
    }
    gas = (apart_K(pictures[a], one) / 2**0.5 for (a, _), one in swapped.items())
    tell("same droplets in the gas of another seed", gas)
    own = (apart_K(pictures[b], one) / 2**0.5 for (_, b), one in swapped.items())
    tell("other droplets in the same gas", own)
    halved = sprays_of(scene, given.seeds, device, droplets_per_parcel=2 * droplets)
    half = {seed: picture(scene, spray, device) for seed, spray in halved.items()}
    said = (_OTHER_SAMPLE * apart_K(pictures[a], half[b]) for a in sprays for b in half if a != b)
    tell("said by another seed of half as many parcels", said)


if __name__ == "__main__":
    main()
