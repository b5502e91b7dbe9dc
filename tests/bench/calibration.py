"""Probabilities of a run against its own recordings: as often small as they should be.

python -m tests.bench calibration methane-jet --seeds 100
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from cldit.comparison import difference, open_shown
from cldit.run import simulate
from cldit.scene import load_scene
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}


def main() -> None:
    """Traces a scene once, records it with many seeds, and prints a line for each region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi")
    parser.add_argument("--seeds", type=int, default=100)
    given = parser.parse_args()
    scene = load_scene(given.scene).with_(**SENSOR, **{"transport.accuracy_K": 4.0})
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(scene, Path(folder) / "run")
        shown = open_shown(run)
        found = [
            difference(shown, recording(run, seed=seed), resample=True)
            for seed in range(given.seeds)
        ]
    for name in found[0].regions:
        p = np.array([one.regions[name].p_value or 0.0 for one in found])
        chi2 = np.array([one.regions[name].chi2_reduced or np.nan for one in found])
        print(
            f"{name:8} p < 0.05: {np.sum(p < 0.05)}, p < 0.01: {np.sum(p < 0.01)}, "
            f"reduced chi-square {np.nanmean(chi2):.3f} ± {np.nanstd(chi2):.3f}"
        )
    alarms = sum(not one.within for one in found)
    print(f"{alarms} of {len(found)} differ, with all regions together")


if __name__ == "__main__":
    main()
