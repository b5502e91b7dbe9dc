"""Small scenes, the field of former figures, and weights on the device of CLDIT_TEST_DEVICE.

`python -m tests.small_scenes OUT.npz` stores them, for tests that compare OpenCL drivers.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cldit
from cldit.gpu.device import Device, open_device
from cldit.spray.result import Parcels, Spray

SCENE: dict[str, Any] = {
    "name": "small",
    "spray": {"model": "cone", "spacing_m": 4e-3, "droplets": {"diameter_um": 9.0}},
    "domain": {"centre_m": [0.0, 0.0, -0.05], "leaf_edge_m": 6e-3},
    "camera": {"pixels": [16, 16]},
    "background": {"radius_m": 0.08, "temperatures_K": [413.0, 533.0]},
    "walls": {"temperature_K": 450.0},
}
TRANSPORT: dict[str, dict[str, Any]] = {
    "source": {"method": "source", "phase": "mie", "accuracy_K": 4.0},
    "path": {"method": "path", "phase": "isotropic", "accuracy_K": 8.0},
    "branching": {"method": "branching", "phase": "isotropic", "order": 1},
}


COUNT, CELL_m, KELVIN = 9, 2.5e-3, 350.0  # of the deep block: cells along an edge


def deep_block(diameter_m: float | NDArray[np.float64] = 1e-5) -> Spray:
    """Cells of optical depth 8 at two sides of a block of thin ones: the thick region ends at cells
    and at boundaries."""
    place = np.indices((COUNT,) * 3).reshape(3, -1).T
    deep = np.all((place >= (0, 3, 4)) & (place < (4, 6, COUNT)), axis=1)
    diameter_m = np.broadcast_to(diameter_m, len(place))
    area_m2 = 2.2 * np.pi / 4 * diameter_m**2  # of extinction
    return Spray(
        parcels=Parcels(
            position_m=np.asarray((place + 0.5 - COUNT / 2) * CELL_m, np.float64),
            diameter_m=diameter_m,
            droplets=np.where(deep, 8.0, 0.1) * CELL_m**2 / area_m2,
            temperature_K=np.full(len(place), KELVIN),
            density_kg_m3=np.full(len(place), 600.0),
        )
    )


def block_scene(pixels: int = 12, **sections: Any) -> cldit.Scene:
    """Scene that the deep block fills."""
    return cldit.Scene.from_dict(
        {
            "name": "block",
            "spray": {"model": "none"},
            "domain": {"edge_m": 16 * CELL_m, "leaf_edge_m": 1.01 * CELL_m},
            "camera": {"pixels": [pixels, pixels], "field_m": [COUNT * CELL_m] * 2},
            "background": {"radius_m": 0.03},
            **sections,
        }
    )


def weights(device: Device) -> dict[str, NDArray[Any]]:
    """Images (component, row, column) by method."""
    out = {}
    for method, transport in TRANSPORT.items():
        scene = cldit.Scene.from_dict({**SCENE, "transport": transport})
        run = cldit.simulate(scene, device=device)
        out[method] = np.stack(list(run.weights.images.values()))
    return out


def agree(found: NDArray[Any], expected: NDArray[Any], method: str) -> None:
    """Asserts that images agree to rounding.

    Compilers may fuse a multiplication and an addition, and their exp is good to 3 ulp; a line of
    sight crosses some 64 cells: 64 x 4 ulp of the largest weight. Chains of path tracing may part
    at a rounding, in few pixels; the mean of the image hardly changes.
    """
    largest = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert np.all(largest > 0)
    apart = np.abs(found - expected.astype(float)) / largest
    assert np.mean(apart > 64 * 4 * np.finfo(np.float32).eps) < 0.02, method
    mean, wanted = (each.mean(axis=(1, 2), dtype=float) for each in (found, expected))
    np.testing.assert_allclose(mean, wanted, rtol=1e-3, err_msg=method)


if __name__ == "__main__":
    with open_device(os.environ.get("CLDIT_TEST_DEVICE")) as opened:
        arrays: dict[str, Any] = {**weights(opened), "platform": opened.info.platform}
        np.savez(Path(sys.argv[1]), **arrays)


# A field of 160 mm around the nozzle's axis, for figures of a spray in pixels of a known size. The
# shipped scenes have fields that their spray fills.
WHOLE: dict[str, Any] = {"field_m": [0.16, 0.16], "target_m": None}
WHOLE_KEYS = {f"camera.{key}": value for key, value in WHOLE.items()}  # for `Scene.with_`


def of_whole_field(name: str) -> cldit.Scene:
    """A shipped scene with the field `WHOLE`."""
    return cldit.load_scene(name).with_(**WHOLE_KEYS)
