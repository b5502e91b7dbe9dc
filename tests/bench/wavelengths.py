"""True and stated error of the number of wavelengths: images with few nodes against many.

    python -m tests.bench wavelengths --scene gdi-cone --scene droplets-only --aachenbomb CASE

Some minutes a scene; CASE is an OpenFOAM case of the tutorial aachenBomb. All is traced twice, with
ordinates of another seed: the mean product of both differences of T_app is the square of the error
of the wavelengths, free of noise.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.accuracy.node_traces import node_settings, summed
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.medium.frame import Frame
from cldit.medium.octree import build_octree, build_octrees
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.optics.wavelengths import Wavelengths
from cldit.prepare.medium import properties_of
from cldit.prepare.spray_factory import make_spray
from cldit.radiance.boundary import Surroundings
from cldit.scene import Scene, load_scene, parse_scene
from cldit.spray.result import Spray
from cldit.transport.trace import settings_for, trace, trace_each

# Of the tutorial's vapour 0.6 % is up to 4 K hotter; some droplets are at their critical point.
_HOTTEST_VAPOUR_K = 794.0
_HOTTEST_LIQUID_K = 530.0
_SEEDS = (1, 1001)


def imported(case: Path) -> dict[str, Any]:
    """Scene of the tutorial's spray: one hole at the top of a narrow vessel, hot and dense gas."""
    return {
        "name": "aachenbomb",
        "domain": {"centre_m": [0.0, 0.0, -0.045], "edge_m": 0.11},
        "spray": {
            "model": "cfd",
            "file": str(case),
            "nozzle_m": [0.0, 0.0995, 0.0],
            "axis": "-y",
        },
        "camera": {"field_m": [0.03, 0.1]},
        "background": {"radius_m": 0.052},
        "walls": {"temperature_K": 450.0},
    }


def scene_of(data: dict[str, Any], given: argparse.Namespace, **optics: Any) -> Scene:
    """The scene, small, with preset `spectral` and these keys of its optics."""
    data = {key: dict(value) if isinstance(value, dict) else value for key, value in data.items()}
    for key, values in {
        "camera": {"pixels": [given.pixels, given.pixels]},
        "transport": {"directions": given.directions, "audit": False, "phase": given.phase},
        "optics": {"preset": "spectral", "compare_paper": False, **optics},
        "domain": {"leaf_edge_m": given.leaf_edge_m},
    }.items():
        data[key] = {**data.get(key, {}), **values}
    return parse_scene(data)


def within_data(spray: Spray) -> Spray:
    """The spray no hotter than the optical data of n-heptane reach."""
    vapour, parcels = spray.vapour, spray.parcels
    if vapour is not None:
        kelvin = np.minimum(vapour.temperature_K, _HOTTEST_VAPOUR_K)
        vapour = replace(vapour, temperature_K=kelvin)
    if parcels is not None:
        kelvin = np.minimum(parcels.temperature_K, _HOTTEST_LIQUID_K)
        parcels = replace(parcels, temperature_K=kelvin)
    return replace(spray, vapour=vapour, parcels=parcels)


def chosen_and_maps(
    scene: Scene, spray: Spray, device: Device
) -> tuple[Wavelengths, tuple[Maps, ...]]:
    """What was chosen, and the noise-free evaluation of its traces, one for each seed."""
    found = properties_of(scene, spray, cache=default_cache())
    domain = scene.domain
    frame = Frame.around(centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_m)
    split = domain.optical_depth_split
    trees = build_octrees(frame, list(found.sources), optical_depth_split=split, device=device)
    quadrature = found.chosen.quadrature
    nothing = build_octree(frame, None, [], optical_depth_split=1.0)
    reference = trace(nothing, scene, device, settings_for(scene, None)).weights
    maps = []
    for seed in _SEEDS:
        settings = [
            replace(one, seed=seed + number)
            for number, one in enumerate(node_settings(scene, quadrature, found.phases))
        ]
        every = trace_each(list(trees), scene, device, settings, report=None)
        traced = summed(every, quadrature, scene)
        maps.append(
            evaluate_radiance(
                traced.spectral,
                reference,
                background_temperatures_K=scene.background.temperatures_K,
                surroundings=Surroundings.from_scene(scene),
                filter_um=quadrature.filter_um,
                nodes=found.chosen.nodes,
                sensor=None,
                shots=1,
                references=1,
            )
        )
    return found.chosen, tuple(maps)


def apart_K(maps: tuple[Maps, ...], true: tuple[Maps, ...]) -> tuple[float, float]:
    """RMS difference in T_app that both seeds share, and what a single seed shows."""
    here = np.logical_and.reduce([one.emissivity > VISIBLE_EMISSIVITY for one in (*maps, *true)])
    first, second = (
        one.apparent_temperature_K.astype(float) - other.apparent_temperature_K
        for one, other in zip(maps, true, strict=True)
    )
    here &= np.isfinite(first) & np.isfinite(second)
    shared = float(np.mean(first[here] * second[here]))
    return float(np.sqrt(max(shared, 0.0))), float(np.sqrt(np.mean(first[here] ** 2)))


def main() -> None:
    """A row for each scene and accuracy: nodes, stated and true error, and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", default=[])
    parser.add_argument("--aachenbomb", type=Path, metavar="CASE")
    parser.add_argument("--accuracy", type=float, nargs="+", default=[1.0, 0.3, 0.1])
    parser.add_argument("--nodes", type=int, nargs="*", default=[], help="and with so many")
    parser.add_argument("--true-nodes", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--leaf-edge-m", type=float, default=2e-3)
    parser.add_argument("--directions", type=int, default=32)
    parser.add_argument("--phase", choices=["mie", "isotropic"], default="mie")
    given = parser.parse_args()
    sources = [load_scene(name).model_dump(mode="json") for name in given.scene]
    sources += [imported(given.aachenbomb)] if given.aachenbomb else []
    device = open_device(None)
    print("scene            asked  nodes  stated    true one seed  stated / true", flush=True)
    for data in sources:
        spray = within_data(make_spray(scene_of(data, given).spray, device, cache=default_cache()))
        _, true = chosen_and_maps(
            scene_of(data, given, wavelengths=given.true_nodes), spray, device
        )
        asked: list[dict[str, Any]] = [{"spectral_error_K": each} for each in given.accuracy]
        asked += [{"wavelengths": each} for each in given.nodes]
        for optics in asked:
            chosen, maps = chosen_and_maps(scene_of(data, given, **optics), spray, device)
            error_K, noisy_K = apart_K(maps, true)
            stated_K = chosen.error_K
            print(
                f"{data['name']:15s} {optics.get('spectral_error_K', 0):6g} "
                f"{len(chosen.nodes):6d} {stated_K:7.3f} {error_K:7.3f} {noisy_K:8.3f} "
                f"{stated_K / max(error_K, 1e-9):8.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
