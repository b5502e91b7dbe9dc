"""True and stated error of pixel sampling: one ray per pixel against 64.

    python -m tests.bench pixel_sampling --scene methane-jet --scene gdi-cone --aachenbomb CASE

CASE is an OpenFOAM case of the tutorial aachenBomb. Cells, ordinates and seed are the same in both
images.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.sources.pixel_sampling import pixel_error
from cldit.bench.case import changed
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.scene import Scene, load_scene, parse_scene
from cldit.transport.trace import trace
from tests.bench.case import Case
from tests.bench.wavelengths import imported

_MOST_RAYS = 64


@dataclass(frozen=True)
class Sampled:
    """Pixels along an edge, rays a pixel, and the error that is stated and true, K.

    core_s: processor time of the trace with its sample.
    """

    pixels: int
    rays: int
    stated_K: float
    true_K: float
    core_s: float


def scene_of(data: dict[str, Any], *, leaf_m: float, order: int | None) -> Scene:
    """The scene on these cells, at 1 K asked, its light scattered up to `order` times."""
    data = {
        **data,
        "domain": {**data["domain"], "leaf_edge_m": leaf_m},
        "optics": {**data.get("optics", {}), "compare_paper": False},
        "transport": {**data.get("transport", {}), "accuracy_K": 1.0, "directions": 32},
    }
    data["transport"].update(order=order, audit=False)
    return parse_scene(data)


def measured(case: Case, *, pixels: int, rays: int) -> Sampled:
    """Of the case at so many pixels along an edge."""

    def seen(number: int) -> Case:
        camera = {"pixels": [pixels, pixels], "rays_per_pixel": number}
        return case.seen(changed(case.scene, camera=camera))

    one, most = seen(rays), seen(_MOST_RAYS)
    result, cost = one.run(replace(one.settings(), subpixels=True))
    true = trace(most.tree, most.scene, most.device, most.settings()).weights

    def visible(weights: Weights) -> Any:
        return 1.0 - weights.background > VISIBLE_EMISSIVITY

    apart = one.temperature_K(result.weights) - one.temperature_K(true)
    both = np.isfinite(apart) & visible(result.weights) & visible(true)
    found = pixel_error(one._temperature, ImagePair.of(result))
    assert found.error_K is not None
    true_K = float(np.sqrt(np.mean(apart[both] ** 2)))
    return Sampled(pixels, rays, found.error_K, true_K, cost.core_s)


def main() -> None:
    """Prints stated and true errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", default=[], metavar="NAME")
    parser.add_argument("--aachenbomb", type=Path, metavar="CASE")
    parser.add_argument("--pixels", type=int, nargs="+", default=[50, 100, 200])
    parser.add_argument("--rays", type=int, nargs="+", default=[1], choices=[1, 4, 16])
    parser.add_argument("--leaf-edge-m", type=float, default=1e-3)
    parser.add_argument("--order", type=int, help="0 is exact and fast; all where left out")
    given = parser.parse_args()
    named = {name: load_scene(name).model_dump(mode="json") for name in given.scene}
    if given.aachenbomb is not None:
        named["aachenBomb"] = imported(given.aachenbomb)
    device = open_device()
    print("scene          pixels rays  stated   true  ratio  core-s")
    for name, data in named.items():
        scene = scene_of(data, leaf_m=given.leaf_edge_m, order=given.order)
        case = Case.of(scene, device, cache=default_cache())
        for pixels in given.pixels:
            for rays in given.rays:
                one = measured(case, pixels=pixels, rays=rays)
                print(
                    f"{name:14} {pixels:6} {rays:4} {one.stated_K:7.3g} {one.true_K:6.3g} "
                    f"{one.stated_K / one.true_K:6.2f} {one.core_s:7.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
