"""Makes the converged pictures that `cldit bench --only budget` compares with.

Run by hand, minutes to hours a scene:

    python tests/bench/budget_reference.py --scene gdi --scene droplets-only --pixels 100

All that the plan chooses is much finer here: cells, the cone's lattice and classes, ordinates,
wavelengths. A computed spray is the mean over seeds of many parcels. A second picture with cells
and lattice twice as coarse says how far the reference itself is off; the effect of many classes of
size is taken from there.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.bench.budget_scenes import SCENES, Reference, budget_scene
from cldit.bench.case import changed
from cldit.caches import default_cache
from cldit.dit.accuracy import has_temperature
from cldit.gpu.device import Device, open_device
from cldit.medium.cloud import Kernel
from cldit.run import simulate
from cldit.run.spray_factory import make_spray
from cldit.scene import Scene
from cldit.spray.result import Cells, Parcels, Spray, Vapour


def finest(scene: Scene, given: argparse.Namespace, *, coarser: int, classes: int = 6) -> Scene:
    """The scene with every key fixed; `coarser`: 1, or 2 for the picture to compare with."""
    cone = scene.spray.model == "cone"
    # An even grid differs from its cells at its edges alone.
    leaf_m = given.leaf_edge_m * (5 if scene.spray.model == "grid" else 1)
    sections = {
        "domain": {}
        if cone
        else {"leaf_edge_m": leaf_m * coarser},  # a cone's lattice is its cells
        "transport": {"audit": False, "directions": given.directions, "accuracy_K": 0.1},
        "optics": {"spectral_error_K": 0.05 * coarser},
    }
    if cone:
        spacing_m = given.spacing_m * coarser
        sections["spray"] = {"spacing_m": spacing_m, "size_classes": classes}
    return changed(scene, **sections)


def mean_spray(scene: Scene, given: argparse.Namespace) -> Spray:
    """One spray of all seeds' parcels and gas, each with its share of the mass."""
    sprays = [
        make_spray(
            changed(
                scene,
                spray={"seed": seed, "droplets_per_parcel": given.droplets_per_parcel},
            ).spray,
            cache=default_cache(),
        )
        for seed in range(1, given.seeds + 1)
    ]
    share = 1.0 / len(sprays)
    parcels = [one.parcels for one in sprays if one.parcels is not None]
    gases = [one.vapour for one in sprays if one.vapour is not None]
    # Gas of several seeds in one place: number densities add up, each with its temperature.
    vapour = Vapour(
        cells=Cells(
            lower_m=np.concatenate([one.cells.lower_m for one in gases]),
            upper_m=np.concatenate([one.cells.upper_m for one in gases]),
        ),
        number_density_m3=share * np.concatenate([one.number_density_m3 for one in gases]),
        temperature_K=np.concatenate([one.temperature_K for one in gases]),
        molar_mass_kg_mol=gases[0].molar_mass_kg_mol,
    )
    joined = Parcels(
        position_m=np.concatenate([one.position_m for one in parcels]),
        diameter_m=np.concatenate([one.diameter_m for one in parcels]),
        droplets=share * np.concatenate([one.droplets for one in parcels]),
        temperature_K=np.concatenate([one.temperature_K for one in parcels]),
        density_kg_m3=np.concatenate([one.density_kg_m3 for one in parcels]),
    )
    spread = Kernel().spread(joined)
    return replace(sprays[0], parcels=spread, vapour=vapour)


def picture(scene: Scene, spray: Spray | None, device: Device) -> np.ndarray:
    """T_app (H, W), NaN where it does not count."""
    maps = simulate(scene, device=device, spray=spray, progress=print).maps
    return np.where(has_temperature(maps), maps.apparent_temperature_K.astype(float), np.nan)


def main() -> None:
    """Makes what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", action="append", choices=SCENES, required=True)
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--leaf-edge-m", type=float, default=0.2e-3)
    parser.add_argument("--spacing-m", type=float, default=0.2e-3)
    parser.add_argument("--directions", type=int, default=96)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--droplets-per-parcel", type=float, default=1e2)
    given = parser.parse_args()
    device = open_device()
    for name in given.scene:
        with tempfile.TemporaryDirectory() as folder:
            scene = budget_scene(name, pixels=given.pixels, folder=Path(folder))
            spray = mean_spray(scene, given) if scene.spray.model == "lagrangian" else None
            fine, coarse = (
                picture(finest(scene, given, coarser=coarser), spray, device) for coarser in (1, 2)
            )
            if scene.spray.model == "cone":  # many classes and fine cells together fill the memory
                many = picture(finest(scene, given, coarser=2, classes=24), None, device)
                fine, coarse = fine + (many - coarse), many
            step_K = float(np.sqrt(np.nanmean((fine - coarse) ** 2)))
            path = Reference(fine, step_K).save(name)
            print(f"{path}: differs by {step_K:.2g} K RMS from half as fine, its error at most")


if __name__ == "__main__":
    main()
