"""Home of the cavity: at one temperature its image is flat, for any medium.

With medium, walls and background at temperature T every line of sight sees B(T) (second law of
thermodynamics). The weights of background and walls, and the emission over B(T), then sum to one in
every pixel; every error of the solver, of the last sweep or of the image changes that sum. Nothing
is normalised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run

T_K = 450.0
EDGE_M = 0.2
CELLS = 16  # along an edge

DEPTHS = (0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e4, 1e6)  # of a cell
ALBEDOS = (0.0, 0.5, 0.999, 0.999999, 1.0)


def departure(run: Run) -> NDArray[np.float64]:
    """Sum of the weights (H, W) minus 1."""
    radiance = float(band_radiance(T_K, filter_um=scene_filter(run.scene)))
    images = run.weights.images
    emitted = (images.pop("vapour").astype(float) + images.pop("liquid")) / radiance
    return np.asarray(emitted + sum(image.astype(float) for image in images.values()) - 1.0)


def cavity(
    run_block: Callable[..., Run],
    *,
    depth: float,
    albedo: float,
    vapour: float,
    droplets: float | None = None,
    cells: int = CELLS,
    camera: Mapping[str, Any] | None = None,
    size_m: tuple[float, float, float] = (EDGE_M,) * 3,
    **scene: Any,
) -> Run:
    """Cavity full of droplets and vapour.

    Args:
        run_block: as `Blocks.run`.
        depth: optical depth of a cell.
        albedo: scattering over depth.
        vapour, droplets: absorption of each over depth; droplets: 1 - albedo if None.
        cells: along an edge.
        camera: keys of the camera.
        size_m: of the medium.
        scene: other sections.
    """
    per_m = depth / (EDGE_M / cells)
    return run_block(
        {
            "vapour_absorption_per_m": vapour * per_m,
            "droplet_absorption_per_m": (1 - albedo if droplets is None else droplets) * per_m,
            "droplet_scattering_per_m": albedo * per_m,
            "vapour_temperature_K": T_K,
            "droplet_temperature_K": T_K,
        },
        size_m=size_m,
        domain={"edge_m": EDGE_M, "leaf_edge_m": 1.01 * EDGE_M / cells},
        camera={"pixels": [21, 17], "field_m": [0.19, 0.19], **(camera or {})},
        walls={"temperature_K": T_K},
        **{"background": {"temperatures_K": [T_K, T_K + 20]}, **scene},
    )
