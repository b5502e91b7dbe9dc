"""Scenes of blocks with given coefficients, made as users make them: an .npz and a mapping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import cldit
from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.run import Run
from cldit.spray.result import Spray


def grid_scene(
    folder: Path, arrays: dict[str, Any], *, size_m: Sequence[float], **scene: Any
) -> dict[str, Any]:
    """Scene whose spray is one grid file, which is written into `folder`.

    Args:
        arrays: scalars (one voxel) or (nx, ny, nz) arrays by their names in the file.
        size_m: of the whole block, centred at the origin.
        scene: sections of the scene.
    """
    full = {name: np.array(value, float, ndmin=3) for name, value in arrays.items()}
    shape = np.broadcast_shapes(*(array.shape for array in full.values()))
    file = folder / f"block{sum(1 for _ in folder.glob('*.npz')) + 1}.npz"
    contents: dict[str, Any] = {
        "origin_m": -np.asarray(size_m) / 2,
        "spacing_m": np.asarray(size_m) / shape,
        **{name: np.broadcast_to(array, shape) for name, array in full.items()},
    }
    np.savez(file, **contents)
    return {"name": "block", "spray": {"model": "grid", "file": str(file)}, **scene}


def compared(ours: Sequence[Run], theirs: Sequence[Run], name: str) -> tuple[Floats, float]:
    """Difference (H, W) of a weight between the means of two independent runs each, and the mean
    square of its noise, from the differences of both pairs."""
    a, b, c, d = (run.weights.images[name].astype(float) for run in (*ours, *theirs))
    noise = float(np.mean((a - b) ** 2) + np.mean((c - d) ** 2)) / 4
    return (a + b) / 2 - (c + d) / 2, noise


@dataclass(frozen=True)
class Blocks:
    """Device that traces, folder of the grid files, and folder of cached tables."""

    device: Device
    folder: Path
    cache: Path

    def run(
        self, arrays: dict[str, Any], *, size_m: tuple[float, float, float], **scene: Any
    ) -> Run:
        """Simulates the `scene` of a block."""
        return self.simulated(self.scene(arrays, size_m=size_m, **scene))

    def scene(
        self, arrays: dict[str, Any], *, size_m: tuple[float, float, float], **scene: Any
    ) -> dict[str, Any]:
        """As `grid_scene`, in the folder of these blocks."""
        return grid_scene(self.folder, arrays, size_m=size_m, **scene)

    def simulated(self, data: dict[str, Any], spray: Spray | None = None) -> Run:
        """Simulates a scene; `spray` is used as if it had been imported."""
        scene = cldit.Scene.from_dict({"name": "block", **data})
        return cldit.simulate(scene, device=self.device, cache=self.cache, spray=spray)
