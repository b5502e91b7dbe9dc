"""Scenes of `budget` and their reference images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.scene import Scene, load_scene, parse_scene

Floats = NDArray[np.float64]

FOLDER = Path(__file__).parent / "references"
_RAYS = {1000: 1}  # else 16: much of the spray is smaller than a large pixel
STEP_K = 0.01  # of stored temperatures, in 16 bits


def budget_scene(name: str, *, pixels: int, folder: Path) -> Scene:
    """Scene of `BUDGET_SCENES` with free resolution, `pixels` along an edge; files in `folder`."""
    data: dict[str, Any] = {
        "camera": {"pixels": [pixels, pixels], "rays_per_pixel": _RAYS.get(pixels, 16)}
    }
    if name.endswith("-grid"):
        data["camera"]["target_m"] = [0.0, 0.0, 0.0]
        return parse_scene({**_grid(name, folder), **data})
    scene = load_scene(name).model_dump(mode="json")
    scene["camera"].update(data["camera"])
    scene["optics"]["compare_paper"] = False
    if name == "droplets-only":
        scene["optics"]["preset"] = "spectral"
    return parse_scene(scene)


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
    def load(cls, name: str, *, pixels: int, folder: Path = FOLDER) -> Reference | None:
        """Reference of a scene with `pixels` along an edge; None if `folder` has none."""
        path = folder / f"{name}-{pixels}.npz"
        if not path.is_file():
            return None
        with np.load(path) as data:
            steps = data["steps"]
            temperature_K = np.where(steps > 0, steps * STEP_K, np.nan)
            return cls(temperature_K, float(data["error_K"]))
