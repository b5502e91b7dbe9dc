"""The picture of what thick cells scatter, by chains of scatterings among them.

In the sweeps a cell has one source. Where it is thick the source varies within it, and what it
sends back to where it is lit from is far more than its mean. Where a line of sight meets thick
cells, chains follow what these scatter, by the phase function itself, until they leave them for
cells whose light is known from the last sweep.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.closure import Closure
from cldit.transport.directions import Directions
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.picture import Painter
from cldit.transport.result import Settings
from cldit.transport.sobol import columns
from cldit.transport.thick import FACE, RimLight, ThickCells, nearest

Floats = NDArray[np.float64]

_SAMPLES = 32  # of a pixel and batch
_CLOSED = 2e-3  # single precision, and the cutoff
_LONGEST = 32  # scatterings of a chain, after which the light is that of the sweeps
_GROUP = 16


@dataclass(frozen=True)
class Half:
    """What one half of the last sweep left: its directions, and the light in them."""

    directions: Directions
    light: RimLight


class Gather:
    """Adds to pictures what thick cells scatter, batch by batch."""

    def __init__(
        self,
        painter: Painter,
        box: Box,
        thick: ThickCells,
        halves: list[Half],
        settings: Settings,
        defines: dict[str, Define],
        *,
        source: NDArray[np.floating],
        units: Floats,
    ) -> None:
        """source (C, N), units (C,): see `ThickCells.records`."""
        self._painter, self._settings = painter, settings
        self.device: Device = painter.parts[0].device
        cells = painter.cells
        self._real = painter.real
        self._components = len(cells.needs.components) + 1
        phase = settings.phase
        table, steps = np.zeros(1), np.zeros(1)
        self._defines: dict[str, Define] = {**defines, "LONGEST": _LONGEST, "FACE": FACE}
        if phase is not None:
            table, steps = phase.to_sample(), phase.by_half_sine(PHASE_STEPS)
            self._defines.update(PHASE_BINS=phase.bins, PHASE_STEPS=PHASE_STEPS)
        device, real = self.device, self._real
        if painter.gathered is None:
            raise ValueError("this painter leaves nothing to gather")
        low = np.array([*box.low, 0], np.int32)
        shape = np.array([*box.shape, 0], np.int32)
        medium = [
            painter.gathered[0],
            upload(device, "places", thick.places),
            upload(device, "thick cells", thick.records(cells, source, units).astype(real)),
        ]
        self._fixed = [
            upload(device, "phase function", table.astype(real)),
            upload(device, "phase function", steps.astype(real)),
            upload(device, "Sobol", columns()),
            *medium,
        ]
        self._halves = [
            [
                half.light.buffer,
                upload(device, "directions", self._shares(half.directions).astype(real)),
                upload(device, "directions", nearest(half.directions)),
                np.int32(half.light.rim),
                np.int32(len(half.directions)),
                low,
                shape,
            ]
            for half in halves
        ]
        self.programs: dict[int, Program] = {}

    def _shares(self, directions: Directions) -> Floats:
        """(K, 4) directions, and the share up to each in what is scattered along +y."""
        weight = directions.weight
        phase = self._settings.phase
        if phase is not None:
            steps = phase.by_half_sine(PHASE_STEPS)
            sine = np.sqrt((1 - directions.unit[:, 1]) / 2)
            weight = weight * steps[np.minimum((sine * PHASE_STEPS).astype(int), PHASE_STEPS - 1)]
        return np.column_stack([directions.unit, np.cumsum(weight) / weight.sum()])

    def __call__(
        self, half: int, pixels: NDArray[np.int64], scattered: Floats, across: int
    ) -> Floats:
        """Weights (C, N) for flat numbers of pixels, with across^2 rays through each.

        scattered (N,): what thick cells scatter there in all. Chains must make that, on average.

        Raises:
            TransportError: chains make or lose light.
        """
        columns_, _ = self._painter.view.pixels
        row, column = np.divmod(pixels, columns_)
        part = (np.arange(across) + 0.5) / across
        down, right = np.meshgrid(part, part, indexing="ij")
        places = np.stack(
            [column[:, None] + right.reshape(-1), row[:, None] + down.reshape(-1)], axis=2
        )
        samples = max(_SAMPLES // across**2, 1)
        batches = int(__import__("os").environ.get("BATCHES", "1"))
        total = sum(
            self._means(half, batch, places.reshape(-1, 2), samples=samples)
            for batch in range(batches)
        )
        means = np.asarray(total).reshape(len(total), len(pixels), -1).mean(axis=2) / batches
        boundaries = self._painter.cells.needs.boundaries
        Closure.of(
            (means[:boundaries] / scattered)[:, None],
            (means[-1] / scattered)[None],
            bound=_CLOSED,
            noisy=True,
        )
        return np.asarray(means[:-1])

    def _means(self, half: int, batch: int, places: Floats, *, samples: int) -> Floats:
        """(C + 1, N) mean of so many chains for each ray; places (N, 2): across and down."""
        if samples not in self.programs:
            defines = {**self._defines, "SAMPLES": samples}
            self.programs[samples] = build(self.device, "gather.cl", defines)
        device, count = self.device, len(places)
        group = min(_GROUP, device.info.largest_group)
        out = zeros(device, "means", self._components * count, self._real)
        part = self._painter.parts[0]
        self.programs[samples]["gather"](
            device.queue,
            (-(-count // group) * group,),
            (group,),
            out,
            upload(device, "rays", places.astype(self._real)),
            np.int32(count),
            np.array([self._settings.seed, half], np.uint32),
            np.uint32(batch),
            *self._fixed,
            *self._halves[half],
            *part.tree,
            *part.arguments,
        )
        found = np.empty((self._components, count), self._real)
        return download(device, out, found).astype(np.float64)
