"""Paths of the final gather on the devices: kernels, uploads, and means (stage 5)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints
from cldit.gpu.buffers import download, unset, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, build
from cldit.transport.cell_phases import class_shares
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.quadrature import (
    NEAREST_SIDE,
    Ordinates,
    hilbert_order,
    nearest,
)
from cldit.transport.divided_planes import divided_planes
from cldit.transport.final_gather.cell_sources import CellSources
from cldit.transport.image import FormalSolution, ThickPixels
from cldit.transport.linear_coefficients import thick_albedo
from cldit.transport.phase import PHASE_STEPS, ScatteringTable
from cldit.transport.result import TraceSettings
from cldit.transport.sobol import points
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import upload_tree

_GROUP = 16


@dataclass(frozen=True)
class ChosenRays:
    """Pixels that get more paths.

    pixels: (N,) their numbers in a group of pixels, each with across^2 rays. offset: rays of
    earlier groups. samples: paths of a ray in either half.
    """

    pixels: Ints
    across: int
    offset: int
    samples: int

    @property
    def table(self) -> NDArray[np.int32]:
        """Rays (N across^2, 2) and numbers of paths, as the kernel takes them."""
        numbers = self.offset + self.pixels[:, None] * self.across**2 + np.arange(self.across**2)
        out = np.full((numbers.size, 2), self.samples, np.int32)
        out[:, 0] = numbers.reshape(-1)
        return out


def _path_ends(cutoff: float, settings: TraceSettings, *, diffusive: bool) -> dict[str, Any]:
    """Kernel arguments that tell where paths and their segments end.

    Sweeps do not have the diffusion limit in thick cells. So paths in `diffusive` ones continue
    until hardly any of their weight is left for the sweeps' sources.
    """
    tuning = settings.tuning
    transmission = max(cutoff, tuning.least_transmission * min(settings.accuracy_K, 0.1))
    return {
        "most_segments": tuning.diffuse_segments if diffusive else tuning.segments,
        "end_weight": tuning.diffuse_end_weight if diffusive else tuning.end_weight,
        "least_transmission": cutoff if diffusive else transmission,
    }


def _ordinates(
    directions: Ordinates, phase: ScatteringTable | None, real: type[np.floating]
) -> dict[str, NDArray[Any]]:
    """Tables from which the direction of a path is drawn, as kernel arguments.

    The ordinates of the stored radiance are in the order of the Hilbert curve, with the cumulative
    weight of light scattered along +y.
    """
    order = hilbert_order(directions.unit)
    unit, weight = directions.unit[order], directions.weight[order]
    steps = np.zeros(1)
    if phase is not None:
        steps = phase.by_half_sine(PHASE_STEPS)
        sine = np.sqrt((1 - unit[:, 1]) / 2)
        weight = weight * steps[np.minimum((sine * PHASE_STEPS).astype(int), PHASE_STEPS - 1)]
    drawn = np.column_stack([unit, np.cumsum(weight) / weight.sum()]).astype(real)
    start = np.searchsorted(drawn[:, 3], np.arange(len(drawn)) / len(drawn), "right")
    return {
        "directions": drawn,
        "start": np.minimum(start, len(drawn) - 1).astype(np.int32),
        "number_of": order,
        "nearest": nearest(directions),
        "by_half_sine": steps.astype(real),
    }


class PathSampler:
    """Samples paths from thick cells on every device.

    solution, settings: of the image. components: weights of a path, and the part within. programs:
    that were built. diffusive: paths continue far in thick cells.
    """

    def __init__(
        self,
        formal_solution: FormalSolution,
        thick: ThickRegion,
        ends: CellSources,
        settings: TraceSettings,
        flags: Mapping[str, Define] | None = None,
    ) -> None:
        """Uploads the thick region and the stored radiance `ends` to every device.

        `flags` are further defines of the kernels.
        """
        self.solution, self.settings = formal_solution, settings
        self.diffusive = thick.diffusive
        self._device, self._real = formal_solution.programs[0].device, formal_solution.real
        cells, view = formal_solution.cells, formal_solution.view
        self.components = len(cells.needs.components) + 1
        classes = class_shares(cells, settings.phase)
        defines = {**self._defines(ends, classes), **(flags or {})}
        self.programs = [
            build(
                member,
                "gather.cl",
                {
                    **simd_defines(member),
                    **defines,
                    # GPUs hide the latency of reads of stored radiance by other paths.
                    "PENDING_READS": 8 if member.is_cpu else 1,
                },
            )
            for member in (self._device, *self._device.others)
        ]
        cutoff = settings.ending(cells, formal_solution.scene)
        tables = _ordinates(ends.directions, settings.phase, self._real)
        linear = settings.linear_coefficients
        self._traversals: list[dict[str, Any]] = []
        self._fixed: list[dict[str, Any]] = []
        for device in (self._device, *self._device.others):
            self._traversals.append(
                {
                    "albedo": thick_albedo(device, cells, thick.listed, self._real, linear=linear),
                    **upload_tree(device, cells, self._real, linear=linear),
                    **view.geometry(device, cells, self._real),
                    "cutoff": cutoff,
                }
            )
            self._fixed.append(
                {
                    "light": self._light(device, ends),
                    **self._region(device, thick, ends, blurred="BLURRED_BOUNDARY" in defines),
                    **{name: upload(device, name, table) for name, table in tables.items()},
                    "direction_count": len(ends.directions),
                    **_path_ends(cutoff, settings, diffusive=thick.diffusive),
                    **self._phase(device, thick, classes),
                    **view.lines_of_sight(device, self._real),
                }
            )

    def _defines(self, ends: CellSources, classes: NDArray[np.uint8] | None) -> dict[str, Define]:
        """Compile-time defines of the kernels."""
        cells, settings = self.solution.cells, self.settings
        defines: dict[str, Define] = {**settings.defines(cells), "NEAREST_SIDE": NEAREST_SIDE}
        if classes is not None:
            defines["PHASE_CLASSES"] = len(classes) + 1
        if self.diffusive or classes is not None:
            defines["FREE_DIRECTIONS"] = 1
        for flag in ("MOMENT_SOURCE", "LINEAR_SOURCE", "BLURRED_BOUNDARY"):
            if flag in ends.program.defines:
                defines[flag] = ends.program.defines[flag]
        if settings.phase is not None:
            defines.update(PHASE_BINS=settings.phase.bins, PHASE_STEPS=PHASE_STEPS)
        return defines

    def _light(self, device: Device, ends: CellSources) -> Any:
        """Stored radiance of the interfaces, on this device."""
        interfaces = ends.light
        if device is self._device:
            return interfaces.buffer
        size = interfaces.interfaces * interfaces.directions * interfaces.components
        host = download(self._device, interfaces.buffer, np.empty(size, self._real))
        return upload(device, "interface radiance", host)

    def _region(
        self, device: Device, thick: ThickRegion, ends: CellSources, *, blurred: bool
    ) -> dict[str, Any]:
        """Uploads the thick region; its whole depths if the boundary is `blurred`."""
        cells = self.solution.cells
        box, real = cells.box(), self._real
        at = np.zeros((len(thick.at), 4), np.int32)
        at[:, :3] = thick.at + np.asarray(box.low)
        whole_depth = {}
        if blurred:
            depth = np.where(thick.address >= 0, cells.depth[thick.address], 0.0)
            whole_depth["whole_depth"] = upload(device, "optical depth", depth.astype(real))
        return {
            "places": upload(device, "places", thick.places),
            "at": upload(device, "cells' places", at),
            "beside": upload(device, "faces", thick.beside),
            "region_depth": upload(device, "thick cells", ends.depth.astype(real)),
            "cells": upload(device, "thick cells", ends.records.astype(real)),
            "box_low": np.array([*(box.low + thick.low), 0], np.int32),
            "box_shape": np.array([*thick.places.shape[::-1], 0], np.int32),
            **whole_depth,
        }

    def _phase(
        self, device: Device, thick: ThickRegion, classes: NDArray[np.uint8] | None
    ) -> dict[str, Any]:
        """Tables of the phase function, and the shares of size classes in the thick region."""
        phase, table = self.settings.phase, np.zeros(1)
        if phase is not None:
            table = np.concatenate([scattering.to_sample() for scattering in phase.tables])
        arguments = {"table": upload(device, "phase function", table.astype(self._real))}
        if classes is not None:
            of_region = np.where(thick.address >= 0, classes[:, thick.address], np.uint8(0))
            arguments["class_shares"] = upload(device, "size classes", of_region)
            arguments["region_cells"] = of_region.shape[1]
        return arguments

    def paths(self, groups: Sequence[ThickPixels]) -> list[dict[str, Any]]:
        """Kernel arguments, for each device, of paths from the thick cells on the rays of all
        groups of pixels."""
        ray_sets = [self._rays(group.pixels, group.across) for group in groups]
        rays, numbers = (np.concatenate(arrays) for arrays in zip(*ray_sets, strict=True))
        out = []
        for program, traversal, fixed in zip(
            self.programs, self._traversals, self._fixed, strict=True
        ):
            device, count = program.device, len(rays)
            group = min(_GROUP, program.largest_group("thick_intervals"))
            listed = upload(device, "rays", rays.astype(self._real))
            counts = zeros(device, "intervals", count, np.int32)
            # Neither is read until the number of intervals is known.
            intervals, first = unset(device, "intervals", 1, self._real), counts
            for fill in (0, 1):
                program.launch(
                    "thick_intervals",
                    (count,),
                    (group,),
                    {
                        "number": counts,
                        "intervals": intervals,
                        "first": first,
                        "fill": fill,
                        "list": listed,
                        "count": count,
                        **traversal,
                    },
                )
                if not fill:
                    ends = np.cumsum(download(device, counts, np.empty(count, np.int32)))
                    first = upload(device, "intervals", np.array([0, *ends], np.int32))
                    # An interval within a thick cell has nine values, see gather.cl.
                    intervals = zeros(device, "intervals", 9 * int(ends[-1]), self._real)
            out.append(
                {
                    "list": listed,
                    "numbers": upload(device, "rays", numbers.astype(np.uint32)),
                    "first": first,
                    "intervals": intervals,
                    **fixed,
                }
            )
        return out

    def _rays(self, pixels: Ints, across: int) -> tuple[Floats, Ints]:
        """across^2 rays through each of the pixels (N,), (R, 4), and their numbers (R,)."""
        row, column = np.divmod(pixels, self.solution.view.pixels[0])
        middle = np.stack([column, row, 0.0 * row, 0.0 * row], axis=1)
        rays = (middle[:, None] + self.solution.view.places(across)).reshape(-1, 4)
        return rays, (pixels[:, None] * across**2 + np.arange(across**2)).reshape(-1)

    def means(
        self, paths: list[dict[str, Any]], chosen: Sequence[ChosenRays], first: int = 0
    ) -> list[tuple[Floats, float]]:
        """Means (2, C + 1, N) of paths in either half, and numbers of their segments.

        Args:
            paths: of `paths`.
            chosen: the rays of each result.
            first: number of the first low-discrepancy point.
        """
        rays = np.concatenate([chosen_rays.table for chosen_rays in chosen])

        def launch(number: int, listed: slice, out: Any) -> None:
            """Starts paths of both halves for some of the chosen rays."""
            program, chosen_rays = self.programs[number], rays[listed]
            sobol = points(first, int(chosen_rays[:, 1].max()))
            program.launch(
                "gather",
                (len(chosen_rays), 2),
                (min(_GROUP, program.largest_group("gather")), 1),
                {
                    "means": out,
                    "chosen": upload(program.device, "chosen rays", chosen_rays),
                    "count": len(chosen_rays),
                    "from_point": first,
                    "key": np.array([self.settings.seed, 0], np.uint32),
                    "points": upload(program.device, "Sobol", sobol),
                    **paths[number],
                },
            )

        shape = (2 * (self.components + 1), len(rays))
        planes = divided_planes(self._device, "means", shape, self._real, launch)
        ray_means = planes.reshape(2, self.components + 1, -1)
        ends = np.cumsum([len(chosen_rays.table) for chosen_rays in chosen])
        return [
            (
                part[:, :-1]
                .reshape(2, self.components, len(chosen_part.pixels), -1)
                .mean(axis=3, dtype=np.float64),
                float(part[:, -1].sum(dtype=np.float64)),
            )
            for chosen_part, part in zip(
                chosen, np.split(ray_means, ends[:-1], axis=2), strict=True
            )
        ]
