"""Formal solution of the equation of transfer along lines of sight: images (stage 4).

One ray a pixel, or several, by octree traversal (kernels/image.cl), on one device or several.
`FormalSolution` has the medium, and `Rays` also its sources.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.gpu.program import GROUP, Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cell_records import CellRecords
from cldit.transport.cells import OpticalCells
from cldit.transport.divided_planes import divided_planes
from cldit.transport.linear_coefficients import device_cells
from cldit.transport.view import View


@dataclass(frozen=True)
class ThickPixels:
    """Pixels that see thick cells, with equal numbers of rays.

    pixels: (N,) flat numbers. across: across^2 rays go through each. seen: (C, N) weights of the
    rest of the image. other_visible: number of pixels with a T_app that see no thick cell.
    """

    pixels: Ints
    across: int
    seen: Reals
    other_visible: int


class Gathered(Protocol):
    """Adds the light that thick cells scatter."""

    def __call__(self, groups: Sequence[ThickPixels], /) -> list[Floats]:
        """Terms to add to each image, (images, C + 1, N), of the pixels of each group."""

    def affords(self, rays: int, /) -> bool:
        """True if the scatterings that an image may have suffice for so many more rays."""


@dataclass(frozen=True)
class FormalSolution:
    """Computes images of a medium with given sources.

    real: the device's precision.
    programs, arguments: of each device, which all have the whole medium: octree and geometry.
    at_once: images that share one traversal.
    thick: (T,) the scattering cells left to the final gather; None: no gather.
    spatial: sources have spatial gradients.
    """

    cells: OpticalCells
    view: View
    scene: Scene
    real: type[np.floating]
    cell_records: CellRecords
    programs: tuple[Program, ...]
    arguments: tuple[dict[str, Any], ...]
    at_once: int
    thick: Ints | None
    spatial: bool

    @classmethod
    def of(
        cls,
        cells: OpticalCells,
        view: View,
        scene: Scene,
        device: Device,
        defines: dict[str, Define],
        *,
        cutoff: float,
        thick: Ints | None = None,
        at_once: int = 1,
        linear: bool = False,
    ) -> "FormalSolution":
        """Builds the programs and uploads the octree.

        Arguments as in the class; `defines` are the kernels', rays end at the transmission
        `cutoff`, and with `linear` sources have spatial gradients.
        """
        defines = {**defines, "IMAGES": at_once}
        if thick is not None:
            defines["GATHER"] = 1
        if linear or "LINEAR_COEFFICIENTS" in defines:
            defines["LINEAR_SOURCE"] = 1
        real: type[np.floating] = np.float64 if "USE_FLOAT64" in defines else np.float32
        cell_records = CellRecords.of(cells)
        linear_coefficients = "LINEAR_COEFFICIENTS" in defines
        members = (device, *device.others)
        arguments = [
            {
                **{name: octree[name] for name in ("directory", "span")},
                "number": upload(member, "records' numbers", cell_records.number),
                **view.geometry(member, cells, real),
                "cutoff": cutoff,
            }
            for member in members
            for octree in [device_cells(member, cells, real, linear=linear_coefficients)]
        ]
        return cls(
            cells=cells,
            view=view,
            scene=scene,
            real=real,
            cell_records=cell_records,
            programs=tuple(build(member, "image.cl", defines) for member in members),
            arguments=tuple(arguments),
            at_once=at_once,
            thick=thick,
            spatial=linear,
        )

    def with_sources(
        self,
        listed: list[Reals],
        defect: Floats,
        gather: Gathered | None = None,
        *,
        known: tuple[Ints, Reals] | None = None,
    ) -> "Rays":
        """Uploads sources, for which rays can then be traced.

        Args:
            listed: `at_once` sources (C, N) of the scattering cells; empty if nothing scatters.
            defect: (N,) error of the mean radiance in a cavity of radiance 1.
            gather: adds the light scattered by thick cells; needed with `thick`.
            known: cells (K,) and the spatial gradient (3, C, K) of the radiance in them, which
                precedes that from neighbours.
        """
        records = [
            self.cell_records.upload(
                program,
                arguments["number"],
                listed,
                defect,
                spatial=self.spatial,
                thick=self.thick,
                known=known,
            )
            for program, arguments in zip(self.programs, self.arguments, strict=True)
        ]
        return Rays(self, records, gather)


@dataclass(frozen=True)
class Rays:
    """Rays through a medium with sources, as many for each pixel as are asked for.

    solution: the medium. records: kernel arguments of the cells' sources, for each device. gather:
    adds the light scattered by thick cells; None: there is none.
    """

    solution: FormalSolution
    records: list[dict[str, Any]]
    gather: Gathered | None

    def middle(self) -> Reals:
        """Weights (images, C + 1, H W) by one ray through the middle of every pixel.

        The part from within the medium is the last (see energy_balance.py).
        """
        columns, rows = self.solution.view.pixels
        pixel_numbers = np.arange(columns * rows)
        return self.through(pixel_numbers, np.ones_like(pixel_numbers))

    def through(self, pixels: Ints, across: Ints) -> Reals:
        """Mean weights (images, C + 1, N) of `across`^2 (N,) rays through each of `pixels` (N,)."""
        # Work-items of a group do equal work, and cross the same cells.
        order = np.lexsort((self.solution.view.tile_of(pixels), across))
        planes = self._through(pixels[order], *self.solution.view.rays(across[order]))
        return self._gathered(planes[:, np.argsort(order)], pixels, across)

    def affords(self, rays: int) -> bool:
        """True if paths in thick cells allow so many more rays."""
        return self.gather is None or self.gather.affords(rays)

    def _gathered(self, planes: Reals, pixels: Ints, across: Ints) -> Reals:
        """Images (images, C + 1, N) of the kernel's planes (P, N), and what thick cells scatter.

        Pixels with equal numbers of rays share the limits of their paths.
        """
        solution = self.solution
        parts = len(solution.cells.needs.components) + 1
        images = planes[: solution.at_once * parts].reshape(solution.at_once, parts, -1)
        if solution.thick is None or self.gather is None:
            return images
        counts = solution.view.has_temperature(1 - images[0, 0], pixels)
        places, groups = [], []
        for number in np.unique(across[planes[-1] != 0]):
            same_rays = across == number
            gathered = np.flatnonzero(same_rays & (planes[-1] != 0))
            seen = images[:, :-1, gathered].mean(axis=0)
            other_count = int(
                np.count_nonzero(counts[same_rays]) - np.count_nonzero(counts[gathered])
            )
            places.append(gathered)
            groups.append(ThickPixels(pixels[gathered], int(number), seen, other_count))
        if groups:
            for gathered, terms in zip(places, self.gather(groups), strict=True):
                images[:, :, gathered] += terms
        return images

    @property
    def _planes(self) -> int:
        """Number of the kernel's planes: those of all images, and the mark of pixels to gather."""
        parts = len(self.solution.cells.needs.components) + 1
        return self.solution.at_once * parts + (0 if self.solution.thick is None else 1)

    @property
    def _most_pixels(self) -> int:
        """Number of pixels whose planes fit into one buffer of every device."""
        solution = self.solution
        smallest = min(program.device.info.largest_buffer_bytes for program in solution.programs)
        return max(1, int(smallest // (self._planes * np.dtype(solution.real).itemsize)))

    def _through(self, pixels: Ints, places: Floats, ranges: NDArray[np.int32]) -> Reals:
        """Planes (P, N): means of rays through each of the listed pixels, by `View.rays`."""
        step = self._most_pixels
        parts = [
            self._at_once(pixels[start : start + step], places, ranges[start : start + step])
            for start in range(0, len(pixels), step)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def _at_once(self, pixels: Ints, places: Floats, ranges: NDArray[np.int32]) -> Reals:
        """The same of as many pixels as fit into one buffer; each device has its share of them."""
        solution = self.solution

        def launch(number: int, listed: slice, out: Any) -> None:
            program, count = solution.programs[number], listed.stop - listed.start
            program.launch(
                "image",
                (count,),
                (min(GROUP, program.largest_group("image")),),
                {
                    "planes": out,
                    "list": upload(program.device, "pixels", pixels[listed].astype(np.int32)),
                    "count": count,
                    "places": upload(program.device, "rays", places.astype(solution.real)),
                    "ranges": upload(program.device, "rays", ranges[listed]),
                    **self.records[number],
                    **solution.arguments[number],
                },
            )

        shape = self._planes, len(pixels)
        return divided_planes(solution.programs[0].device, "image", shape, solution.real, launch)
