"""Pictures of a solved medium: rays from the camera, on one device or split between several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.kelvin import steep
from cldit.transport.view import View, upload_tree

Floats = NDArray[np.float64]
Gathered = Callable[[int, NDArray[np.int64], Floats, int], Floats]

_ACROSS = {1: 1, 4: 2, 16: 4, 64: 8, "adaptive": 4}
_GROUP = 64


@dataclass(frozen=True)
class _Part:
    """One device, and the rows of the picture (first, number) that it makes."""

    device: Device
    program: Program
    rows: tuple[int, int]
    tree: list[Any]
    arguments: list[Any]


@dataclass(frozen=True)
class Painter:
    """Makes pictures of a medium with sources that are given.

    parts: one a device; every device holds all of the medium. thick: which of the scattering cells
    are left to be gathered; gathered: their albedo on each device.
    """

    cells: OpticalCells
    view: View
    scene: Scene
    accuracy_K: float
    real: type[np.floating]
    parts: tuple[_Part, ...]
    thick: NDArray[np.int64] | None
    gathered: list[Any] | None

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
    ) -> Painter:
        """Builds the programs; raises as `trace`."""
        if thick is not None:
            defines = {**defines, "GATHER": 1}
        real: type[np.floating] = np.float64 if "USE_FLOAT64" in defines else np.float32
        rays = scene.camera.rays_per_pixel
        if rays != 1:
            defines = {**defines, "RAYS_ACROSS": _ACROSS[rays]}
        devices = (device, *device.others)
        units = np.cumsum([0, *(one.info.compute_units for one in devices)])
        bounds = [round(view.pixels[1] * int(unit) / int(units[-1])) for unit in units]
        parts = [
            _Part(
                device=one,
                program=build(one, "image.cl", defines),
                rows=(first, last - first),
                tree=upload_tree(one, cells, real),
                arguments=view.arguments(one, cells, real),
            )
            for one, first, last in zip(devices, bounds[:-1], bounds[1:], strict=True)
        ]
        gathered = None
        if thick is not None:
            albedo = np.zeros(len(cells.depth), real)
            albedo[cells.address[thick]] = cells.albedo[thick]
            gathered = [upload(one, "albedo", albedo) for one in devices]
        return cls(cells, view, scene, accuracy_K, real, tuple(parts), thick, gathered)

    def pictures(
        self,
        listed: list[NDArray[np.floating] | None],
        defect: Floats,
        gather: Gathered | None = None,
    ) -> tuple[list[Floats], int]:
        """Weights (C + 1, H, W), the part from within last (see closure.py), one picture for each
        source (C, N) of the scattering cells, and the number of pixels with more than one ray.

        listed: None where nothing scatters. defect (N,): of the mean radiance in a cavity of
        radiance 1. gather: what thick cells scatter; given the picture's number, pixels (N,), what
        of their light is scattered so (N,), and rays across each, it returns weights (C, N) to add,
        whose own sum it has looked after. Needed if `thick` was given.
        """
        columns, rows = self.view.pixels
        rays = self.scene.camera.rays_per_pixel
        planes = self.cells.source_planes(self.real)
        images: list[Floats] = []
        every = np.arange(columns * rows)
        pixels = None if rays in (1, "adaptive") else every
        for number, source in enumerate(listed):
            ready = self._sources(planes, source, defect)

            def finished(
                found: Floats, among: NDArray[np.int64], across: int, number: int = number
            ) -> Floats:
                if gather is None:
                    return found
                left = found[-2]
                outside = slice(self.cells.needs.boundaries)
                closed = found[outside].sum(axis=0) + found[-1] + left
                found = np.delete(found, -2, axis=0)
                here = np.flatnonzero(left)
                if len(here):
                    found[:-1, here] += gather(number, among[here], left[here], across)
                found[-1] = closed - found[outside].sum(axis=0)
                return found

            if pixels is None or rays == "adaptive":
                image = finished(self._whole(ready), every, 1)
            else:
                image = np.empty((len(self.cells.needs.components) + 1, columns * rows))
            if rays == "adaptive" and pixels is None:  # all of a run's pictures alike
                whole = image[:-1].reshape(-1, rows, columns)
                pixels = steep(whole, self.cells, self.scene, accuracy_K=self.accuracy_K)
            if pixels is not None and len(pixels):
                image[:, pixels] = finished(self._listed(ready, pixels), pixels, _ACROSS[rays])
            images.append(image.reshape(-1, rows, columns))
        return images, 0 if pixels is None else len(pixels)

    @property
    def _planes(self) -> int:
        """Of a picture as kernels make it."""
        return len(self.cells.needs.components) + (1 if self.gathered is None else 2)

    def _sources(
        self, planes: NDArray[np.floating], listed: NDArray[np.floating] | None, defect: Floats
    ) -> list[list[Any]]:
        """Kernel arguments `source` to `albedo` on each device; planes are overwritten."""
        arrays = [("source", planes)]
        if listed is not None:
            planes[:, self.cells.address] = listed
            within = np.ones(len(self.cells.depth), self.real)
            outside = listed[: self.cells.needs.boundaries].sum(axis=0, dtype=np.float64)
            within[self.cells.address] = 1.0 - outside + self.cells.albedo * defect
            if self.thick is not None:  # these only emit
                at = self.cells.address[self.thick]
                planes[:, at] = self.cells.source_planes(self.real)[:, at]
                within[at] = self.cells.coalbedo[self.thick]
            arrays.append(("isothermal source", within))
        ready = [[upload(part.device, *array) for array in arrays] for part in self.parts]
        if self.gathered is not None:
            ready = [[*some, one] for some, one in zip(ready, self.gathered, strict=True)]
        return ready

    def _whole(self, ready: list[list[Any]]) -> Floats:
        """One ray through the middle of every pixel (planes, H W), each device its rows."""
        columns, rows = self.view.pixels
        components = self._planes
        outs = []
        for part, sources in zip(self.parts, ready, strict=True):
            out = zeros(part.device, "picture", components * rows * columns, self.real)
            first, count = part.rows
            if count:
                (across, _), tile = self.view.tiles(part.device)
                part.program["image"](
                    part.device.queue,
                    (across, -(-count // tile[1]) * tile[1]),
                    tile,
                    out,
                    *part.tree,
                    *sources,
                    *part.arguments,
                    global_offset=(0, first),
                )
                part.device.queue.flush()  # the next device starts while this one works
            outs.append(out)
        image = np.empty((components, rows, columns), self.real)
        for part, out in zip(self.parts, outs, strict=True):
            first, count = part.rows
            image[:, first : first + count] = download(part.device, out, np.empty_like(image))[
                :, first : first + count
            ]
        return image.reshape(components, -1).astype(np.float64)

    def _listed(self, ready: list[list[Any]], pixels: NDArray[np.int64]) -> Floats:
        """Means (planes, N) of several rays through the listed pixels."""
        components = self._planes
        units = np.cumsum([0, *(part.device.info.compute_units for part in self.parts)])
        bounds = [round(len(pixels) * int(unit) / int(units[-1])) for unit in units]
        outs = []
        for part, sources, first, last in zip(
            self.parts, ready, bounds[:-1], bounds[1:], strict=True
        ):
            count, group = last - first, min(_GROUP, part.device.info.largest_group)
            out = zeros(part.device, "picture", components * count, self.real)
            if count:
                part.program["refine"](
                    part.device.queue,
                    (-(-count // group) * group,),
                    (group,),
                    out,
                    upload(part.device, "pixels", pixels[first:last].astype(np.int32)),
                    np.int32(count),
                    *part.tree,
                    *sources,
                    *part.arguments,
                )
                part.device.queue.flush()
            outs.append((out, count))
        means = [
            download(part.device, out, np.empty((components, count), self.real))
            for part, (out, count) in zip(self.parts, outs, strict=True)
            if count
        ]
        return np.concatenate(means, axis=1).astype(np.float64)
