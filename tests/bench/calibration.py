"""Probabilities of a run against its own recordings: uniform, as they should be.

python -m tests.bench calibration methane-jet --seeds 100
python -m tests.bench calibration gdi-cone --quick --seeds 30
python -m tests.bench calibration gdi-cone --quick --alone
python -m tests.bench calibration gdi-cone --wheel --seeds 12

Each recording is compared with its run, with another recording, and with runs whose walls are 20 K
warmer and of another order; `--alone` omits these runs. `--first` is the first seed. `--quick` is
for 40 x 32 pixels. `--wheel` is for campaigns of two filters of 24 x 24 pixels: equal ones, their
runs, and 10 % more mass.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from cldit.comparison import Difference, Shown, compare, difference, open_shown
from cldit.comparison.rivals import in_band
from cldit.run import simulate
from cldit.scene import Scene, load_scene
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}
TINY = {"camera.sensor.pixels": [40, 32], "camera.pixels": [40, 40]}
SMALL = {"camera.sensor.pixels": [24, 24], "camera.pixels": [24, 24], "transport.accuracy_K": 8.0}
LARGE_K, CLEAR = 0.3, 4.0  # of a single pixel, in kelvin and in standard errors


def main() -> None:
    """Traces a scene once, records it with many seeds, and prints a line for each region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi-cone")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--quick", action="store_true", help="40 x 32 pixels")
    parser.add_argument("--alone", action="store_true", help="no runs that differ")
    parser.add_argument("--wheel", action="store_true", help="two filters, with the extinction")
    given = parser.parse_args()
    if given.wheel:
        wheel(load_scene(given.scene).with_(**SMALL), given.seeds, given.first)
        return
    sensor = {**TINY, "transport.accuracy_K": 8.0} if given.quick else SENSOR
    scene = load_scene(given.scene).with_(**{"transport.accuracy_K": 4.0, **sensor})
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(scene, Path(folder) / "run")
        shown = open_shown(run)
        recorded = [recording(run, seed=given.first + n) for n in range(given.seeds)]
        found = [difference(shown, one) for one in recorded]
        for name in found[0].regions:
            tested = [one.regions[name] for one in found if one.regions[name].p_value is not None]
            if not tested:
                continue
            p = np.array([one.p_value for one in tested], float)
            chi2 = np.array([one.chi2_reduced for one in tested], float)
            print(
                f"{name:8} p < 0.05: {np.sum(p < 0.05)}, p < 0.01: {np.sum(p < 0.01)}, "
                f"reduced chi-square {chi2.mean():.3f} ± {chi2.std():.3f}"
            )
        pairs = zip(recorded[::2], recorded[1::2], strict=False)
        uniform("run", found)
        uniform("recordings", [difference(one, other) for one, other in pairs])
        walls_K = scene.walls.temperature_K
        for name, values in (
            (
                ("walls + 20 K", {"walls.temperature_K": walls_K + 20.0}),
                ("order 1", {"transport.order": 1}),
            )
            if not given.alone
            else ()
        ):
            other = simulate(scene.with_(**values), Path(folder) / name.replace(" ", "-"))
            each = difference(shown, other)
            apart = np.abs(each.change_K) > LARGE_K
            print(f"{name}: {np.sum(np.isfinite(each.residuals))} pixels, {np.sum(apart)} above "
                  f"{LARGE_K} K, of which the errors leave "
                  f"{np.sum(apart & (np.abs(each.residuals) > CLEAR))}")  # fmt: skip
            for one in recorded[:4]:
                print(*difference(one, other).verdict.lines, sep="\n    ")


def wheel(scene: Scene, seeds: int, first: int) -> None:
    """Prints how many campaigns of two filters differ, and by which filter."""
    scenes = {"fuel": scene, "droplets": in_band(scene, load_scene("gdi-extinction"))}
    mass_kg = scene.model_dump()["spray"]["injected_mass_kg"]
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            share: {
                name: simulate(
                    of_filter.with_(**{"spray.injected_mass_kg": share * mass_kg}),
                    Path(folder) / f"{name}-{share}",
                )
                for name, of_filter in scenes.items()
            }
            for share in (1.0, 1.1)
        }

        def campaigns(share: float, offset: int) -> list[dict[str, Shown]]:
            return [
                {
                    name: recording(run, seed=1000 * (first + offset + k) + number)
                    for number, (name, run) in enumerate(runs[share].items())
                }
                for k in range(seeds)
            ]

        one, other = campaigns(1.0, 0), campaigns(1.0, 100)
        for title, pairs in (
            ("equal campaigns", list(zip(one, other, strict=True))),
            ("their runs", [(runs[1.0], campaign) for campaign in (*one, *other)]),
            ("10 % more mass", list(zip(one, campaigns(1.1, 200), strict=True))),
        ):
            found = [compare(*pair, extinction=["droplets"]).results[0] for pair in pairs]
            named = {
                name: sum(not result.by_filter[name].within for result in found) for name in scenes
            }
            p = np.sort([result.p_value for result in found])
            print(f"{title}: {sum(not result.within for result in found)} of {len(found)} differ, "
                  f"by filter {named}; p {np.round(p, 3)}")  # fmt: skip


def uniform(name: str, found: Sequence[Difference]) -> None:
    """Prints how uniform p is (Kolmogorov and Smirnov)."""
    p = np.array([one.p_value for one in found], float)
    chance = kstest(p, "uniform").pvalue
    alarms = sum(not one.within for one in found)
    print(
        f"{name}: {alarms} of {len(found)} differ; p {p.mean():.2f} on average, uniform with a "
        f"probability of {chance:.2g}"
    )


if __name__ == "__main__":
    main()
