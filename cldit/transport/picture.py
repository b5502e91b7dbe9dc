"""Pictures of a solved medium: rays from the camera, on one device or split between several."""

from __future__ import annotations

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
from cldit.transport.kelvin import steep
from cldit.transport.view import View, upload_tree

Floats = NDArray[np.float64]

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

    rays: a pixel, or `adaptive`. parts: one a device; every device holds all of the medium.
    """

    cells: OpticalCells
    view: View
    scene: Scene
    accuracy_K: float
    real: type[np.floating]
    parts: tuple[_Part, ...]

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
    ) -> Painter:
        """Builds the programs; raises as `trace`."""
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
        return cls(cells, view, scene, accuracy_K, real, tuple(parts))

    def pictures(
        self, listed: list[NDArray[np.floating] | None], defect: Floats
    ) -> tuple[list[Floats], int]:
        """Weights (C + 1, H, W), the part from within last (see closure.py), one picture for each
        source (C, N) of the scattering cells, and the number of pixels with more than one ray.

        listed: None where nothing scatters. defect (N,): of the mean radiance in a cavity of
        radiance 1.
        """
        columns, rows = self.view.pixels
        rays = self.scene.camera.rays_per_pixel
        planes = self.cells.source_planes(self.real)
        images: list[Floats] = []
        pixels = None if rays in (1, "adaptive") else np.arange(columns * rows)
        for source in listed:
            ready = self._sources(planes, source, defect)
            if pixels is None or rays == "adaptive":
                image = self._whole(ready)
            else:
                image = np.empty((len(self.cells.needs.components) + 1, rows, columns))
            if rays == "adaptive" and pixels is None:  # all of a run's pictures alike
                pixels = steep(image[:-1], self.cells, self.scene, accuracy_K=self.accuracy_K)
            if pixels is not None and len(pixels):
                image.reshape(len(image), -1)[:, pixels] = self._listed(ready, pixels)
            images.append(image)
        return images, 0 if pixels is None else len(pixels)

    def _sources(
        self, planes: NDArray[np.floating], listed: NDArray[np.floating] | None, defect: Floats
    ) -> list[list[Any]]:
        """Kernel arguments `source` and `isothermal` on each device; planes are overwritten."""
        arrays = [("source", planes)]
        if listed is not None:
            planes[:, self.cells.address] = listed
            within = np.ones(len(self.cells.depth), self.real)
            outside = listed[: self.cells.needs.boundaries].sum(axis=0, dtype=np.float64)
            within[self.cells.address] = 1.0 - outside + self.cells.albedo * defect
            arrays.append(("isothermal source", within))
        return [[upload(part.device, *array) for array in arrays] for part in self.parts]

    def _whole(self, ready: list[list[Any]]) -> Floats:
        """One ray through the middle of every pixel, each device its rows."""
        columns, rows = self.view.pixels
        components = len(self.cells.needs.components) + 1
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
        return image.astype(np.float64)

    def _listed(self, ready: list[list[Any]], pixels: NDArray[np.int64]) -> Floats:
        """Means (C + 1, N) of several rays through the listed pixels."""
        components = len(self.cells.needs.components) + 1
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
