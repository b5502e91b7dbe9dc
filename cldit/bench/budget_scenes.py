"""Scenes of `budget` and their reference images."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.io.files import write_text
from cldit.scene import Scene, load_scene, parse_scene

FOLDER = Path(__file__).parent / "references"
_FIELD = {"field_m": [0.16, 0.16], "target_m": None}  # that of the stored references
_GAS_m = 0.64e-3  # gas of a computed spray, as a run chooses it for 4 K: its reference has it too
STEP_K = 0.01  # of stored temperatures, in 16 bits


def budget_scene(name: str, *, pixels: int, folder: Path, seed: int = 1, draws: int = 1) -> Scene:
    """Scene of `BUDGET_SCENES` with free resolution, `pixels` along an edge; files in `folder`.

    `seed` is of the trace, of a computed spray, and of the parcels of the imported case, which has
    `draws` times as many.
    """
    camera: dict[str, Any] = {"pixels": [pixels, pixels]}
    transport = {"seed": seed}
    if name.endswith("-grid"):
        camera["target_m"] = [0.0, 0.0, 0.0]
        return parse_scene({**_grid(name, folder), "camera": camera, "transport": transport})
    if name == "imported":
        data = _imported(folder / f"case-{seed}-{draws}", seed, draws)
        camera |= {"field_m": [0.03, 0.05], "target_m": [0.0, 0.0, -0.024]}
        return parse_scene({**data, "camera": camera, "transport": transport})
    scene = load_scene(name).model_dump(mode="json")
    scene["camera"].update(_FIELD, **camera)
    scene["transport"].update(transport)
    scene["optics"]["compare_paper"] = False
    if name == "droplets-only":
        scene["optics"]["preset"] = "spectral"
    if scene["spray"]["model"] == "lagrangian":
        scene["spray"]["seed"] = seed
        scene["spray"]["box"]["spacing_m"] = scene["spray"]["box"]["spacing_m"] or _GAS_m
    return parse_scene(scene)


_PARCELS, _LIQUID_kg, _VOXEL_m = 20_000, 1.0e-6, 1e-3  # of the imported case


def _imported(folder: Path, seed: int, draws: int) -> dict[str, Any]:
    """A plume as tables of CFD: parcels drawn from smooth profiles, vapour on cells of 1 mm.

    The half-width grows by 0.12 of the depth; droplets of 10 um on average evaporate outwards.
    """
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(seed)
    count = _PARCELS * draws
    depth_m = 0.004 + 0.03 * rng.beta(1.5, 2.5, count)
    width_m = 0.5e-3 + 0.12 * depth_m
    across_m = width_m[:, None] * rng.normal(size=(count, 2)).clip(-2.5, 2.5)
    diameter_m = 1e-5 * rng.weibull(2.5, count).clip(0.2, 2.0)
    volume_m3 = np.pi / 6 * diameter_m**3
    number = _LIQUID_kg / count / (600.0 * volume_m3)
    warm_K = 360.0 + 20.0 * np.minimum(np.hypot(*across_m.T) / width_m, 2.0)
    parcels = np.column_stack([across_m, -depth_m, diameter_m, number, warm_K])
    _table(folder / "parcels.csv", ("x", "y", "z", "d", "n", "T"), parcels)
    edges = [np.arange(-0.013, 0.013, _VOXEL_m) + _VOXEL_m / 2] * 2
    x, y, z = (axis.ravel() for axis in np.meshgrid(*edges, np.arange(-0.048, 0.0, _VOXEL_m)))
    z = z + _VOXEL_m / 2
    r2 = (x**2 + y**2) / (0.5e-3 - 0.14 * z) ** 2
    fuel = 0.12 * np.exp(-r2 / 2 - (z + 0.02) ** 2 / (2 * 0.01**2))
    fuel = np.where(fuel > 1e-3, fuel, 0.0)
    even = np.ones(len(x))
    cells = [x, y, z, 560.0 - 900.0 * fuel, fuel, 3.6 * even, _VOXEL_m**3 * even]
    _table(folder / "cells.csv", ("x", "y", "z", "T", "Y", "rho", "V"), np.column_stack(cells))
    write_text(folder / "case.yaml", _MAPPING)
    spray = {
        "model": "cfd",
        "file": str(folder / "case.yaml"),
        "fuel_field": "Y",
        "fuel_molar_mass_kg_mol": 0.1002,
        "nozzle_m": [0.0, 0.0, 0.0],
        "axis": "-z",
    }
    return {
        "name": "imported",
        "spray": spray,
        "domain": {"edge_m": 0.064, "centre_m": [0.0, 0.0, -0.03]},
        "background": {"radius_m": 0.04, "temperatures_K": [413.0, 473.0, 533.0]},
        "walls": {"temperature_K": 450.0},
        "optics": {"compare_paper": False},
    }


_MAPPING = """time_s: 0.001
cells:
  file: cells.csv
  position: [x, y, z]
  volume: V
  temperature: T
  density: rho
  fuel: Y
parcels:
  file: parcels.csv
  position: [x, y, z]
  diameter: d
  number: n
  temperature: T
  density: 600
"""


def _table(path: Path, head: tuple[str, ...], rows: Floats) -> None:
    lines = (",".join(f"{value:.7g}" for value in row) for row in rows)
    write_text(path, "\n".join([",".join(head), *lines, ""]))


def _grid(name: str, folder: Path) -> dict[str, Any]:
    """24^3 absorbing and scattering voxels in front of a hot disc, uniform or with random depth, of
    0.02 to 0.5, and albedo."""
    edge, voxels = 0.12, 24
    shape = (voxels,) * 3
    extinction, albedo = np.full(shape, 15.0), np.full(shape, 2 / 3)
    domain = {}
    if name == "random-grid":
        rng = np.random.default_rng(1)
        extinction = rng.uniform(0.02, 0.5, shape) * voxels / edge
        albedo = rng.uniform(0.3, 0.95, shape)
        # A cube whose cells are the voxels, or parts of them, for references on finer cells.
        domain = {"edge_m": edge * 32 / voxels, "centre_m": [edge * (16 / voxels - 0.5)] * 3}
    file = folder / f"{name}.npz"
    np.savez(
        file,
        origin_m=np.full(3, -edge / 2),
        spacing_m=np.full(3, edge / voxels),
        droplet_absorption_per_m=extinction * (1.0 - albedo),
        droplet_scattering_per_m=extinction * albedo,
        droplet_temperature_K=np.full(shape, 370.0),
    )
    return {
        "name": name,
        "spray": {"model": "grid", "file": str(file)},
        "domain": domain,
        "background": {"radius_m": 0.08, "temperatures_K": [413.0, 473.0, 533.0]},
        "walls": {"temperature_K": 450.0},
    }


@dataclass(frozen=True)
class Reference:
    """Converged image. temperature_K: (H, W), NaN where T_app is undefined. error_K: its own
    estimated RMS error."""

    temperature_K: Floats
    error_K: float

    @classmethod
    def load(cls, name: str, *, pixels: int, folder: Path = FOLDER) -> "Reference | None":
        """Reference of a scene with `pixels` along an edge; None if `folder` has none."""
        path = folder / f"{name}-{pixels}.npz"
        if not path.is_file():
            return None
        with np.load(path) as data:
            steps = data["steps"]
            temperature_K = np.where(steps > 0, steps * STEP_K, np.nan)
            return cls(temperature_K, float(data["error_K"]))
