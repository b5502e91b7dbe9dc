"""Probabilities of a run against its own recordings: uniform, as they should be.

python -m tests.bench calibration methane-jet --seeds 100
python -m tests.bench calibration gdi-cone --quick --seeds 30
python -m tests.bench calibration gdi-cone --quick --alone
python -m tests.bench calibration gdi-cone --members 12 --seeds 20

Each recording is compared with its run, with another recording, and with runs whose walls are 20 K
warmer and of another order; `--alone` omits these runs. `--quick` is for 40 x 32 pixels.
With members, 2 N injections are traced; in each trial N of them, drawn at random, and their
recording, are compared with the mean of the others, and with the mean of N of a heavier spray.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from cldit.arrays import Ints
from cldit.comparison import Difference, Shown, difference, open_shown
from cldit.run import Run, open_run, simulate
from cldit.run.ensemble import ensemble_run, member_folder
from cldit.scene import Scene, load_scene
from tests.bench.named_changes import SCATTER
from tests.verify.recordings import recording

SENSOR = {"camera.sensor.pixels": [160, 128], "camera.pixels": [128, 128]}
TINY = {"camera.sensor.pixels": [40, 32], "camera.pixels": [40, 40]}
LARGE_K, CLEAR = 0.3, 4.0  # of a single pixel, in kelvin and in standard errors


def main() -> None:
    """Traces a scene once, records it with many seeds, and prints a line for each region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi-cone")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--members", type=int, default=1, help="injections that differ")
    parser.add_argument("--quick", action="store_true", help="40 x 32 pixels")
    parser.add_argument("--alone", action="store_true", help="no runs that differ")
    given = parser.parse_args()
    if given.members > 1:
        for name, found in of_members(
            given.scene, given.members, given.seeds, quick=given.quick
        ).items():
            p = np.array([one.p_value or 0.0 for one in found])
            print(f"{name:24} p < 0.05: {np.sum(p < 0.05)}, p < 0.01: {np.sum(p < 0.01)}")
        return
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


def of_members(name: str, count: int, trials: int, *, quick: bool) -> dict[str, list[Difference]]:
    """`count` injections, and recordings of them, against others, and those of more mass."""
    pixels = {"camera.sensor.pixels": [100, 100], "camera.pixels": [100, 100]}
    pixels = TINY if quick else pixels
    plan = {"plan.shots": 5, "plan.references": 5, "transport.accuracy_K": 8.0 if quick else 2.0}
    scene = load_scene(name).with_(**pixels, **plan, **SCATTER)
    pool, some = ({"spray.scatter.members": number} for number in (2 * count, count))
    heavier = {"spray.injected_mass_kg": 1.1 * scene.spray.injected_mass_kg}  # type: ignore[union-attr]
    kinds = ("injections", "recording")
    found: dict[str, list[Difference]] = {
        f"{kind}, {change}": [] for kind in kinds for change in ("nothing", "mass + 10 %")
    }
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
            firsts: tuple[Run | Shown, ...] = (one, recording(one, seed=trial))
            for kind, first in zip(kinds, firsts, strict=True):
                for change, second in (("nothing", rest), ("mass + 10 %", other)):
                    found[f"{kind}, {change}"].append(difference(first, second))
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
