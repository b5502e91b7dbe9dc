"""Clouds and boxes in the finest cells of an octree: the host's side of kernels/deposit.cl."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.fixed_point import fixed_point_defines, fixed_point_scale
from cldit.gpu.program import Program, build
from cldit.medium.corners import BITS, Corners
from cldit.medium.frame import AT_ONCE, BRICK

REACH = 6.0**0.5  # half the width of a cloud's profile, in standard deviations
_LEAST = 1e-8  # in cells squared: variance of a point
FACE = 1e-6  # in cells: a box that reaches over a face by less does not touch the next cell
_LANES = 2**16  # work-items of few boxes
_SUMS_AT_ONCE = 2**19  # that are converted while they are in the cache
_Counts = NDArray[np.int32]
_SUM_BYTES = 2**30  # of the sums on the device; at least one kind is added at a time


@dataclass(frozen=True)
class Rasteriser(ABC):
    """Clouds or boxes on a device, in a cube of `cells` along an edge. marks, deposits: kernels."""

    device: Device
    program: Program
    cells: int
    marks: ClassVar[str]
    deposits: ClassVar[str]

    @abstractmethod
    def _lists(self) -> Iterator[tuple[NDArray[np.int64] | slice, dict[str, Any]]]:
        """Yields parts of the objects by number, and their kernels' arguments; `items`: size."""

    def mark(self, mark: Mask) -> None:
        """Sets the bricks (nb, nb, nb) that anything reaches."""
        reached = zeros(self.device, "bricks", mark.size, np.uint8)
        for _, lists in self._lists():
            self._launch(self.marks, lists, {"bricks": len(mark), "mark": reached})
        mark |= download(self.device, reached, np.empty(mark.shape, np.uint8)) > 0

    def add(
        self, directory: NDArray[np.int32], amounts: list[Floats], targets: list[Floats]
    ) -> None:
        """Adds every amount (N,), spread over its cloud or box, to its target (S,).

        directory: (nb, nb, nb), slot of each marked brick. The sums of an amount have a resolution
        of 2^-61 of its total.
        """
        size = len(targets[0]) if targets else 0
        step = max(1, _SUM_BYTES // (8 * max(size, 1)))
        for start in range(0, len(amounts), step):
            chosen = slice(start, start + step)
            self._add(directory, np.stack(amounts[chosen], axis=1), targets[chosen])

    def _add(self, directory: NDArray[np.int32], amount: Floats, targets: list[Floats]) -> None:
        kinds, size = len(targets), len(targets[0])
        scale = np.array([fixed_point_scale(total) for total in np.abs(amount).sum(axis=0)])
        units = (amount * scale).astype(self.program.real)
        sums = zeros(self.device, "deposited sums", size * kinds, np.int64)
        bricks = upload(self.device, "directory", directory)
        for chosen, lists in self._lists():
            arguments = {
                "bricks": len(directory),
                "directory": bricks,
                "units": upload(self.device, "amounts", units[chosen]),
                "kinds": kinds,
                "sums": sums,
            }
            self._launch(self.deposits, lists, arguments)
        rows = max(1, _SUMS_AT_ONCE // kinds)
        for begin in range(0, size, rows):
            part = np.empty((min(rows, size - begin), kinds), np.int64)
            download(self.device, sums, part, start=begin * kinds)
            for kind, target in enumerate(targets):
                target[begin : begin + rows] += part[:, kind] / scale[kind]

    def _launch(self, kernel: str, lists: dict[str, Any], arguments: dict[str, Any]) -> None:
        size = lists.pop("items")
        group = (1 if self.device.is_cpu else 64, *[1] * (len(size) - 1))
        self.program.launch(kernel, size, group, {**lists, **arguments})


def deposit_program(device: Device) -> Program:
    """Program of deposit.cl, in double precision where there is."""
    defines: dict[str, Any] = {"USE_FLOAT64": 1} if device.info.float64 else {}
    defines |= {"OWN_LAYERS": 1} if device.is_cpu else {}
    return build(device, "deposit.cl", defines | fixed_point_defines(device))


@dataclass(frozen=True)
class CloudRasteriser(Rasteriser):
    """Clouds.

    cell: (N, 4) int32, x, y, z of the cell around each. shape: (N, 9), see deposit.cl. first, last:
    (N,) lowest and highest layer, from the cloud's cell.
    """

    marks, deposits = "mark_bricks", "deposit"
    cell: NDArray[np.int32]
    shape: NDArray[np.floating]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    order: NDArray[np.int64]

    @classmethod
    def of(cls, device: Device, place: Floats, covariance: Floats, cells: int) -> CloudRasteriser:
        """Clouds (N) of places (N, 3; x, y, z) and covariances (N, 3, 3), in cells."""
        cell = np.floor(place).astype(np.int32)
        xx, yy, zz = (covariance[:, axis, axis] + _LEAST for axis in range(3))
        zx, zy, yx = covariance[:, 2, 0], covariance[:, 2, 1], covariance[:, 1, 0]
        y_on_z, x_on_z = zy / zz, zx / zz
        rest_y = np.maximum(yy - y_on_z * zy, _LEAST)
        x_on_y = (yx - y_on_z * zx) / rest_y
        rest_x = np.maximum(xx - x_on_z * zx - x_on_y**2 * rest_y, _LEAST)
        offset = place - cell
        shape = np.stack([*offset.T, zz, y_on_z, rest_y, x_on_z, x_on_y, rest_x], axis=1)
        reach = REACH * np.sqrt(zz)
        program = deposit_program(device)
        return cls(
            device=device,
            program=program,
            cell=np.concatenate([cell, np.zeros_like(cell[:, :1])], axis=1),
            shape=shape.astype(program.real),
            first=np.floor(offset[:, 2] - reach).astype(np.int32),
            last=np.floor(offset[:, 2] + reach).astype(np.int32),
            # Clouds of neighbouring cells one after the other: their sums stay in the cache.
            order=np.lexsort((cell[:, 0], cell[:, 1] // BRICK)),
            cells=cells,
        )

    def _lists(self) -> Iterator[tuple[NDArray[np.int64], dict[str, Any]]]:
        count = (self.last - self.first + 1)[self.order]
        for part in parts_of(count):
            chosen = self.order[part]
            yield chosen, self._listed(chosen, count[part])

    def _listed(self, chosen: NDArray[np.int64], count: NDArray[np.int32]) -> dict[str, Any]:
        number, layer = _layers(count, self.first[chosen])
        begins = np.arange(len(number) + 1, dtype=np.int32)
        if self.device.is_cpu:
            z = np.clip(layer + self.cell[chosen, 2][number], 0, self.cells - 1)
            by_z = np.argsort(z.astype(np.uint16), kind="stable")
            number, layer = number[by_z], layer[by_z]
            filled = np.bincount(z, minlength=self.cells)
            begins = np.append(0, np.cumsum(filled)).astype(np.int32)
        return {
            "items": (len(begins) - 1,),
            "zs": len(begins) - 1,
            "begins": upload(self.device, "layers", begins),
            "numbers": upload(self.device, "layers", number),
            "layers": upload(self.device, "layers", layer),
            "cells_of": upload(self.device, "clouds", self.cell[chosen]),
            "shapes": upload(self.device, "clouds", self.shape[chosen]),
            "cells": self.cells,
        }


@dataclass(frozen=True)
class BoxRasteriser(Rasteriser):
    """Boxes with corners in the cube. shared: as in `deposit.PlacedBoxes`."""

    marks, deposits = "mark_boxes", "deposit_boxes"
    corners: Corners
    shared: Ints | None = None

    def add(
        self, directory: NDArray[np.int32], amounts: list[Floats], targets: list[Floats]
    ) -> None:
        """Adds the sums of the amounts that share a box, like `Rasteriser.add`."""
        super().add(directory, summed(amounts, self.shared), targets)

    def _lists(self) -> Iterator[tuple[slice, dict[str, Any]]]:
        shift = BITS - self.cells.bit_length() + 1
        for part, corners in self.corners.on(self.device):
            boxes = part.stop - part.start
            # Layers of few boxes are shared out; where there are many, each work-item has a box.
            lanes = min(self.cells, max(1, _LANES // boxes))
            yield (
                part,
                {
                    "items": (boxes, lanes),
                    "boxes": boxes,
                    "corners": corners,
                    "shift": shift,
                    "slack": int(np.ceil(FACE * 2.0**shift)),
                    "cells": self.cells,
                },
            )


def summed(amounts: list[Floats], shared: Ints | None) -> list[Floats]:
    """Amounts of each box, of which `shared` (N,) has the first one; None: one amount a box."""
    return amounts if shared is None else [np.add.reduceat(amount, shared) for amount in amounts]


def parts_of(counts: NDArray[np.signedinteger]) -> Iterator[slice]:
    """Parts of objects with so many items (N,), each of at most `AT_ONCE` in all."""
    ends = np.cumsum(counts, dtype=np.int64)
    start = 0
    while start < len(counts):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + AT_ONCE, "right")))
        yield slice(start, stop)
        start = stop


def _layers(count: _Counts, begin: _Counts) -> tuple[_Counts, _Counts]:
    """Cloud and layer of each of their layers, `count` (N,) of them from `begin` (N,)."""
    number = np.repeat(np.arange(len(count), dtype=np.int32), count)
    layer = np.arange(len(number)) + np.repeat(begin - (np.cumsum(count) - count), count)
    return number, layer.astype(np.int32)
