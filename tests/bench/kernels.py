"""Single kernels of a trace, launched alone and timed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import Cost, clocked
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.program import Define, build
from cldit.transport.camera_source import final_sweeps
from cldit.transport.cell_records import CellRecords, Sources
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.gmres import order_0
from cldit.transport.discrete_ordinates.iteration import iterate_source
from cldit.transport.discrete_ordinates.moment_source import moment_source
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import isotropic
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.final_gather.paths import ChosenRays, PathSampler
from cldit.transport.image import ThickPixels
from cldit.transport.linear_coefficients import device_cells
from cldit.transport.result import TraceInput
from cldit.transport.source_iteration import formal_solution, thick_region
from cldit.transport.view import View, upload_tree
from tests.bench.case import Case

Floats = NDArray[np.float64]

_ROUNDS = 3


def quickest(case: Case, launch: Callable[[], Any], *, rounds: int = _ROUNDS) -> Cost:
    """The least cost of several rounds, each number by itself, after one that builds and warms."""
    launch()
    costs = [clocked(case.device, launch)[1] for _ in range(rounds)]
    return Cost(min(c.core_s for c in costs), min(c.wall_s for c in costs))


@dataclass(frozen=True)
class PathSegments:
    """Segments from `pixels` pixels that cross `crossed` cells in all.

    The region that they cross has `region` cells, with records of `record` numbers each.
    """

    pixels: int
    segments: int
    crossed: float
    region: int
    record: int
    cost: Cost


@dataclass(frozen=True)
class Kernels:
    """Kernels of one medium and camera."""

    case: Case

    @cached_property
    def cells(self) -> OpticalCells:
        """Cells of the medium."""
        names = tuple(patch.name for patch in self.case.scene.patches)
        return OpticalCells.of(self.case.tree, patches=names)

    @cached_property
    def view(self) -> View:
        """Camera."""
        return View.of(self.case.scene, self.cells, self.case.device)

    def image(self, *, images: int = 1, linear: bool = False) -> Cost:
        """Images from given sources, constant or linear in each cell."""
        device, cells, real = self.case.device, self.cells, np.float32
        defines: dict[str, Define] = {**cells.needs.defines, "IMAGES": images}
        if linear:
            defines["LINEAR_SOURCE"] = 1
        program = build(device, "image.cl", defines)
        columns, rows = self.view.pixels
        planes = images * (len(cells.needs.components) + 1)
        out = zeros(device, "image", planes * rows * columns, real)
        made = CellRecords.of(cells)
        number = upload(device, "records' numbers", made.number)
        listed = []
        if cells.needs.scattering:
            listed = [np.zeros((len(cells.needs.components), len(cells.address)), real)] * images
        sources = Sources(listed, np.zeros(len(cells.address)), linear)
        whole = device_cells(device, cells, real, linear=False)
        arguments = {
            "directory": whole["directory"],
            "span": whole["span"],
            "number": number,
            **made.upload(program, number, sources, None),
            **self.view.geometry(device, cells, real),
            "cutoff": self.case.settings().ending(cells, self.case.scene),
        }
        tiles = self.view.tiles(program, "image")
        return quickest(
            self.case, lambda: program.launch("image", *tiles, {"planes": out, **arguments})
        )

    def path_segments(self, count: int, *, vector: int | None = None) -> PathSegments | None:
        """`count` segments through the solved source from each pixel with thick intervals.

        None where there are no such pixels. `vector` is the number of segments at once; None is
        what a trace takes.
        """
        case, cells, view = self.case, self.cells, self.view
        settings = case.settings()
        flags: dict[str, Define] = {"COUNTED": 1}
        if vector is not None:
            flags["SIMD_WIDTH"] = vector
        given = TraceInput(cells, case.scene, view, case.device, settings)
        region = thick_region(cells, settings)
        if region is None:
            return None
        problem = SweepProblem.of(given, region)
        rng = np.random.default_rng(settings.seed)
        solved = iterate_source(problem, rng, None)
        camera = final_sweeps(problem, moment_source(problem, solved, rng))
        image = formal_solution(given, region)
        assert camera.cell_sources is not None
        sampler = PathSampler(image, region, camera.cell_sources, settings, flags)
        found: list[ThickPixels] = []

        class Collect:
            def __call__(self, groups: Sequence[ThickPixels]) -> list[Floats]:
                found.extend(groups)
                return [
                    np.zeros((image.at_once, len(each.seen) + 1, len(each.pixels)))
                    for each in groups
                ]

            def affords(self, _: int) -> bool:
                return True

        rays = image.with_sources(list(camera.halves), camera.defect, Collect(), known=camera.known)
        rays.middle()
        if not found:
            return None
        [group] = found
        pixels, paths = group.pixels, sampler.paths(found)
        every = ChosenRays(np.arange(len(pixels)), 1, 0, count // 2)

        def cross() -> Floats:
            return sampler.means(paths, [every])[0][0]

        crossed = float(cross()[:, -1].sum())
        region_cells, record = camera.cell_sources.records.shape
        segments = count // 2 * 2 * len(pixels)
        timed = quickest(case, cross)
        return PathSegments(len(pixels), segments, crossed, region_cells, record, timed)

    def steps(self) -> tuple[NDArray[np.int64], Cost]:
        """Steps of every line of sight, and those of them through something, (2, H, W)."""
        device, cells, real = self.case.device, self.cells, np.float32
        program = build(device, "count.cl", cells.needs.defines)
        columns, rows = self.view.pixels
        out = zeros(device, "steps", 2 * rows * columns, np.int32)
        arguments = {
            **upload_tree(device, cells, real),
            **self.view.geometry(device, cells, real),
        }
        tiles = self.view.tiles(program, "count")
        cost = quickest(
            self.case, lambda: program.launch("count", *tiles, {"crossings": out, **arguments})
        )
        counted = download(device, out, np.empty((rows, columns, 2), np.int32))
        return counted.transpose(2, 0, 1).astype(np.int64), cost

    def sweep(self, count: int, *, vector: int | None = None) -> Cost:
        """Sweeps with `count` ordinates; `vector`: cells at once, None: as in a trace."""
        device, cells = self.case.device, self.cells
        specialised: dict[str, Define] = {**cells.needs.defines, **simd_defines(device)}
        if vector is not None:
            specialised["SIMD_WIDTH"] = vector
        sweeper = Sweeper(
            device,
            cells,
            build(device, "sweep.cl", specialised),
            build(device, "source_update.cl", specialised),
            disc=self.view.disc,
            patches=self.view.patches,
        )
        rng = np.random.default_rng(1)
        rays = sweeper.rays(isotropic(count, rng), rng.random((count, 2)))
        sweeper.set_source(order_0(sweeper, cells.albedo), shining=True)
        return quickest(self.case, lambda: sweeper.sweep(rays, shining=True))
