"""Probabilities of a run against its own recordings: uniform, as they should be.

python -m tests.bench calibration methane-jet --seeds 100
python -m tests.bench calibration gdi-cone --quick --seeds 30
python -m tests.bench calibration gdi-cone --quick --alone

Each recording is compared with its run, with another recording, and with runs whose walls are 20 K
warmer and of another order; `--alone` omits these runs. `--quick` is for 40 x 32 pixels.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from cldit.comparison import Difference, difference, open_shown
from cldit.run import simulate
from cldit.scene import load_scene
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}
TINY = {"camera.sensor.pixels": [40, 32], "camera.pixels": [40, 40]}
LARGE_K, CLEAR = 0.3, 4.0  # of a single pixel, in kelvin and in standard errors


def main() -> None:
    """Traces a scene once, records it with many seeds, and prints a line for each region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi-cone")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--quick", action="store_true", help="40 x 32 pixels")
    parser.add_argument("--alone", action="store_true", help="no runs that differ")
    given = parser.parse_args()
    sensor = {**TINY, "transport.accuracy_K": 8.0} if given.quick else SENSOR
    scene = load_scene(given.scene).with_(**{"transport.accuracy_K": 4.0, **sensor})
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(scene, Path(folder) / "run")
        shown = open_shown(run)
        recorded = [recording(run, seed=seed) for seed in range(given.seeds)]
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
