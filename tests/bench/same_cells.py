"""T_app of `source` minus that of `path` on the same cells, mean and RMS.

    python -m tests.bench same_cells gdi-cone --field 0.12 --z -0.05
    python -m tests.bench same_cells droplets-only --field 0.05 --z -0.02 --constant [--sharp]

The noise of the reference is removed from the RMS, and printed with the mean.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from cldit.bench.case import changed
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.scene import load_scene
from cldit.transport.trace import TraceSettings
from tests.bench.case import Case
from tests.bench.error import Truth


class Even(Case):
    """A case whose coefficients are constant in cells, for all methods."""

    def settings(self, **transport: Any) -> TraceSettings:
        """As in `Case`."""
        return replace(super().settings(**transport), linear_coefficients=False)


def main() -> None:
    """A row for each seed of `source`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--leaf", type=float, default=0.8e-3, help="edge of the cells, m")
    parser.add_argument("--pixels", type=int, default=56)
    parser.add_argument("--field", type=float, default=0.12, help="edge of the picture, m")
    parser.add_argument("--z", type=float, default=-0.05, help="of its middle, m")
    parser.add_argument("--samples", type=int, default=1024, help="of the reference, a pixel")
    parser.add_argument("--accuracy", type=float, default=0.1)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--phase", default="mie", choices=["isotropic", "mie"])
    parser.add_argument("--constant", action="store_true", help="coefficients even in cells")
    parser.add_argument("--sharp", action="store_true", help="no forward peak blurs the boundary")
    parser.add_argument("--radius", type=float, help="of the background, m; left out: the scene's")
    parser.add_argument("--directions", type=int, help="left out: by the accuracy")
    given = parser.parse_args()
    scene = changed(
        load_scene(given.scene),
        transport={"phase": given.phase, "method": "source", "directions": given.directions},
        background={} if given.radius is None else {"radius_m": given.radius},
        domain={"leaf_edge_m": given.leaf},
        camera={
            "pixels": [given.pixels] * 2,
            "field_m": [given.field] * 2,
            "target_m": [0.0, 0.0, given.z],
        },
    )
    case = Case.of(scene, open_device(None), cache=default_cache())
    if given.constant:
        case = Even(case.scene, case.device, case.medium)
    truth = Truth.of(case, samples=given.samples, phase=given.phase)
    settings = case.settings(phase=given.phase, accuracy_K=given.accuracy, audit=False)
    tuning = replace(settings.tuning, blurred_boundary=not given.sharp)
    settings = replace(settings, tuning=tuning)
    one, other = truth.temperature_K
    noise_K = truth.noise_K / np.sqrt(np.count_nonzero(truth.visible))
    print(f"reference: mean good to {noise_K:.3f} K\n seed   mean K    RMS K  core-s")
    for seed in range(given.seeds):
        result, cost = case.run(replace(settings, seed=1 + seed))
        kelvin = case.temperature_K(result.weights)
        mean = float(np.mean((kelvin - (one + other) / 2)[truth.visible]))
        rms = truth.rms(kelvin)
        print(f"{1 + seed:5d} {mean:+8.3f} {rms:8.3f} {cost.core_s:7.2f}", flush=True)


if __name__ == "__main__":
    main()
