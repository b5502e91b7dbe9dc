"""True and stated error of pixel sampling at the rim of the background, against 64 rays.

    python -m tests.bench rim_pixels

Grids of `budget` fill the field in front of a disc whose rim crosses it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cldit
from cldit.bench.budget_scenes import budget_scene
from cldit.bench.case import changed
from cldit.gpu.device import Device, open_device
from cldit.run import Run
from cldit.scene import Scene


def picture(scene: Scene, device: Device, *, rays: int, audit: bool) -> tuple[Run, Any]:
    """A run, and its T_app (H, W), NaN where there is none."""
    camera, transport = {"rays_per_pixel": rays}, {"audit": audit, "accuracy_K": 1.0}
    run = cldit.simulate(changed(scene, camera=camera, transport=transport), device=device)
    shown = np.where(run.maps.has_temperature, run.maps.apparent_temperature_K, np.nan)
    return run, shown.astype(float)


def main() -> None:
    """A row for each grid, picture and number of rays."""
    device = open_device()
    print("grid         pixels rays  stated    true, K")
    for name in ("random-grid", "even-grid"):
        for pixels in (40, 100):
            with tempfile.TemporaryDirectory() as folder:
                scene = budget_scene(name, pixels=pixels, folder=Path(folder))
                _, true = picture(scene, device, rays=64, audit=False)
                for rays in (1, 4):
                    run, shown = picture(scene, device, rays=rays, audit=True)
                    assert run.errors is not None
                    (stated,) = (c for c in run.errors.causes if c.name == "pixel sampling")
                    true_K = float(np.sqrt(np.nanmean((shown - true) ** 2)))
                    print(
                        f"{name:12} {pixels:6} {rays:4} {stated.error_K or 0.0:7.3f} {true_K:7.3f}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
