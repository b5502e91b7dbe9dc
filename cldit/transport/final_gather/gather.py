"""Final gather: light scattered by thick cells to the camera, by short paths (stage 5).

A thick cell scatters far more light back towards its illuminated side than its mean source
describes. So paths start in thick cells on the line of sight, sampled from the phase function.
Their segments cross the thick region and collect the sources of its cells; they end with the
interface radiance of the final sweeps. In the thickest cells paths continue (Jensen, Global
Illumination using Photon Maps, Rendering Techniques 1996; kernels/gather.cl).
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints
from cldit.gpu.buffers import download, unset, upload, zeros
from cldit.gpu.device import Device, shares
from cldit.gpu.program import Define, Program, build
from cldit.transport.cell_phases import class_shares
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.quadrature import (
    NEAREST_SIDE,
    Ordinates,
    hilbert_order,
    nearest,
)
from cldit.transport.final_gather.cell_sources import CellSources
from cldit.transport.image import FormalSolution
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.result import TraceSettings
from cldit.transport.sobol import points
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import upload_tree

_GROUP = 16
_PENDING = 8  # concurrent reads of stored radiance; GPUs hide the latency by other paths
_INTERVAL = 9  # values of an interval within a thick cell, as in gather.cl


@dataclass(frozen=True)
class GatherPaths:
    """Paths from given rays on one device, as arguments of the kernel."""

    device: Device
    program: Program
    arguments: dict[str, Any]

    def launch(
        self, chosen: NDArray[np.int32], some: range, key: NDArray[np.uint32], half: int, out: Any
    ) -> None:
        """Starts paths for each of the `chosen` (N,) rays, and does not wait for them.

        Args:
            some: numbers of the low-discrepancy points.
            key: (2,) of the random generator, Philox.
            half: number of the random shift of the points.
        """
        self.program.launch(
            "gather",
            (len(chosen),),
            (min(_GROUP, self.program.largest_group("gather")),),
            {
                "means": out,
                "chosen": upload(self.device, "chosen rays", chosen),
                "count": len(chosen),
                "samples": len(some),
                "from_point": some.start,
                "key": key,
                "half_": half,
                "points": upload(self.device, "Sobol", points(some.start, len(some))),
                **self.arguments,
            },
        )
        self.device.queue.flush()  # the next device starts while this one works


def neyman_allocation(energy: Floats, had: Ints, size: Ints, *, allowed: float) -> Ints:
    """Samples per pixel (T,) of each tile that reach a total variance at the lowest cost.

    They are proportional to the root of energy x had / size, since the variance is proportional to
    1 / samples (Neyman, J. R. Stat. Soc. 97, 1934), rounded to powers of two, for which
    low-discrepancy points are most uniform. At least one tile gets more than it had.

    Args:
        energy: (T,) sum of squared errors of a tile's pixels, after `had` samples each.
        had: (T,) samples per pixel so far.
        allowed: sum of the energies of all tiles.
    """
    spread = np.sqrt(energy * had / size)
    ideal = spread * float(spread @ size) / allowed
    power = np.exp2(np.round(np.log2(np.clip(ideal, 1.0, 2.0**40)))).astype(np.int64)
    if not np.any(power > had):
        worst = np.argmax(energy)
        power[worst] = 2 * had[worst]
    return power


def _classes(
    device: Device, shares: NDArray[np.uint8] | None, thick: ThickRegion
) -> dict[str, Any]:
    """Kernel arguments of PHASE_CLASSES, from the `shares` (K - 1, P) of stored cells."""
    if shares is None:
        return {}
    of_region = np.where(thick.address >= 0, shares[:, thick.address], np.uint8(0))
    return {
        "class_shares": upload(device, "size classes", of_region),
        "region_cells": of_region.shape[1],
    }


class Gather:
    """Final gather of an image, in rounds of paths.

    samples, seconds: paths per pixel of the first call, and time, so far.
    short: reason why paths stopped before the wanted accuracy; empty if they did not.
    """

    def __init__(
        self,
        formal_solution: FormalSolution,
        box: SweptBox,
        thick: ThickRegion,
        ends: CellSources,
        settings: TraceSettings,
        flags: Mapping[str, Define] | None = None,
    ) -> None:
        """Uploads the thick region and the stored radiance `ends` to every device.

        `flags` are further defines of the kernels.
        """
        directions, light = ends.directions, ends.light
        self._image, self._settings = formal_solution, settings
        self.device: Device = formal_solution.parts[0].device
        cells = formal_solution.cells
        self._real = formal_solution.real
        self._components = len(cells.needs.components) + 1
        phase, tuning = settings.phase, settings.tuning
        table, steps = np.zeros(1), np.zeros(1)
        least = max(settings.cutoff, tuning.least_transmission * min(settings.accuracy_K, 0.1))
        segments, end_weight = tuning.segments, tuning.end_weight
        if thick.diffusive:
            # Sweeps do not have the diffusion limit in thick cells. So paths continue until hardly
            # any of their weight is left for the sweeps' sources.
            least = tuning.path_cutoff
            segments, end_weight = tuning.diffuse_segments, tuning.diffuse_end_weight
        self._defines: dict[str, Define] = {
            **settings.defines(cells, formal_solution.view),
            "CUTOFF": float(settings.cutoff),
            **(flags or {}),
            "MIN_TRANSMISSION": float(least),
            "MAX_SEGMENTS": segments,
            "END_WEIGHT": f"R({end_weight})",
            "NEAREST_SIDE": NEAREST_SIDE,
        }
        classes = class_shares(cells, phase)
        if classes is not None:
            self._defines["PHASE_CLASSES"] = len(classes) + 1
        if thick.diffusive or classes is not None:
            self._defines["FREE_DIRECTIONS"] = 1
        for flag in ("MOMENT_SOURCE", "LINEAR_SOURCE", "BLURRED_BOUNDARY"):
            if flag in ends.program.defines:
                self._defines[flag] = ends.program.defines[flag]
        whole: dict[str, Floats] = {}
        if "BLURRED_BOUNDARY" in self._defines:
            depth = np.where(thick.address >= 0, cells.depth[thick.address], 0.0)
            whole["whole_depth"] = depth.astype(self._real)
        if phase is not None:
            table = np.concatenate([one.to_sample() for one in phase.tables])
            steps = phase.by_half_sine(PHASE_STEPS)
            self._defines.update(PHASE_BINS=phase.bins, PHASE_STEPS=PHASE_STEPS)
        real = self._real
        albedo = np.zeros(len(cells.depth), real)
        middles = cells.middles() if settings.linear_coefficients else cells
        albedo[cells.address[thick.listed]] = middles.albedo[thick.listed]
        records = ends.records.astype(real)
        order = hilbert_order(directions.unit)
        drawn = Ordinates(directions.unit[order], directions.weight[order])
        shared = self._cumulative(drawn, steps).astype(real)
        starts = np.searchsorted(shared[:, 3], np.arange(len(shared)) / len(shared), "right")
        near = nearest(directions)
        size = light.interfaces * light.directions * light.components
        self._programs = [
            build(
                part.device,
                "gather.cl",
                {
                    **simd_defines(part.device),
                    **self._defines,
                    "PENDING_READS": _PENDING if part.device.is_cpu else 1,
                },
            )
            for part in formal_solution.parts
        ]
        at = np.zeros((len(thick.at), 4), np.int32)
        at[:, :3] = thick.at + np.asarray(box.low)
        view = formal_solution.view
        self._traversals: list[dict[str, Any]] = []
        self._fixed: list[dict[str, Any]] = []
        for part in formal_solution.parts:
            one, stored = part.device, light.buffer
            if one is not self.device:
                host = download(self.device, light.buffer, np.empty(size, real))
                stored = upload(one, "interface radiance", host)
            self._traversals.append(
                {
                    "albedo": upload(one, "albedo", albedo),
                    **upload_tree(one, cells, real, linear=settings.linear_coefficients),
                    **view.geometry(one, cells, real),
                }
            )
            start = np.minimum(starts, len(shared) - 1).astype(np.int32)
            self._fixed.append(
                {
                    "table": upload(one, "phase function", table.astype(real)),
                    "places": upload(one, "places", thick.places),
                    "at": upload(one, "cells' places", at),
                    "beside": upload(one, "faces", thick.beside),
                    "region_depth": upload(one, "thick cells", ends.depth.astype(real)),
                    "cells": upload(one, "thick cells", records),
                    "start": upload(one, "directions", start),
                    "nearest": upload(one, "directions", near),
                    "box_low": np.array([*(box.low + thick.low), 0], np.int32),
                    "box_shape": np.array([*thick.places.shape[::-1], 0], np.int32),
                    "light": stored,
                    "directions": upload(one, "directions", shared),
                    "number_of": upload(one, "directions", order),
                    "direction_count": len(directions),
                    "by_half_sine": upload(one, "phase function", steps.astype(real)),
                    **_classes(one, classes, thick),
                    **{name: upload(one, "optical depth", all_) for name, all_ in whole.items()},
                    **view.lines_of_sight(one, real),
                }
            )
        self.samples, self.seconds = 0, 0.0
        self._segments, self._diffusive = 0.0, thick.diffusive
        self._spent, self._rays = 0.0, 0  # of all calls
        self.short = ""

    def _cumulative(self, directions: Ordinates, steps: Floats) -> Floats:
        """Ordinates (K, 4): unit vectors and cumulative weight of light scattered along +y."""
        weight = directions.weight
        if self._settings.phase is not None:
            sine = np.sqrt((1 - directions.unit[:, 1]) / 2)
            weight = weight * steps[np.minimum((sine * PHASE_STEPS).astype(int), PHASE_STEPS - 1)]
        return np.column_stack([directions.unit, np.cumsum(weight) / weight.sum()])

    def __call__(
        self,
        pixels: Ints,
        across: int,
        seen: NDArray[np.floating],
        other: int,
    ) -> Floats:
        """Traces paths until their noise in T_app is `noise_share` of accuracy_K, or to a limit.

        The limits are `max_samples` per pixel, and `paths` and `path_segments` in total. Rounds
        sample the tiles where they reduce the variance most. Light that diffuses takes paths of
        unknown length, so that the first round has one in each half.

        Args:
            pixels: (N,) flat numbers.
            across: across^2 rays go through each pixel.
            seen: (C, N) weights of the rest of the image.
            other: number of pixels with a T_app that see no thick cell.

        Returns:
            Means (2, C + 1, N) of two independent sets of paths, the part WITHIN last.
        """
        cells, wanted = self._image.cells, self._settings.accuracy_K
        temperature = cells.temperature(self._image.scene, visible=self._settings.visible)
        start = time.perf_counter()
        count, most = len(pixels), self._settings.max_samples
        tuning = self._settings.tuning
        paths = self.paths(pixels, across)
        sums = np.zeros((2, self._components, count))
        samples = np.zeros(count, np.int64)  # of either half, in each of a pixel's rays
        tiles = self._tiles(pixels)
        near = np.argsort(tiles, kind="stable")  # paths of a tile cross the same cells
        before = self._image.view.on_background(pixels)
        size = 1 if self._diffusive else max(tuning.first_samples // across**2, 1)
        self._segments = 0.0
        while size > 1 and 2 * size * across**2 * count > tuning.paths / 4:
            size //= 2
        wanted_of = np.full(count, size)
        while True:
            # Pixels with equal numbers of paths continue with the same points.
            for pair in np.unique(samples << 32 | wanted_of):
                had, goal = divmod(int(pair), 1 << 32)
                mine = near[(samples[near] == had) & (wanted_of[near] == goal)]
                for half, total in enumerate(sums):
                    if goal > had:
                        some = range(had, goal)
                        found = self.means(paths, mine, across, some, half)
                        total[:, mine] += (goal - had) * found
            samples = wanted_of
            means = sums / samples
            mean, difference = (means[0] + means[1]) / 2, (means[0] - means[1]) / 2
            # The trace must be accurate for any wall temperature: for that of the scene, and for
            # walls as bright as the cells' largest source (dark in cells of low absorption).
            before_own, before_bright = (
                before
                * np.nan_to_num(
                    temperature.error_K(seen + mean[:-1], difference[:-1], outside=outside)
                )
                for outside in (None, cells.scale)
            )
            error_K = np.maximum(np.abs(before_own), np.abs(before_bright) / tuning.noise_bright)
            energy = np.bincount(tiles, error_K**2).astype(np.float64)
            counted = before & (1 - (seen + mean[:-1])[0] > temperature.visible)
            visible = max(int(np.count_nonzero(counted)) + other, 1)
            allowed = visible * (tuning.noise_share * wanted) ** 2
            if energy.sum() <= allowed:
                break
            size_of = np.bincount(tiles)
            had_of = np.bincount(tiles, samples) // size_of
            ideal = neyman_allocation(energy, had_of, size_of, allowed=allowed)[tiles]
            limit = np.minimum(tuning.growth * samples, most // (2 * across**2))
            longest = self._segments / samples.sum()  # mean number in a path of either half
            allowed_samples = (tuning.path_segments - self._spent) / max(longest, 1.0)
            wanted_of = np.maximum(np.minimum(ideal, limit), samples)
            while wanted_of.sum() > allowed_samples and not np.array_equal(wanted_of, samples):
                wanted_of = np.maximum(wanted_of // 2, samples)
            paths_in_all = 2.0 * across**2 * wanted_of.sum()
            if np.array_equal(wanted_of, samples) or paths_in_all > tuning.paths:
                noise_K = float(np.sqrt(energy.sum() / visible))
                self.short = (
                    f"paths in thick cells: stopped at {most} samples per pixel, or in total "
                    f"{tuning.paths:.0e} or {tuning.path_segments:.0e} scatterings, with a noise "
                    f"of {noise_K:.2g} K RMS; "
                    f"transport.accuracy_K: {wanted:g} needs {tuning.noise_share * wanted:.2g} K; "
                    "increase transport.max_samples or transport.accuracy_K"
                )
                break
        self._spent, self._rays = self._spent + self._segments, self._rays + count * across**2
        self.samples = self.samples or int(2 * samples.mean() * across**2)
        self.seconds += time.perf_counter() - start
        return means

    def affords(self, rays: int) -> bool:
        """True if the scatterings that an image may have suffice for so many more rays."""
        most = self._settings.tuning.path_segments
        enough = not self._rays or self._spent * (1 + rays / self._rays) <= most
        if not enough:
            self.short = self.short or (
                f"paths in thick cells: no more rays for pixels, as an image may have {most:.0e} "
                "scatterings; allowed: more camera.pixels, or a larger transport.accuracy_K"
            )
        return enough

    def _tiles(self, pixels: Ints) -> Ints:
        """Numbers (N,) of the image tiles of the pixels."""
        row, column = np.divmod(pixels, self._image.view.pixels[0])
        edge = self._settings.tuning.noise_tile
        tile = row // edge * self._image.view.pixels[0] + column // edge
        return np.unique(tile, return_inverse=True)[1].astype(np.int64)

    @property
    def programs(self) -> list[Program]:
        """Programs that were built."""
        return self._programs

    def paths(self, pixels: Ints, across: int) -> list[GatherPaths]:
        """Paths from the thick cells on across^2 rays through each pixel (N,), for each device."""
        row, column = np.divmod(pixels, self._image.view.pixels[0])
        middle = np.stack([column, row, 0.0 * row, 0.0 * row], axis=1)
        rays = (middle[:, None] + self._image.view.places(across)).reshape(-1, 4)
        numbers = (pixels[:, None] * across**2 + np.arange(across**2)).reshape(-1)
        out = []
        for part, program, traversal, fixed in zip(
            self._image.parts, self._programs, self._traversals, self._fixed, strict=True
        ):
            one, count = part.device, len(rays)
            group = min(_GROUP, program.largest_group("thick_intervals"))
            listed = upload(one, "rays", rays.astype(self._real))
            counts = zeros(one, "intervals", count, np.int32)
            # Neither is read until the number of intervals is known.
            intervals, first = unset(one, "intervals", 1, self._real), counts
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
                    ends = np.cumsum(download(one, counts, np.empty(count, np.int32)))
                    first = upload(one, "intervals", np.array([0, *ends], np.int32))
                    intervals = zeros(one, "intervals", _INTERVAL * int(ends[-1]), self._real)
            arguments = {
                "list": listed,
                "numbers": upload(one, "rays", numbers.astype(np.uint32)),
                "first": first,
                "intervals": intervals,
                **fixed,
            }
            out.append(GatherPaths(one, program, arguments))
        return out

    def means(
        self,
        paths: list[GatherPaths],
        chosen: Ints,
        across: int,
        some: range,
        half: int,
    ) -> Floats:
        """Means (C + 1, N) of paths for across^2 rays of each chosen pixel (N,).

        `paths` are those of `paths(pixels, across)`; `some` and `half` as in `GatherPaths.launch`.
        """
        rays = (chosen[:, None] * across**2 + np.arange(across**2)).reshape(-1).astype(np.int32)
        key = np.array([self._settings.seed, 0], np.uint32)
        outs = []
        for each, (_, mine) in zip(paths, shares(self.device, len(rays)), strict=True):
            out = zeros(each.device, "means", (self._components + 1) * len(mine), self._real)
            if mine:
                each.launch(rays[mine.start : mine.stop], some, key, half, out)
            outs.append((each.device, out, len(mine)))
        found = [
            download(device, out, np.empty((self._components + 1, count), self._real))
            for device, out, count in outs
            if count
        ]
        whole = np.concatenate(found, axis=1)
        self._segments += float(whole[-1].sum(dtype=np.float64))
        whole = whole[:-1].reshape(self._components, len(chosen), -1)
        return np.asarray(whole.mean(axis=2, dtype=np.float64))
