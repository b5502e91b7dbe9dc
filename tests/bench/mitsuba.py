"""Weights and core seconds of Mitsuba 3, if installed, on the same grid and pixels.

Mitsuba has no emission within a medium, so the weights of background and walls are compared: the
disc is red, everything around it green, and one image has both.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import BenchError, Case, Cost, Lattice, Say, clocked
from cldit.bench.error import path_settings
from cldit.bench.report import Part, Table, number
from cldit.transport.cells import OpticalCells
from tests.bench.page import write_measured

Floats = NDArray[np.float64]

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
_WANTED = 0.01  # error of the background's weight


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
        """Renders one row of the picture; samples are spread over each pixel's area.

        Args:
            row: its number.
            samples: a pixel.
            seed: of the samples.

        Returns:
            (2, W) weights of background and wall.
        """
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


@dataclass(frozen=True)
class RendererRow:
    """error: RMS of the background's weight over the pixels compared, without the noise of `path`.
    picture_core_s: core seconds of all pixels at the samples taken; wanted_core_s: for 1 % error.
    bias: RMS difference from `path` beyond the noise of both; mean: signed."""

    tool: str
    samples: int
    error: float
    picture_core_s: float
    wanted_core_s: float
    bias_background: float
    bias_wall: float
    mean_background: float
    mean_wall: float


def compare(
    case: Case, variant: str, *, rows: int, samples: int, truth: tuple[Floats, Floats]
) -> RendererRow:
    """Two independent renders of some rows of the picture against two of `path`.

    Args:
        case: with the scene.
        variant: of Mitsuba.
        rows: about so many.
        samples: a pixel.
        truth: (2, rows, W) weights of background and wall, two independent halves.
    """
    stage = Stage.of(case, mitsuba(variant))
    lattice = row_lattice(case, rows)
    _, lines = lattice.numbers(case.scene)
    stage.render(lines[0], samples=1, seed=99)  # builds

    def picture(seed: int) -> Floats:
        return np.stack(
            [stage.render(line, samples=samples, seed=seed + line) for line in lines], 1
        )

    one, cost_one = clocked(case.device, lambda: picture(100_000))
    other, cost_other = clocked(case.device, lambda: picture(200_000))
    cost = Cost(
        (cost_one.core_s + cost_other.core_s) / 2, (cost_one.wall_s + cost_other.wall_s) / 2
    )
    sees = _seen(truth)
    noise = float(np.sqrt(np.mean((one - other)[0][sees] ** 2) / 2))
    picture_s = cost.core_s / lattice.share(case.scene)
    bias, mean = _gap(one, other, truth, sees)
    return RendererRow(
        tool=f"Mitsuba {version('mitsuba')}, {variant}",
        samples=samples,
        error=noise,
        picture_core_s=picture_s,
        wanted_core_s=picture_s * (noise / _WANTED) ** 2,
        bias_background=bias[0],
        bias_wall=bias[1],
        mean_background=mean[0],
        mean_wall=mean[1],
    )


def _seen(truth: tuple[Floats, Floats]) -> NDArray[np.bool_]:
    """Lines of sight to the background of which something takes 5 %, or more."""
    background = (truth[0][0] + truth[1][0]) / 2
    return np.asarray((background > 0.0) & (background < 0.95))


def _gap(
    one: Floats, other: Floats, truth: tuple[Floats, Floats], where: NDArray[np.bool_]
) -> tuple[list[float], list[float]]:
    """RMS and mean difference of each weight from the truth, without the noise of independent
    pictures."""
    rms, mean = [], []
    for c in (0, 1):
        products = ((one[c] - truth[0][c]) * (other[c] - truth[1][c]))[where]
        rms.append(float(np.sqrt(max(float(np.mean(products)), 0.0))))
        gap = (one[c] + other[c] - truth[0][c] - truth[1][c])[where] / 2
        mean.append(float(np.mean(gap)))
    return rms, mean


def row_lattice(case: Case, rows: int) -> Lattice:
    """The pixels of about `rows` rows of the picture of `case`."""
    spacing = max(case.scene.camera.pixels[1] // rows, 1)
    return Lattice((1, spacing - 1 + spacing % 2))


def renderers(case: Case, *, say: Say, rows: int = 4, samples: int = 64) -> Part:
    """Runs Mitsuba, `path` and `source` on about `rows` rows; `samples` per pixel in Mitsuba."""
    lattice = row_lattice(case, rows)
    part = case.seen(lattice.of(case.scene))
    halves = []
    for seed in (7001, 7002):
        settings = path_settings(part, 256, phase="isotropic", seed=seed)
        weights = part.run(settings)[0].weights
        halves.append(np.stack([weights.background, weights.wall]).astype(float))
    truth = (halves[0], halves[1])
    found, missing = [], []
    for variant in VARIANTS:
        try:
            found.append(compare(case, variant, rows=rows, samples=samples, truth=truth))
            say(f"{found[-1].tool}: {found[-1].wanted_core_s:.4g} core-s for 1 %")
        except BenchError as error:
            missing.append(str(error))
            say(str(error))
    found += _ours(case, part, lattice, truth)
    lines = [
        (
            row.tool,
            str(row.samples) if row.samples else "-",
            f"{row.error:.1e}",
            number(row.picture_core_s),
            number(row.wanted_core_s),
            f"{row.bias_background:.1e}",
            f"{row.bias_wall:.1e}",
            f"{row.mean_background:+.1e}",
            f"{row.mean_wall:+.1e}",
        )
        for row in found
    ]
    columns, height = case.scene.camera.pixels
    head = (
        "tool",
        "samples",
        "w_bg error",
        "core-s, picture",
        "core-s for 1 %",
        "w_bg - path, RMS",
        "w_wall",
        "w_bg - path, mean",
        "w_wall",
    )
    return Part(
        name="mitsuba",
        title=f"Beside others: {case.scene.name}",
        tables=(Table.of(head, lines),),
        data={"rows": [asdict(row) for row in found], "missing": missing},
        text=(
            f"{lattice.of(case.scene).camera.pixels[1]} rows of {columns} pixels, isotropic "
            f"scattering; core seconds are extrapolated to all {columns} x {height} pixels, and to "
            "an error of 0.01 in the background's weight (over the pixels that see something) by "
            "the square of the error; what errs less with its fewest samples or directions is not "
            "taken to get cheaper. "
            "Differences from `path` are without the noise of either; Mitsuba spreads its samples "
            "over each pixel's area, `path` takes its middle.",
            *missing,
        ),
    )


def _ours(
    case: Case, part: Case, lattice: Lattice, truth: tuple[Floats, Floats]
) -> list[RendererRow]:
    sees = _seen(truth)
    out = []
    plain = case.settings(phase="isotropic", accuracy_K=1.0, audit=False)
    runs = (
        ("cldit path", part, path_settings(part, 128, phase="isotropic", seed=5)),
        ("cldit source, 1 K", case, plain),
        ("cldit source, 8 directions", case, replace(plain, directions=8, final_directions=16)),
    )
    for tool, some, settings in runs:
        some.run(settings)
        result, cost = some.run(settings)
        weights = result.weights if some is part else lattice.pick(case.scene, result.weights)
        mine = np.stack([weights.background, weights.wall]).astype(float)
        bias, mean = _gap(mine, mine, truth, sees)
        whole = cost.core_s / (lattice.share(case.scene) if some is part else 1.0)
        samples = int(result.counts.get("samples", 0))
        wanted = whole * max((bias[0] / _WANTED) ** 2, 1.0)
        out.append(RendererRow(tool, samples, bias[0], whole, wanted, *bias, *mean))
    return out


def main() -> None:
    """Writes mitsuba.md."""
    write_measured(lambda given: renderers(given.case(), say=given.say))
