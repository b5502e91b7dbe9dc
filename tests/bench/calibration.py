"""Probabilities of a run against its own recordings: as often small as they should be.

python -m tests.bench calibration methane-jet --seeds 100
python -m tests.bench calibration gdi-cone --members 12 --seeds 20

With members, 2 N injections are traced; in each trial N of them, drawn at random, are recorded, and
compared with the mean of the others, and with the mean of N of a heavier spray.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from cldit.arrays import Ints
from cldit.comparison import Difference, difference, open_shown
from cldit.run import Run, open_run, simulate
from cldit.run.ensemble import ensemble_run, member_folder
from cldit.scene import Scene, load_scene
from tests.bench.named_changes import SCATTER
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}


def main() -> None:
    """Traces a scene once, records it with many seeds, and prints a line for each region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi-cone")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--members", type=int, default=1, help="injections that differ")
    given = parser.parse_args()
    if given.members > 1:
        for name, found in of_members(given.scene, given.members, given.seeds).items():
            p = np.array([one.p_value or 0.0 for one in found])
            print(f"{name:12} p < 0.05: {np.sum(p < 0.05)}, p < 0.01: {np.sum(p < 0.01)}")
        return
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


def of_members(name: str, count: int, trials: int) -> dict[str, list[Difference]]:
    """Recordings of `count` injections against as many others, and against those of more mass."""
    pixels = {"camera.sensor.pixels": [100, 100], "camera.pixels": [100, 100]}
    plan = {"plan.shots": 5, "plan.references": 5, "transport.accuracy_K": 2.0}
    scene = load_scene(name).with_(**pixels, **plan, **SCATTER)
    pool, some = ({"spray.scatter.members": number} for number in (2 * count, count))
    heavier = {"spray.injected_mass_kg": 1.1 * scene.spray.injected_mass_kg}  # type: ignore[union-attr]
    found: dict[str, list[Difference]] = {"nothing": [], "mass + 10 %": []}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        simulate(scene.with_(**pool), out / "pool")
        seed = {"spray.scatter.seed": 2}
        other = simulate(scene.with_(**some, **seed, **heavier), out / "heavier")
        rng = np.random.default_rng(1)
        for trial in range(trials):
            drawn = 1 + rng.permutation(2 * count)
            one, rest = (
                part_of(out / "pool", scene.with_(**some, **more), chosen, out / f"{trial}-{place}")
                for place, (chosen, more) in enumerate(((drawn[:count], {}), (drawn[count:], seed)))
            )
            recorded = recording(one, seed=trial)
            found["nothing"].append(difference(recorded, rest, resample=True))
            found["mass + 10 %"].append(difference(recorded, other, resample=True))
    return found


def part_of(pool: Path, scene: Scene, chosen: Ints, folder: Path) -> Run:
    """The run of some of the injections in `pool`, in a folder of its own."""
    (folder / "members").mkdir(parents=True)
    for number, member in enumerate(chosen, start=1):
        member_folder(folder, number).symlink_to(member_folder(pool, int(member)))
    for name in ("weights", "weights_reference"):
        (folder / name).symlink_to(pool / name)
    nominal = open_run(pool / "nominal")

    def stored(_: Scene, place: Path | None, like: Run | None) -> Run:
        return nominal if like is None else open_run(place or folder)

    return ensemble_run(scene, folder, None, trace=stored)


if __name__ == "__main__":
    main()
