"""Whether steps that are measured in drawn pixels are those of the picture, over many draws.

Run by hand:

    python -m tests.bench.drawn_pixels --scene methane-jet --halvings 6 7 8
    python -m tests.bench.drawn_pixels --scene gdi --halvings 7 8 9

The pictures are the same, all pixels of them traced: the draw alone makes the difference.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from cldit.accuracy.attempt import Attempts
from cldit.accuracy.drawn_pixels import DrawnPixels
from cldit.accuracy.picture import Step
from cldit.accuracy.pilot import Pilot, looked, temperature_of
from cldit.accuracy.plan import Plan
from cldit.bench.case import changed
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene


class _Made(Exception):
    """Holds the pilot of a run that goes no further."""


class _UpToPilot(Attempts):
    def _settled(self, plan: Plan, pilot: Pilot) -> Plan:
        raise _Made(pilot)


def pilot_of(scene: Scene) -> Pilot:
    """The pilot of a scene's first attempt."""
    attempts = _UpToPilot(scene, open_device(), Stages(None), default_cache(), None)
    try:
        attempts._made(Plan.first(scene))
    except _Made as made:
        found: Pilot = made.args[0]
        return found
    raise AssertionError("the scene's cells are not left to choice")


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
    pilot = pilot_of(scene)
    whole = replace(
        pilot, drawn=None, temperature=temperature_of(pilot.scene, pilot.probed), kept={}
    )
    whole = replace(whole, settings=replace(whole.settings, subpixels=False))
    seen = looked(pilot.scene, pilot.device, pilot.settings, pilot.probed)
    before = whole.temperature.before_background
    draws = [DrawnPixels.of(before, seen, seed=seed) for seed in range(given.draws)]
    print("cells, mm          all, K   drawn: least, mean, most   below all")
    for coarse, fine in pairwise(given.halvings):
        two = whole.level(fine), whole.level(coarse)
        true_K = whole.step(*two).error_K or 0.0
        stated = []
        for drawn in draws:
            one, other = (picture.map(drawn.pick) for picture in two)
            temperature = whole.temperature.picked(drawn.sample.pixels)
            stated.append(Step.between(temperature, one, other, drawn).error_K or 0.0)
        mm = [1e3 * pilot.probed.frame.at(depth).cell_m for depth in (coarse, fine)]
        print(
            f"{mm[0]:7.3g} to {mm[1]:5.3g} {true_K:10.3f}   {min(stated):.3f}, "
            f"{np.mean(stated):.3f}, {max(stated):.3f}   {sum(one < true_K for one in stated)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
