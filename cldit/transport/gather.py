"""The picture of what thick cells scatter, by chains of scatterings among them.

In the sweeps a cell has one source. Where it is thick the source varies within it, and what it
sends back to where it is lit from is far more than its mean. Where a line of sight meets thick
cells, chains follow what these scatter, by the phase function itself, until they leave them for
cells whose light is known from the last sweep.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.gpu.share import shares
from cldit.transport.cells import Box
from cldit.transport.directions import Directions
from cldit.transport.kelvin import VISIBLE, error_K
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.picture import Painter
from cldit.transport.result import Settings
from cldit.transport.sobol import columns
from cldit.transport.thick import FACE, RimLight, ThickCells, nearest
from cldit.transport.view import upload_tree

Floats = NDArray[np.float64]

_SAMPLES = 32  # of a pixel and batch
_LONGEST = 32  # scatterings of a chain, after which the light is that of the sweeps
_GROUP = 16
_TILE = 12  # pixels along a tile's edge: some hundred tell their noise
_NOISE = 1.5  # times the wanted error, before walls as bright as the hottest cell: half, on `gdi`


class Gather:
    """Adds to pictures what thick cells scatter, batch by batch."""

    def __init__(
        self,
        painter: Painter,
        box: Box,
        thick: ThickCells,
        directions: Directions,
        light: RimLight,
        settings: Settings,
        defines: dict[str, Define],
        *,
        source: NDArray[np.floating],
        units: Floats,
    ) -> None:
        """directions, light: of the last sweep. source (C, N), units (C,): see
        `ThickCells.records`."""
        self._painter, self._settings = painter, settings
        self.device: Device = painter.parts[0].device
        cells = painter.cells
        self._real = painter.real
        self._components = len(cells.needs.components) + 1
        phase = settings.phase
        table, steps = np.zeros(1), np.zeros(1)
        self._defines: dict[str, Define] = {**defines, "LONGEST": _LONGEST, "FACE": FACE}
        import os
        if os.environ.get("TRIAL"):
            self._defines["TRIAL"] = 1
        if phase is not None:
            table, steps = phase.to_sample(), phase.by_half_sine(PHASE_STEPS)
            self._defines.update(PHASE_BINS=phase.bins, PHASE_STEPS=PHASE_STEPS)
        real = self._real
        albedo = np.zeros(len(cells.depth), real)
        albedo[cells.address[thick.listed]] = cells.albedo[thick.listed]
        records = thick.records(cells, source, units).astype(real)
        shared = self._shares(directions, steps).astype(real)
        near = nearest(directions)
        kept = light.buffer
        if len(painter.parts) > 1:
            size = len(directions) * light.rim * (self._components - 1)
            kept = download(self.device, light.buffer, np.empty(size, real))
        self._fixed = [
            [
                upload(part.device, "phase function", table.astype(real)),
                upload(part.device, "phase function", steps.astype(real)),
                upload(part.device, "Sobol", columns()),
                upload(part.device, "albedo", albedo),
                upload(part.device, "places", thick.places),
                upload(part.device, "thick cells", records),
                kept if kept is light.buffer else upload(part.device, "light of the rim", kept),
                upload(part.device, "directions", shared),
                upload(part.device, "directions", near),
                np.int32(light.rim),
                np.int32(len(directions)),
                np.array([*(box.low + thick.low), 0], np.int32),
                np.array([*thick.places.shape[::-1], 0], np.int32),
                *upload_tree(part.device, cells, real),
                *part.arguments,
            ]
            for part in painter.parts
        ]
        self.samples, self.seconds = 0, 0.0
        self._programs: dict[int, list[Program]] = {}

    def _shares(self, directions: Directions, steps: Floats) -> Floats:
        """(K, 4) directions, and the share up to each in what is scattered along +y, by the phase
        function in bins of the half angle's sine where there is one."""
        weight = directions.weight
        if self._settings.phase is not None:
            sine = np.sqrt((1 - directions.unit[:, 1]) / 2)
            weight = weight * steps[np.minimum((sine * PHASE_STEPS).astype(int), PHASE_STEPS - 1)]
        return np.column_stack([directions.unit, np.cumsum(weight) / weight.sum()])

    def __call__(
        self,
        pixels: NDArray[np.int64],
        across: int,
        seen: Floats,
        other: int,
    ) -> Floats:
        """(2, C + 1, N), the part from within last, from two independent sets of chains, for flat
        numbers of pixels, with across^2 rays through each.

        seen (C, N): what else is seen; other: pixels that see no thick cell, but count. Chains go
        on, in the tiles where they help most, until their noise in T_app is about half of
        accuracy_K, or max_samples.
        """
        cells, scene, wanted = self._painter.cells, self._painter.scene, self._settings.accuracy_K
        count = len(pixels)
        sums = np.zeros((2, self._components, count))
        batches = np.zeros(count, np.int64)  # of either set
        tiles = self._tiles(pixels)
        chosen, pairs, batch = np.arange(count), 1, 0
        samples = max(_SAMPLES // across**2, 1)
        while True:
            for _ in range(pairs):
                for half in sums:
                    half[:, chosen] += self._means(batch, pixels[chosen], across, samples=samples)
                    batch += 1
            batches[chosen] += pairs
            means = sums / batches
            mean, difference = (means[0] + means[1]) / 2, (means[0] - means[1]) / 2
            # As if the walls were as bright as the hottest cell: the trace holds for all of them.
            kelvin = np.nan_to_num(
                error_K(seen + mean[:-1], difference[:-1], cells, scene, outside=cells.scale)
            )
            # In what a tile has of the sum of squares lies what it can gain.
            energy = np.bincount(tiles, kelvin**2)
            visible = max(int(np.count_nonzero(1 - (seen + mean[:-1])[0] > VISIBLE)) + other, 1)
            left = float(energy.sum()) / visible - (_NOISE * wanted) ** 2
            if left <= 0 or 2 * pairs * samples * across**2 > self._settings.max_samples:
                break
            cost = np.maximum(np.bincount(tiles, batches), 1)
            best = np.argsort(-energy / cost)
            enough = np.searchsorted(np.cumsum(energy[best]) / 2, left * visible) + 1
            chosen = np.flatnonzero(np.isin(tiles, best[:enough]))
            pairs = max(pairs, int(np.median(batches[chosen])))
        self.samples = int(2 * batches.mean() * samples * across**2)
        return means

    def _tiles(self, pixels: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) number of the tile of the picture that each pixel is in."""
        row, column = np.divmod(pixels, self._painter.view.pixels[0])
        tile = row // _TILE * self._painter.view.pixels[0] + column // _TILE
        return np.unique(tile, return_inverse=True)[1].astype(np.int64)

    @property
    def programs(self) -> list[Program]:
        """All that were built."""
        return [program for some in self._programs.values() for program in some]

    def _means(self, batch: int, pixels: NDArray[np.int64], across: int, *, samples: int) -> Floats:
        """(C + 1, N) mean of so many chains for each of across^2 rays a pixel."""
        parts = self._painter.parts
        if samples not in self._programs:
            defines = {**self._defines, "SAMPLES": samples}
            self._programs[samples] = [build(part.device, "gather.cl", defines) for part in parts]
        start = time.perf_counter()
        row, column = np.divmod(pixels, self._painter.view.pixels[0])
        place = (np.arange(across) + 0.5) / across
        down, right = np.meshgrid(place, place, indexing="ij")
        rays = np.stack(
            [column[:, None] + right.reshape(-1), row[:, None] + down.reshape(-1)], axis=2
        ).reshape(-1, 2)
        numbers = (pixels[:, None] * across**2 + np.arange(across**2)).reshape(-1)
        outs = []
        for part, program, fixed, (device, mine) in zip(
            parts, self._programs[samples], self._fixed, shares(self.device, len(rays)), strict=True
        ):
            count, group = len(mine), min(_GROUP, device.info.largest_group)
            out = zeros(device, "means", self._components * count, self._real)
            if count:
                some = slice(mine.start, mine.stop)
                program["gather"](
                    part.device.queue,
                    (-(-count // group) * group,),
                    (group,),
                    out,
                    upload(device, "rays", rays[some].astype(self._real)),
                    upload(device, "rays", numbers[some].astype(np.uint32)),
                    np.int32(count),
                    np.array([self._settings.seed, 0], np.uint32),
                    np.uint32(batch),
                    *fixed,
                )
                part.device.queue.flush()  # the next device starts while this one works
            outs.append(out)
        found = [
            download(device, out, np.empty((self._components, len(mine)), self._real))
            for out, (device, mine) in zip(outs, shares(self.device, len(rays)), strict=True)
            if mine
        ]
        self.seconds += time.perf_counter() - start
        whole = np.concatenate(found, axis=1).reshape(self._components, len(pixels), -1)
        return np.asarray(whole.mean(axis=2, dtype=np.float64))
