"""Scenes of blocks with given coefficients, made as users make them: an .npz and a mapping."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.gpu.device import Device
from cldit.run import Run


@pytest.fixture
def run_block(tmp_path: Path, tables: Path, device: Device) -> Callable[..., Run]:
    """Simulates a scene whose spray is one grid file.

    arrays: scalars (one voxel) or (nx, ny, nz) arrays by their names in the file. size_m: of the
    whole block, centred at the origin. Everything else is scene keys.
    """
    count = 0

    def run(arrays: dict[str, Any], *, size_m: tuple[float, float, float], **scene: Any) -> Run:
        nonlocal count
        count += 1
        full = {name: np.array(value, float, ndmin=3) for name, value in arrays.items()}
        shape = max((array.shape for array in full.values()), key=np.prod)
        file = tmp_path / f"block{count}.npz"
        contents: dict[str, Any] = {
            "origin_m": -np.asarray(size_m) / 2,
            "spacing_m": np.asarray(size_m) / shape,
            **{name: np.broadcast_to(array, shape) for name, array in full.items()},
        }
        np.savez(file, **contents)
        data = {"name": "block", "spray": {"model": "grid", "file": str(file)}, **scene}
        # Here the truth is known otherwise.
        data["transport"] = {"audit": False, "accuracy_K": 0.1, **data.get("transport", {})}
        return cldit.simulate(cldit.parse_scene(data), device=device, cache=tables)

    return run
