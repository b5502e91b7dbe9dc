"""Formal solution of the equation of transfer along lines of sight: images (stage 4).

One ray a pixel, or several, by octree traversal (kernels/image.cl), on one device or several.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, unset, upload
from cldit.gpu.device import Device, shares
from cldit.gpu.program import Define, Program, build
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.scene.schema import Scene
from cldit.transport.cell_records import CellRecords
from cldit.transport.cells import OpticalCells
from cldit.transport.view import View, upload_directory

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]  # of the device's precision
# Maps pixels (N,), rays across each, their weights so far (C, N), and the number of other pixels
# that have a T_app to the terms to add to each image, (images, C + 1, N).
Gathered = Callable[[NDArray[np.int64], int, Reals, int], Floats]

RAYS_ACROSS = {1: 1, 4: 2, 16: 4, 64: 8, "adaptive": 4}  # by `camera.rays_per_pixel`
_GROUP = 64


@dataclass(frozen=True)
class _DeviceRows:
    """A device and the rows of the image that it computes."""

    device: Device
    program: Program
    rows: range
    arguments: dict[str, Any]  # of either kernel: the octree and the geometry


@dataclass(frozen=True)
class FormalSolution:
    """Computes images of a medium with given sources.

    accuracy_K: largest allowed error of T_app of a pixel, with adaptive rays.
    real: the device's precision.
    parts: one for each device; every device has the whole medium.
    at_once: images that share one traversal.
    thick: (T,) the scattering cells left to the final gather; None: no gather.
    """

    cells: OpticalCells
    view: View
    scene: Scene
    accuracy_K: float
    real: type[np.floating]
    cell_records: CellRecords
    parts: tuple[_DeviceRows, ...]
    at_once: int
    thick: NDArray[np.int64] | None

    @classmethod
    def of(
        cls,
        cells: OpticalCells,
        view: View,
        scene: Scene,
        device: Device,
        defines: dict[str, Define],
        *,
        accuracy_K: float,
        thick: NDArray[np.int64] | None = None,
        at_once: int = 1,
        linear: bool = False,
    ) -> FormalSolution:
        """Builds the programs and uploads the octree.

        Arguments as in the class; `defines` are the kernels', and with `linear` sources have
        spatial gradients.
        """
        defines = {**defines, "IMAGES": at_once}
        if thick is not None:
            defines["GATHER"] = 1
        if linear or "LINEAR_COEFFICIENTS" in defines:
            defines["LINEAR_SOURCE"] = 1
        real: type[np.floating] = np.float64 if "USE_FLOAT64" in defines else np.float32
        cell_records = CellRecords.of(cells, linear="LINEAR_COEFFICIENTS" in defines)
        parts = [
            _DeviceRows(
                device=one,
                program=build(one, "image.cl", defines),
                rows=rows,
                arguments={
                    **upload_directory(one, cells),
                    "number": upload(one, "records' numbers", cell_records.number),
                    **view.geometry(one, cells, real),
                },
            )
            for one, rows in shares(device, view.pixels[1])
        ]
        return cls(cells, view, scene, accuracy_K, real, cell_records, tuple(parts), at_once, thick)

    def images(
        self,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        gather: Gathered | None = None,
        *,
        gradient: NDArray[np.floating] | None = None,
        pixels: NDArray[np.int64] | None = None,
    ) -> tuple[list[Reals], list[Reals], int]:
        """Images of sources.

        Args:
            listed: `at_once` sources (C, N) of the scattering cells; None if nothing scatters.
            defect: (N,) error of the mean radiance in a cavity of radiance 1.
            gather: adds the light scattered by thick cells; needed with `thick`.
            gradient: (3, C, N) spatial gradient of all sources; needed with `linear`.
            pixels: (M,) flat numbers of the pixels to trace, as images of one row; not with
                adaptive rays, which need the whole image to find steep pixels. None: all.

        Returns:
            Weights (C + 1, H, W) of each image, the part from within the medium last (see
            energy_balance.py); with several rays a pixel, the same by one ray through the middle
            of every pixel; and the number of pixels of several rays.
        """
        columns, rows = self.view.pixels
        rays = self.scene.camera.rays_per_pixel
        records = self._records(listed, defect, gradient)
        if pixels is not None:
            some = self._several(records, pixels, RAYS_ACROSS[rays], gather)
            return list(some[:, :, None, :]), [], 0 if rays == 1 else len(pixels)
        every = np.arange(columns * rows)
        finer = np.empty(0, np.int64) if rays == 1 else every
        images, left = self._images(self._whole(records))
        self._gather(images, left, every, 1, gather)
        middle = [] if rays == 1 else list(images.copy().reshape(*images.shape[:2], rows, columns))
        if rays == "adaptive":  # the same pixels for all images
            whole = images[0, :-1].reshape(-1, rows, columns)
            finer = pixels_to_refine(
                whole, self.cells.temperature(self.scene), accuracy_K=self.accuracy_K
            )
        if len(finer):
            images[:, :, finer] = self._several(records, finer, RAYS_ACROSS[rays], gather)
        planes = list(images.reshape(*images.shape[:2], rows, columns))
        return planes, middle, len(finer)

    def several(
        self,
        pixels: NDArray[np.int64],
        across: int,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        gather: Gathered | None = None,
        *,
        gradient: NDArray[np.floating] | None = None,
    ) -> Reals:
        """Mean weights (images, C + 1, N) of `across`^2 rays through each of the `pixels` (N,).

        The other arguments are those of `images`.
        """
        return self._several(self._records(listed, defect, gradient), pixels, across, gather)

    def _several(
        self,
        records: list[dict[str, Any]],
        pixels: NDArray[np.int64],
        across: int,
        gather: Gathered | None,
    ) -> Reals:
        several, left = self._images(self._listed(records, pixels, across))
        self._gather(several, left, pixels, across, gather)
        return several

    def _records(
        self,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        gradient: NDArray[np.floating] | None,
    ) -> list[dict[str, Any]]:
        """Kernel arguments of the cells' sources, for each device."""
        table = None
        if self.cell_records.linear:
            listed, table = self.cell_records.linear_sources(listed, gradient, self.thick)
        elif gradient is not None:
            table = gradient.reshape(-1, gradient.shape[2]).T
        made = self.cell_records.records(listed, defect, self.thick, self.real)
        records = [{"records": upload(part.device, "records", made)} for part in self.parts]
        if table is None:
            return records
        table = np.ascontiguousarray(table, self.real)
        if self.thick is not None and not self.cell_records.linear:
            table[self.thick] = 0.0
        for part, some in zip(self.parts, records, strict=True):
            some["gradient"] = upload(part.device, "gradient", table)
            some["scattering"] = len(table)
        return records

    def _images(self, planes: Reals) -> tuple[Reals, NDArray[np.int64]]:
        """Splits the kernel's planes (P, N) into images (images, C + 1, N) and pixels to gather."""
        parts = len(self.cells.needs.components) + 1
        left = np.flatnonzero(planes[-1]) if self.thick is not None else np.zeros(0, np.int64)
        return planes[: self.at_once * parts].reshape(self.at_once, parts, -1), left

    def _gather(
        self,
        images: Reals,
        left: NDArray[np.int64],
        pixels: NDArray[np.int64],
        across: int,
        gather: Gathered | None,
    ) -> None:
        """Adds the final gather of the pixels `left` to their images."""
        if gather is None or not len(left):
            return
        seen = images[:, :-1, left].mean(axis=0)
        counts = self.view.has_temperature(1 - images[0, 0], pixels)
        other = int(np.count_nonzero(counts) - np.count_nonzero(counts[left]))
        images[:, :, left] += gather(pixels[left], across, seen, other)

    @property
    def _planes(self) -> int:
        """Number of the kernel's planes: those of all images, and the mark of pixels to gather."""
        parts = len(self.cells.needs.components) + 1
        return self.at_once * parts + (0 if self.thick is None else 1)

    def _whole(self, records: list[dict[str, Any]]) -> Reals:
        """Planes (P, H W) of one ray through the middle of every pixel, each device its rows."""
        columns, rows = self.view.pixels
        outs = []
        for part, some in zip(self.parts, records, strict=True):
            out = unset(part.device, "image", self._planes * rows * columns, self.real)
            if part.rows:
                part.program.launch(
                    "image",
                    *self.view.tiles(part.program, "image", len(part.rows)),
                    {
                        "planes": out,
                        **some,
                        **part.arguments,
                    },
                    offset=(0, part.rows.start),
                )
                part.device.queue.flush()  # the next device starts while this one works
            outs.append(out)
        planes = np.empty((self._planes, rows * columns), self.real)
        for part, out in zip(self.parts, outs, strict=True):
            mine = slice(part.rows.start * columns, part.rows.stop * columns)
            for number, plane in enumerate(planes):
                first = number * plane.size + mine.start
                download(part.device, out, plane[mine], first=first)
        return planes

    def _listed(
        self, records: list[dict[str, Any]], pixels: NDArray[np.int64], across: int
    ) -> Reals:
        """Planes (P, N): means of across^2 rays through each of the listed pixels."""
        outs = []
        divided = shares(self.parts[0].device, len(pixels))
        for part, some, (_, mine) in zip(self.parts, records, divided, strict=True):
            count = len(mine)
            out = unset(part.device, "image", self._planes * count, self.real)
            if count:
                some_pixels = pixels[mine.start : mine.stop].astype(np.int32)
                part.program.launch(
                    "refine",
                    (count,),
                    (min(_GROUP, part.program.largest_group("refine")),),
                    {
                        "planes": out,
                        "list": upload(part.device, "pixels", some_pixels),
                        "count": count,
                        "rays_across": across,
                        **some,
                        **part.arguments,
                    },
                )
                part.device.queue.flush()
            outs.append((out, count))
        means = [
            download(part.device, out, np.empty((self._planes, count), self.real))
            for part, (out, count) in zip(self.parts, outs, strict=True)
            if count
        ]
        return np.concatenate(means, axis=1)


