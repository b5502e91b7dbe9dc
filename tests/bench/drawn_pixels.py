"""Errors from 10,000 drawn pixels, over many draws, against those of all pixels.

    python -m tests.bench drawn_pixels --scene methane-jet --halvings 6 7 8
    python -m tests.bench drawn_pixels --scene gdi-cone --halvings 7 8 9

The images are the same, with all pixels traced: only the draw differs.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from cldit.accuracy.allocation import Allocation
from cldit.accuracy.drawn_pixels import DrawnPixels
from cldit.accuracy.image_pair import ImageDifference
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.discretisation import spectral_K
from cldit.accuracy.variant_tracer import VariantTracer, temperature_of
from cldit.bench.case import changed
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.prepare.preview import previewed
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene


def tracer_of(scene: Scene) -> VariantTracer:
    """The tracer of a scene's first coarse images."""
    problem = Problem(scene, open_device(), Stages(None), default_cache(), None)
    allocation = Allocation.of(scene, scene.transport.accuracy_K)
    asked_K = spectral_K(scene, allocation["wavelengths"])
    first = Resolution.first(scene, ordinates_K=allocation["trace"], spectral_K=asked_K)
    return problem.tracer(first)[1]


def main() -> None:
    """A row for each step between cells."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", required=True)
    parser.add_argument("--pixels", type=int, default=1000)
    parser.add_argument("--halvings", type=int, nargs="+", default=[7, 8, 9])
    parser.add_argument("--draws", type=int, default=24)
    given = parser.parse_args()
    camera: Any = {"pixels": [given.pixels] * 2}
    scene = changed(
        load_scene(given.scene),
        camera=camera,
        transport={"accuracy_K": 1.0},
        optics={"compare_paper": False},
    )
    tracer = tracer_of(scene)
    whole = replace(
        tracer, drawn=None, temperature=temperature_of(tracer.scene, tracer.prepared), levels={}
    )
    whole = replace(whole, settings=replace(whole.settings, subpixels=False))
    _, seen = previewed(tracer.scene, tracer.device, tracer.prepared)
    before = whole.temperature.sees_background
    draws = [DrawnPixels.of(before, seen, seed=seed) for seed in range(given.draws)]
    print("cells, mm          all, K   drawn: least, mean, most   below all")
    for coarse, fine in pairwise(given.halvings):
        two = whole.level(fine), whole.level(coarse)
        true_K = whole.difference(*two)[0].error_K or 0.0
        stated = []
        for drawn in draws:
            one, other = (image.map(drawn.pick) for image in two)
            temperature = whole.temperature.picked(drawn.sample.pixels)
            step, _ = ImageDifference.between(temperature, one, other, drawn)
            stated.append(step.error_K or 0.0)
        mm = [1e3 * tracer.prepared.cube.at(depth).cell_m for depth in (coarse, fine)]
        print(
            f"{mm[0]:7.3g} to {mm[1]:5.3g} {true_K:10.3f}   {min(stated):.3f}, "
            f"{np.mean(stated):.3f}, {max(stated):.3f}   {sum(one < true_K for one in stated)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
