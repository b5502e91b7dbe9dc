"""Mitsuba 3 on the grid and pixels of a scene, if it is installed.

Mitsuba has no emission within a medium, so weights are compared: the disc is red, everything around
it green, and one image has both.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.bench.case import BenchError
from cldit.transport.cells import OpticalCells
from tests.bench.case import Case, Lattice


def mitsuba(variant: str) -> Any:
    """The module, set to a variant.

    Raises:
        BenchError: it is not installed, or this variant does not run here.
    """
    if find_spec("mitsuba") is None:
        raise BenchError('Mitsuba is not installed; get it with: pip install "cldit[peers]"')
    # In a process of its own, for a library that does not fit ends the process.
    code = "import sys, mitsuba as mi; mi.set_variant(sys.argv[1]); "
    code += "mi.render(mi.load_dict(mi.cornell_box()), spp=1)"
    done = subprocess.run(
        [sys.executable, "-c", code, variant], capture_output=True, text=True, check=False
    )
    if done.returncode:
        reason = next((line for line in done.stderr.splitlines() if "rror" in line), "it crashes")
        hint = "; DRJIT_LIBLLVM_PATH names another LLVM" if "llvm" in variant else ""
        raise BenchError(f"Mitsuba {variant} does not run here: {reason.strip()[:120]}{hint}")
    module = import_module("mitsuba")
    module.set_variant(variant)
    return module


@dataclass(frozen=True)
class Stage:
    """The scene as Mitsuba has it; lengths in cells from the cube's lower corner."""

    mi: Any
    scene: Any
    case: Case

    @classmethod
    def of(cls, case: Case, mi: Any) -> Stage:
        """The scene of `case` in Mitsuba, `mi`: the box that is swept, cell for cell, and the disc.

        Scattering is isotropic.
        """
        return cls(mi, mi.load_dict(_description(case, mi)), case)

    def render(self, row: int, *, samples: int, seed: int) -> Floats:
        """Renders one row of the picture; samples are spread over each pixel's area."""
        mi = self.mi
        sensor = mi.load_dict(_sensor(self.case, mi, row, samples))
        image = mi.render(self.scene, sensor=sensor, spp=samples, seed=seed)
        return np.asarray(np.array(image, float)[0, :, :2].T)


def _description(case: Case, mi: Any) -> dict[str, Any]:
    cells = OpticalCells.of(case.tree)
    box, frame = cells.box(), case.tree.frame
    to_world = mi.ScalarTransform4f
    depth = cells.dense(box, cells.depth)
    albedo = np.zeros(len(cells.depth))
    albedo[cells.address] = cells.albedo
    placed = to_world().translate(list(box.low)).scale(list(box.shape))

    def volume(values: Floats) -> dict[str, Any]:
        grid = mi.VolumeGrid(np.ascontiguousarray(values[..., None], np.float32))
        return {
            "type": "gridvolume",
            "grid": grid,
            "filter_type": "nearest",
            "wrap_mode": "clamp",
            "to_world": placed,
            "raw": True,
        }

    scene = case.scene
    centre = frame.to_cells(np.asarray([scene.background_centre_m]))[0]
    radius = scene.background.radius_m / frame.cell_m
    facing = to_world().translate(centre.tolist()).rotate([1, 0, 0], 90).scale(radius)
    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 32},
        "medium": {
            "type": "cube",
            "to_world": placed.translate(0.5).scale(0.5),
            "bsdf": {"type": "null"},
            "interior": {
                "type": "heterogeneous",
                "sigma_t": volume(depth),
                "albedo": volume(cells.dense(box, albedo)),
                "phase": {"type": "isotropic"},
            },
        },
        "disc": {
            "type": "disk",
            "to_world": facing,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            "light": {"type": "area", "radiance": {"type": "rgb", "value": [1.0, 0.0, 0.0]}},
        },
        "walls": {"type": "constant", "radiance": {"type": "rgb", "value": [0.0, 1.0, 0.0]}},
    }


def _sensor(case: Case, mi: Any, row: int, samples: int) -> dict[str, Any]:
    scene, frame = case.scene, case.tree.frame
    target = frame.to_cells(np.asarray([scene.target_m]))[0]
    distance = scene.camera.distance_m / frame.cell_m
    columns, rows = scene.camera.pixels
    width, _ = scene.camera.field_m
    to_world = mi.ScalarTransform4f().look_at(
        origin=(target - [0.0, distance, 0.0]).tolist(), target=target.tolist(), up=[0, 0, 1]
    )
    angle = 2 * np.degrees(np.arctan(width / 2 / scene.camera.distance_m))
    return {
        "type": "perspective",
        "fov": float(angle),
        "fov_axis": "x",
        "to_world": to_world,
        "near_clip": 1e-2,
        "far_clip": 1e6,
        "film": {
            "type": "hdrfilm",
            "width": columns,
            "height": rows,
            "crop_offset_x": 0,
            "crop_offset_y": row,
            "crop_width": columns,
            "crop_height": 1,
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }


def row_lattice(case: Case, rows: int) -> Lattice:
    """The pixels of about `rows` rows of the picture of `case`."""
    spacing = max(case.scene.camera.pixels[1] // rows, 1)
    return Lattice((1, spacing - 1 + spacing % 2))
