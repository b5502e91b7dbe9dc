"""True and stated errors of a run of an imported spray.

    python -m tests.bench imported_errors --aachenbomb CASE

Some minutes; CASE is an OpenFOAM case of the tutorial aachenBomb. **Parcels**: parts of the parcels
are sprays of fewer. The difference between images of parts without common parcels is sqrt(2) times
the error of one; the error that each part states by its own halves is printed with it. **All else**
is compared with a trace on cells of a quarter (or `--finer 1`, if memory is short), with 16 rays
per pixel.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import changed
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.medium.cloud import SAMPLING, Kernel, variants
from cldit.prepare.spray_factory import make_spray
from cldit.run import Run, simulate
from cldit.scene import Scene, parse_scene
from cldit.spray.result import Parcels, Spray
from tests.bench.wavelengths import imported

Floats = NDArray[np.float64]

_OF_WIDTH = 4.0 / 3.0  # as in cldit.accuracy.sources.parcels
_ORDINATES = 32


@dataclass(frozen=True)
class Sampled:
    """Sprays of so many parcels: errors of T_app, K, RMS over the parts.

    stated_K, width_K: by sampling and by the width, as a part states them. true_K: by sampling, as
    parts that share no parcel show it. wider_K: what the parts' width does, against all parcels,
    whose own width hides some.
    """

    parcels: int
    stated_K: float
    true_K: float
    width_K: float
    wider_K: float


@dataclass(frozen=True)
class Told:
    """A cause but for parcels, K: as the run states it, and against the finer trace."""

    name: str
    stated_K: float
    true_K: float


def scene_of(case: Path, *, pixels: int, asked_K: float = 1.0) -> Scene:
    """The imported spray, its keys left to the plan for this error of the picture."""
    data = imported(case)
    data["camera"] = {**data["camera"], "pixels": [pixels, pixels]}
    data["optics"] = {"compare_paper": False}
    data["transport"] = {"accuracy_K": asked_K}
    return parse_scene(data)


def temperature_K(run: Run) -> Floats:
    """T_app (H, W), NaN where it does not count."""
    maps = run.maps
    return np.where(maps.has_temperature, maps.apparent_temperature_K.astype(float), np.nan)


def apart_K(one: Floats, other: Floats) -> float:
    """RMS over the pixels that count in both."""
    return float(np.sqrt(np.nanmean((one - other) ** 2)))


def parts_of(parcels: Parcels, count: int, *, seed: int = 7) -> list[Parcels]:
    """Parts that share no parcel, drawn at random, each with the liquid of all."""
    number = np.random.default_rng(seed).permutation(len(parcels.droplets)) % count
    parts = [parcels.take(number == one) for one in range(count)]
    whole = parcels.mass_kg
    return [replace(one, droplets=one.droplets * (whole / one.mass_kg)) for one in parts]


def sampled(
    scene: Scene, spray: Spray, device: Device, *, leaf_m: float, counts: Sequence[int]
) -> list[Sampled]:
    """True and stated errors of parts of the parcels."""
    coarse = changed(
        scene,
        domain={"leaf_edge_m": leaf_m},
        transport={"audit": False, "accuracy_K": 0.3, "directions": 48},
    )

    def picture(parcels: Parcels) -> Floats:
        clouds = replace(spray, parcels=Kernel().spread(parcels))
        return temperature_K(simulate(coarse, device=device, spray=clouds))

    assert spray.parcels is not None
    whole, out = picture(spray.parcels), []
    for count in counts:
        parts = parts_of(spray.parcels, count)
        pictures = [picture(part) for part in parts]
        stated, widths = [], []
        for part, own in zip(parts, pictures, strict=True):
            found = variants(replace(spray, parcels=part), kernel=Kernel(), seed=1)
            one, other, narrow = (
                temperature_K(simulate(coarse, device=device, spray=each))
                for each in (*found.halves, found.narrower)
            )
            stated.append(SAMPLING * apart_K(one, other))
            widths.append(_OF_WIDTH * apart_K(own, narrow))
        true_K = _rms([apart_K(one, other) for one, other in combinations(pictures, 2)]) / 2**0.5
        # A part is one count-th of all: so much of its chance is in all parcels as well.
        whole_K = _rms([apart_K(one, whole) for one in pictures])
        wider_K2 = whole_K**2 - (1 - 1 / count) * true_K**2
        out.append(
            Sampled(
                parcels=len(parts[0].droplets),
                stated_K=_rms(stated),
                true_K=true_K,
                width_K=_rms(widths),
                wider_K=max(wider_K2, 0.0) ** 0.5,
            )
        )
    return out


def told(run: Run, spray: Spray, device: Device, *, finer: float) -> list[Told]:
    """The other causes, one by one and together, of a run of `spray`."""
    assert run.errors is not None and run.info.plan is not None
    stated = {cause.name: cause.error_K or 0.0 for cause in run.errors.causes}
    cell_m = run.scene.domain.edge_m / 2 ** run.info.plan["depth"]
    here = temperature_K(run)

    def against(cells_m: float, rays: int) -> float:
        true = changed(
            run.scene,
            domain={"leaf_edge_m": cells_m * (1 + 1e-6)},  # or rounding halves it once more
            camera={"rays_per_pixel": rays},
            transport={"audit": False, "directions": _ORDINATES, "accuracy_K": 0.3},
        )
        return apart_K(temperature_K(simulate(true, device=device, spray=spray)), here)

    others = [error for name, error in stated.items() if name not in ("parcels", "deposit width")]
    together = float(np.sqrt(np.sum(np.square(others))))
    return [
        Told("all but parcels", together, against(cell_m / finer, 16)),
        Told("pixel sampling", stated["pixel sampling"], against(cell_m, 16)),
    ]


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Prints both comparisons."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--aachenbomb", type=Path, required=True, metavar="CASE")
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--accuracy-K", type=float, default=8.0, help="asked of the run")
    parser.add_argument("--finer", type=float, default=4.0, help="times, of true cells")
    parser.add_argument("--leaf-edge-m", type=float, default=0.5e-3, help="for parts of parcels")
    parser.add_argument("--parts", type=int, nargs="+", default=[2, 4, 8])
    given = parser.parse_args()
    device = open_device()
    scene = scene_of(given.aachenbomb, pixels=given.pixels, asked_K=given.accuracy_K)
    spray = make_spray(scene.spray, cache=default_cache())
    run = simulate(scene, device=device, spray=spray)
    assert run.errors is not None and spray.parcels is not None
    print(f"{len(spray.parcels.droplets)} parcels; stated {run.errors.text}")
    for cause in run.errors.causes:
        print(f"  {cause.name}: {cause.text} ({cause.how})")
    for one in told(run, spray, device, finer=given.finer):
        ratio = one.stated_K / one.true_K
        print(f"{one.name}: stated {one.stated_K:.2f}, true {one.true_K:.2f} K, {ratio:.2f}")
    print("parcels  stated  true   width  true, at least", flush=True)
    for row in sampled(scene, spray, device, leaf_m=given.leaf_edge_m, counts=given.parts):
        print(
            f"{row.parcels:7d} {row.stated_K:7.2f} {row.true_K:5.2f} {row.width_K:7.2f} "
            f"{row.wider_K:6.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
