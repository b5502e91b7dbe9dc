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
from cldit.gpu.share import shares
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.kelvin import VISIBLE, steep
from cldit.transport.view import View, upload_tree

Floats = NDArray[np.float64]
# From pixels (N,), rays across each, what else they see (C, N), and the number of other pixels that
# count: what to add to each picture, (pictures, C + 1, N).
Gathered = Callable[[NDArray[np.int64], int, Floats, int], Floats]

_ACROSS = {1: 1, 4: 2, 16: 4, 64: 8, "adaptive": 4}
_GROUP = 64


@dataclass(frozen=True)
class _Part:
    """One device, and the rows of the picture that it makes."""

    device: Device
    program: Program
    rows: range
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
        parts = [
            _Part(
                device=one,
                program=build(one, "image.cl", defines),
                rows=rows,
                tree=upload_tree(one, cells, real),
                arguments=view.arguments(one, cells, real),
            )
            for one, rows in shares(device, view.pixels[1])
        ]
        gathered = None
        if thick is not None:
            albedo = np.zeros(len(cells.depth), real)
            albedo[cells.address[thick]] = cells.albedo[thick]
            gathered = [upload(one, "albedo", albedo) for one in (device, *device.others)]
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
        radiance 1. gather: adds what thick cells scatter; needed if `thick` was given.
        """
        columns, rows = self.view.pixels
        rays = self.scene.camera.rays_per_pixel
        empty = self.cells.source_planes(self.real)
        sources = [self._sources(empty, source, defect) for source in listed]
        every = np.arange(columns * rows)
        pixels = None if rays in (1, "adaptive") else every
        images = [np.empty((0, 0))] * len(listed)
        if rays in (1, "adaptive"):
            images = self._gathered([self._whole(some) for some in sources], every, 1, gather)
        if rays == "adaptive":  # all of a run's pictures alike
            whole = images[0][:-1].reshape(-1, rows, columns)
            pixels = steep(whole, self.cells, self.scene, accuracy_K=self.accuracy_K)
        if pixels is not None and len(pixels):
            several = self._gathered(
                [self._listed(some, pixels) for some in sources], pixels, _ACROSS[rays], gather
            )
            if len(pixels) == len(every):
                images = several
            else:
                for image, part in zip(images, several, strict=True):
                    image[:, pixels] = part
        planes = [image.reshape(-1, rows, columns) for image in images]
        return planes, 0 if pixels is None else len(pixels)

    def _gathered(
        self,
        images: list[Floats],
        pixels: NDArray[np.int64],
        across: int,
        gather: Gathered | None,
    ) -> list[Floats]:
        """Pictures (C + 1, N), from planes as kernels make them, of listed pixels."""
        if gather is None:
            return images
        left = images[0][-2]
        here = np.flatnonzero(left)
        images = [np.delete(image, -2, axis=0) for image in images]
        if len(here):
            seen = np.mean([image[:-1, here] for image in images], axis=0)
            other = int(np.count_nonzero(1 - np.delete(images[0][0], here) > VISIBLE))
            for image, more in zip(images, gather(pixels[here], across, seen, other), strict=True):
                image[:, here] += more
        return images

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
            address = self.cells.address
            scatters = np.ones(len(address), np.bool_)
            if self.thick is not None:
                scatters[self.thick] = False  # these only emit
            planes[:, address[scatters]] = listed[:, scatters]
            within = np.ones(len(self.cells.depth), self.real)
            outside = listed[: self.cells.needs.boundaries].sum(axis=0, dtype=np.float64)
            within[address] = 1.0 - outside + self.cells.albedo * defect
            if self.thick is not None:
                # What the sweeps lose would be missing in the light that chains end in.
                lost = self.cells.albedo * defect
                within[address[self.thick]] = (self.cells.coalbedo + lost)[self.thick]
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
            if part.rows:
                part.program["image"](
                    part.device.queue,
                    *self.view.tiles(part.device, len(part.rows)),
                    out,
                    *part.tree,
                    *sources,
                    *part.arguments,
                    global_offset=(0, part.rows.start),
                )
                part.device.queue.flush()  # the next device starts while this one works
            outs.append(out)
        image = np.empty((components, rows, columns), self.real)
        for part, out in zip(self.parts, outs, strict=True):
            mine = slice(part.rows.start, part.rows.stop)
            if len(part.rows) == rows:
                download(part.device, out, image)
            else:
                image[:, mine] = download(part.device, out, np.empty_like(image))[:, mine]
        return image.reshape(components, -1).astype(np.float64)

    def _listed(self, ready: list[list[Any]], pixels: NDArray[np.int64]) -> Floats:
        """Means (planes, N) of several rays through the listed pixels."""
        components = self._planes
        outs = []
        divided = shares(self.parts[0].device, len(pixels))
        for part, sources, (_, mine) in zip(self.parts, ready, divided, strict=True):
            count, group = len(mine), min(_GROUP, part.device.info.largest_group)
            out = zeros(part.device, "picture", components * count, self.real)
            if count:
                part.program["refine"](
                    part.device.queue,
                    (-(-count // group) * group,),
                    (group,),
                    out,
                    upload(part.device, "pixels", pixels[mine.start : mine.stop].astype(np.int32)),
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
