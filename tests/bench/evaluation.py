"""Time and memory of an evaluation of many full frames.

python -m tests.bench evaluation --shots 1000
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.dit.recorded import Evaluation, evaluate_shots
from cldit.io.images import write_image
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from tests.verify.evaluation_bias import (
    BACKGROUNDS_K,
    BARE,
    CAMERA,
    FILTER_UM,
)


@dataclass(frozen=True)
class EvaluationBench:
    """Cost of an evaluation. read_s: part of `seconds` for reading files. cpu_s: of all threads.
    peak_bytes: largest resident set of the process; grown_bytes: its growth since the start."""

    shots: int
    seconds: float
    cpu_s: float
    read_s: float
    peak_bytes: int
    grown_bytes: int
    evaluation: Evaluation


@dataclass(frozen=True)
class _Shot:
    id: str
    kind: str
    background_setpoint_K: float
    background_K: float
    path: Path


@dataclass
class _Folder:
    shots: list[_Shot]
    calibration: dict[str, Any] = field(default_factory=CAMERA.to_dict)
    surroundings: Surroundings = BARE
    bad_pixels: None = None
    read_s: float = 0.0

    def load(self, shot: _Shot) -> NDArray[Any]:
        begin = time.perf_counter()
        image = np.asarray(tifffile.imread(shot.path))
        self.read_s += time.perf_counter() - begin
        return image


def peak_bytes() -> int:
    """Largest resident set of this process so far; 0 where the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def bench_evaluation(
    folder: Path, *, shots: int = 1000, sensor: tuple[int, int] = (640, 512)
) -> EvaluationBench:
    """Evaluates `shots` TIFFs in `folder`, half of them references, of five backgrounds.

    Ten different images of each kind are written and read repeatedly, partly from the disk's cache.
    """
    columns, rows = sensor
    rng = np.random.default_rng(3)
    through = np.exp(-np.linspace(0.0, 3.0, columns))[None, :] * np.ones((rows, 1))
    own = float(band_radiance(430.0, filter_um=FILTER_UM))
    wanted = max(shots // (2 * len(BACKGROUNDS_K)), 1)
    found: list[_Shot] = []
    for background_K in BACKGROUNDS_K:
        light = float(band_radiance(background_K, filter_um=FILTER_UM))
        for kind in ("reference", "injection"):
            seen = np.full((rows, columns), light)
            if kind == "injection":
                seen = through * seen + (1.0 - through) * own
            counts = CAMERA.counts(seen)
            deviation = np.sqrt(CAMERA.variance_counts2(counts))
            for number in range(min(10, wanted)):
                noisy = counts + deviation * rng.standard_normal(counts.shape)
                path = folder / f"{background_K:g}_{kind}_{number}.tif"
                write_image(path, np.rint(noisy).astype(np.uint16), name=kind, unit="counts")
            found += [
                _Shot(
                    f"{background_K:g}-{kind}-{number}",
                    kind,
                    background_K,
                    background_K,
                    folder / f"{background_K:g}_{kind}_{number % 10}.tif",
                )
                for number in range(wanted)
            ]
    before = peak_bytes()
    recorded = _Folder(found)
    begin, cpu = time.perf_counter(), time.process_time()
    evaluation = evaluate_shots(recorded, accept=["repeats"])
    seconds = time.perf_counter() - begin
    cpu_s = time.process_time() - cpu
    peak = peak_bytes()
    return EvaluationBench(
        len(found), seconds, cpu_s, recorded.read_s, peak, peak - before, evaluation
    )


def main() -> None:
    """Prints time and memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=int, default=1000)
    parser.add_argument("--folder", help="of the images, which are removed")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder, prefix="cldit-bench-") as place:
        found = bench_evaluation(Path(place), shots=given.shots)
    print(
        f"{found.shots} shots of 640 x 512 in {found.seconds:.1f} s ({found.cpu_s:.1f} s of CPU, "
        f"{found.read_s:.1f} s to read them); {found.peak_bytes / 2**20:.0f} MiB at most, "
        f"{found.grown_bytes / 2**20:.0f} MiB more than before"
    )
