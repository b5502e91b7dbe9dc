"""`source` against `path` on `gdi`, whose noise is taken off: `python tests/bench/against_path.py`.

Spectral sizes at one wavelength. Errors are RMS of T_app over pixels of emissivity above 0.05. CPU
seconds are of the whole run, spray and optics included (the first also makes tables).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import cldit
from cldit.dit.accuracy import VISIBLE_EMISSIVITY
from cldit.run import Run

WAYS: tuple[dict[str, Any], ...] = (
    {"accuracy_K": 1.0},
    {"accuracy_K": 0.3, "gather": False},
    {"accuracy_K": 0.3},
    {"accuracy_K": 0.1},
)


def main() -> None:
    """Prints a row for each way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=int, default=250)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--phases", nargs="+", default=["isotropic", "mie"])
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:

        def run(**transport: Any) -> tuple[Run, float]:
            data = cldit.load_scene("gdi").model_dump(mode="json")
            data["camera"]["pixels"] = [chosen.pixels] * 2
            data["optics"].update(preset="spectral", wavelengths=1, compare_paper=False)
            data["transport"].update(transport)
            start = time.process_time()
            done = cldit.simulate(cldit.parse_scene(data), cache=Path(folder))
            return done, time.process_time() - start

        print("phase      way                                    RMS K  stated K  largest K  CPU s")
        for phase in chosen.phases:
            sampled = {"method": "path", "accuracy_K": 1e-3, "max_samples": chosen.samples}
            truth, cost = run(phase=phase, seed=7, **sampled)
            noise = truth.info.accuracy_K or 0.0
            noise /= 1.3  # the run adds that for what two halves share; samples share nothing
            print(f"{phase:10} {'path':38} noise {noise:.3f} {cost:22.1f}", flush=True)
            for way in WAYS:
                got, cost = run(phase=phase, **way)
                kelvin = got.maps.apparent_temperature_K - truth.maps.apparent_temperature_K
                seen = (truth.maps.emissivity > VISIBLE_EMISSIVITY) & np.isfinite(kelvin)
                square = float(np.mean(kelvin[seen].astype(float) ** 2)) - noise**2
                print(
                    f"{phase:10} {way!s:38} {max(square, 0.0) ** 0.5:.3f} "
                    f"{got.info.accuracy_K or np.nan:9.3f} {np.abs(kelvin[seen]).max():10.2f} "
                    f"{cost:6.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