def pixels_to_refine(
    image: NDArray[np.floating], temperature: TraceTemperature, *, accuracy_K: float
) -> NDArray[np.int64]:
    """Flat numbers (N,) of pixels that one ray does not represent, and of their neighbours.

    A ray through the middle misses the mean over a pixel by a 24th of the second difference where
    the image is smooth, and by up to half of it at an edge. A quarter is taken here, both in T_app
    and in the brightness temperature in front of the median background.

    Args:
        image: (C, H, W) weights from one ray a pixel.
        temperature: converts errors of the weights.
        accuracy_K: largest error to leave.
    """
    _, rows, columns = image.shape
    marked = np.zeros((rows, columns), bool)
    for axis in (1, 2):
        if image.shape[axis] < 3:
            continue
        missing = np.zeros_like(image)
        inner = [slice(None)] * 3
        inner[axis] = slice(1, -1)
        missing[tuple(inner)] = np.diff(image, n=2, axis=axis) / 4
        curved = np.flatnonzero(np.max(np.abs(missing), axis=0) > 1e-5)
        there, missed = (part.reshape(len(part), -1)[:, curved] for part in (image, missing))
        apparent_K = np.nan_to_num(np.abs(temperature.error_K(there, missed)))
        missed_K = np.abs(temperature.brightness_error_K(there, missed))
        marked.flat[curved[np.maximum(apparent_K, missed_K) > accuracy_K]] = True
    wide = marked.copy()
    for axis in (0, 1):
        one = wide.copy()
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        wide[tuple(ahead)] |= one[tuple(behind)]
        wide[tuple(behind)] |= one[tuple(ahead)]
    return np.flatnonzero(wide)
