"""Converged reference images of `cldit bench --only budget`; minutes to hours a scene.

    python -m tests.bench budget_reference --scene gdi-cone --scene droplets-only --pixels 100

All that a run chooses is much finer here: cells, lattice and size classes of the cone, ordinates,
wavelengths. A computed spray with droplets is the mean over many seeds, on the gas grid of the
scene, whose error is excluded. A second image with cells and lattice twice as coarse gives the
error of the reference; the effect of many size classes is added from there. The difference between
the images of two halves of the seeds gives the noise of a computed spray.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.bench import BUDGET_SCENES
from cldit.bench.budget_scenes import FOLDER, STEP_K, Reference, budget_scene
from cldit.bench.case import BenchError, changed
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.medium.cloud import Kernel
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.spray_factory import make_spray
from cldit.run import simulate
from cldit.scene import Scene
from cldit.scene.spray import LagrangianSpray
from cldit.spray.flow.sampled import SPACING_m
from cldit.spray.result import Cells, Parcels, Spray, Vapour

_FIRST_SEED = 11  # of a reference: those of the runs are smaller
_FAINT = 0.5  # of the least emissivity with a T_app


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
        "camera": {"rays_per_pixel": 64},
    }
    if scene.spray.model == "lagrangian":  # a cube whose cells do not lie across those of the gas
        cell_m = 2 * SPACING_m
        leaf_m = cell_m / 4 * coarser * (1 + 1e-6)  # or rounding halves it once more
        sections["domain"] = {"edge_m": 128 * cell_m, "leaf_edge_m": leaf_m}
        sections["background"] = {"centre_m": scene.background_centre_m}
    if cone:
        spacing_m = given.spacing_m * coarser
        sections["spray"] = {"spacing_m": spacing_m, "size_classes": classes}
    return changed(scene, **sections)


def mean_spray(scene: Scene, given: argparse.Namespace, seeds: Sequence[int]) -> Spray:
    """One spray of these seeds' parcels and gas, each with its share of the mass."""
    sprays = [
        make_spray(
            changed(
                scene,
                spray={"seed": seed, "droplets_per_parcel": given.droplets_per_parcel},
            ).spray,
            open_device(),
            cache=default_cache(),
        )
        for seed in seeds
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


def save(reference: Reference, name: str, folder: Path = FOLDER) -> Path:
    """Writes NAME-PIXELS.npz, of 0.01 K in 16 bits, and returns its path.

    Raises:
        BenchError: a temperature is too high for 16 bits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-{len(reference.temperature_K)}.npz"
    known = np.isfinite(reference.temperature_K)
    steps = np.where(known, np.round(np.nan_to_num(reference.temperature_K) / STEP_K), 0)
    if steps.max() > np.iinfo(np.uint16).max:
        raise BenchError(f"{name}: {steps.max() * STEP_K:.4g} K; at most 655 K are stored")
    np.savez_compressed(path, steps=steps.astype(np.uint16), error_K=reference.error_K)
    return path


def picture(scene: Scene, spray: Spray | None, device: Device) -> np.ndarray:
    """T_app (H, W), NaN where no run may have one: pixels may be less faint on larger cells."""
    maps = simulate(scene, device=device, spray=spray, progress=print).maps
    seen = maps.emissivity > _FAINT * VISIBLE_EMISSIVITY
    return np.where(seen, maps.apparent_temperature_K.astype(float), np.nan)


def by_chance_K(scene: Scene, given: argparse.Namespace, device: Device) -> float:
    """RMS error of the mean over seeds: half of the difference of the means over half of them."""
    seeds = seeds_of(given)
    one, other = (
        picture(scene, mean_spray(scene, given, seeds[first::2]), device) for first in (0, 1)
    )
    return float(np.sqrt(np.nanmean((one - other) ** 2))) / 2


def seeds_of(given: argparse.Namespace) -> range:
    """Seeds of a computed spray."""
    return range(_FIRST_SEED, _FIRST_SEED + given.seeds)


def main() -> None:
    """Makes what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", action="append", choices=BUDGET_SCENES, required=True)
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--leaf-edge-m", type=float, default=0.2e-3)
    parser.add_argument("--spacing-m", type=float, default=0.2e-3)
    parser.add_argument("--directions", type=int, default=96)
    parser.add_argument("--seeds", type=int, default=7)
    parser.add_argument("--droplets-per-parcel", type=float, default=1500.0)
    given = parser.parse_args()
    device = open_device()
    for name in given.scene:
        with tempfile.TemporaryDirectory() as folder:
            # The parcels of many draws of an imported case stand for its smooth profiles.
            draws = given.seeds if name == "imported" else 1
            scene = budget_scene(
                name, pixels=given.pixels, folder=Path(folder), seed=_FIRST_SEED, draws=draws
            )
            spec = scene.spray
            computed = isinstance(spec, LagrangianSpray) and spec.droplets is not None
            spray = mean_spray(scene, given, seeds_of(given)) if computed else None
            fine, coarse = (
                picture(finest(scene, given, coarser=coarser), spray, device) for coarser in (1, 2)
            )
            if scene.spray.model == "cone":  # many classes and fine cells together fill the memory
                many = picture(finest(scene, given, coarser=2, classes=24), None, device)
                fine, coarse = fine + (many - coarse), many
            step_K = float(np.sqrt(np.nanmean((fine - coarse) ** 2)))
            print(f"{name}: differs by {step_K:.2g} K RMS from half as fine, its error at most")
            chance_K = 0.0
            if computed:
                chance_K = by_chance_K(finest(scene, given, coarser=2), given, device)
                print(f"{name}: {chance_K:.2g} K RMS by chance, of {given.seeds} seeds")
            path = save(Reference(fine, float(np.hypot(step_K, chance_K))), name)
            print(f"{path}: written")


if __name__ == "__main__":
    main()
