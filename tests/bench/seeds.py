"""What `source` costs and errs by on gdi over several seeds, for one may happen to be a good one.

Run by hand:

    python tests/bench/seeds.py --accuracy 0.06 0.05 --seeds 8

Every run makes the whole picture; each is compared with `path` in every 7th pixel and in every 5th.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from cldit.bench.case import Case, Lattice, changed
from cldit.bench.error import Truth
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.scene import load_scene

LATTICES = (Lattice((7, 7)), Lattice((5, 5)))


def main() -> None:
    """A row for each accuracy: means over the seeds, and root mean squares of their errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accuracy", type=float, nargs="+", default=[0.1, 0.06, 0.05])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--samples", type=int, default=16384, help="of the reference, a pixel")
    parser.add_argument("--phase", default="isotropic", choices=["isotropic", "mie"])
    given = parser.parse_args()
    scene = changed(load_scene("gdi"), transport={"phase": "mie", "method": "source"})
    case = Case.of(scene, open_device(None), cache=default_cache())
    parts = [case.seen(lattice.of(scene)) for lattice in LATTICES]
    truths = [Truth.of(part, samples=given.samples, phase=given.phase) for part in parts]
    case.run(case.settings(phase=given.phase, accuracy_K=1.0, audit=False))  # builds
    print(
        " asked  core-s  least  RMS K: "
        + "  ".join(f"every {lattice.every[0]}th" for lattice in LATTICES)
    )
    for accuracy in given.accuracy:
        settings = case.settings(phase=given.phase, accuracy_K=accuracy, audit=False)
        costs, errors = [], []
        for seed in range(given.seeds):
            result, cost = case.run(replace(settings, seed=settings.seed + seed))
            costs.append(cost.core_s)
            for lattice, part, truth in zip(LATTICES, parts, truths, strict=True):
                kelvin = part.temperature_K(lattice.pick(scene, result.weights))
                errors.append(truth.rms(kelvin, truth.temperature_K))
        square = np.mean(np.reshape(errors, (given.seeds, -1)) ** 2, axis=0)
        each = "  ".join(f"{root:9.4f}" for root in np.sqrt(square))
        print(f"{accuracy:6g} {np.mean(costs):7.2f} {min(costs):6.2f}         {each}", flush=True)


if __name__ == "__main__":
    main()
