"""Traces of variants of a medium at one wavelength, and the difference of their results.

All variants are traced with the same ordinates, whose errors partly cancel in a difference; the
rest is separated by independent halves (`cldit.accuracy.image_pair`). Of a large image every n-th
pixel of every n-th row is traced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.resolution import lattice_depth
from cldit.accuracy.trace_error import TraceError
from cldit.arrays import Ints
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.frame import Cube
from cldit.medium.octree import Sources, build_octree
from cldit.medium.resolution import counted, on_grid
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import Prepared
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray
from cldit.transport.cells import OpticalCells
from cldit.transport.trace import Trace, TraceSettings, trace
from cldit.transport.trace_cost import TraceCost
from cldit.transport.view import View

_Scalar = TypeVar("_Scalar", bound=np.generic)
# Ratio of cell sizes between images that an error is extrapolated from: below, its first order is
# more than three times a difference, and above, the coarser image misses what the finer one has.
_LEAST, _MOST = 1.5 - 1e-6, 3.0
# Pixels of an image of which all are traced, 300 x 300: if the medium fills a tenth of the image,
# and most of a difference is in a hundredth of that, then 90 pixels know its RMS to a tenth.
_MOST_PIXELS = 90_000
# A coarser lattice does not resolve the plumes, reaches out of the domain, or behind a patch.
NO_COARSER_LATTICE = (SprayError, MediumError, TransportError)


@dataclass(frozen=True)
class VariantTracer:
    """Traces variants of a prepared medium, from which errors are estimated.

    stride: step between traced pixels, in both directions. temperature: T_app of these pixels.
    key: all that the images depend on, except the lattice. levels: images of the medium itself by
    edge of the finest cells, of a cone on that lattice. traces: likewise, where all pixels were
    traced. variants: other images by name and cells. costs: of the coarse traces. predicted:
    estimates made before the first image, by name. estimates: by source, each made once.

    cell_m: edge of the cells that errors are estimated for; coarse_m: of those on which errors are
    estimated that do not depend on the cells. image: of the run at this wavelength; None before it
    is traced. exact: True if it has no error that `path` would not see. trace_errors: its own;
    empty if nothing scatters.
    """

    prepared: Prepared
    settings: TraceSettings
    stride: int
    temperature: NodeTemperature
    key: Any = None
    levels: dict[float, ImagePair] = field(default_factory=dict)
    traces: dict[float, Trace] = field(default_factory=dict)
    variants: dict[tuple[str, float], ImagePair] = field(default_factory=dict)
    costs: list[TraceCost] = field(default_factory=list)
    predicted: dict[str, Estimate] = field(default_factory=dict)
    estimates: dict[str, Sequence[Estimate]] = field(default_factory=dict)
    cell_m: float = 0.0
    coarse_m: float = 0.0
    image: ImagePair | None = None
    exact: bool = False
    trace_errors: Sequence[TraceError] = ()

    @classmethod
    def of(
        cls,
        prepared: Prepared,
        settings: TraceSettings,
        key: Any = None,
        previous: VariantTracer | None = None,
    ) -> VariantTracer:
        """A tracer for a medium with the `settings` of its wavelength `prepared.node`.

        Costs and predictions of `previous` are kept, its images if its `key` is the same, and its
        estimates if its medium is.
        """
        own_settings = replace(settings, method="source", audit=False, subpixels=False)
        temperature = temperature_of(prepared, visible=own_settings.visible)
        stride = math.ceil((math.prod(prepared.scene.camera.pixels) / _MOST_PIXELS) ** 0.5)
        if stride > 1:
            own_settings = replace(own_settings, rays_K=None)  # which depend on the whole image
        tracer = cls(
            prepared=prepared,
            settings=replace(own_settings, subpixels=stride == 1 and own_settings.rays_K is None),
            stride=stride,
            temperature=replace(
                temperature, sees_background=_picked(temperature.sees_background, stride)
            ),
            key=key,
        )
        if previous is None:
            return tracer
        serves = previous._serves(key, prepared)
        alike = serves and previous.settings.rays_K == own_settings.rays_K
        return replace(
            tracer,
            levels=previous.levels if serves else {},
            traces=previous.traces if alike else {},
            costs=previous.costs,
            predicted=previous.predicted,
            estimates=previous.estimates if previous.prepared is prepared else {},
        )

    def on_cells(self, cell_m: float, coarse_m: float, **of_image: Any) -> VariantTracer:
        """A tracer to estimate errors of an image on these cells, with estimates of its own."""
        own_estimates = dict(self.estimates)
        return replace(self, cell_m=cell_m, coarse_m=coarse_m, estimates=own_estimates, **of_image)

    def _serves(self, key: Any, prepared: Prepared) -> bool:
        """True if images serve another medium: only the cone's lattice differs. Wavelengths are
        chosen for each spray, so the wavelength must be the same."""
        present = self.prepared
        return present.on_lattice and self.key == key and present.node == prepared.node

    @property
    def scene(self) -> Scene:
        """The scene of the medium."""
        return self.prepared.scene

    def tell(self, work: str) -> None:
        """Reports the work in progress."""
        self.prepared.stages.tell(work)

    @property
    def step(self) -> float:
        """Ratio of cells between coarse traces: the least for a cone, which takes any lattice."""
        return 1.5 if self.prepared.on_lattice else 2.0

    def coarser(self, cell_m: float) -> float:
        """The traced cells, or twice as large ones, for errors that do not depend on the cells."""
        traced = (m for m in self.levels if _LEAST <= m / cell_m <= _MOST)
        return min(traced, default=2.0 * cell_m)

    def grids(self, cell_m: float) -> list[tuple[float, ImagePair]]:
        """Images on three grids, the finest first, with the sizes of their cells over `cell_m`,
        which are among them.

        A finer image that is there is used, with a coarser one; else the other two are about twice
        and four times as coarse. Raises MediumError without enough memory, SprayError if no cone
        has such a lattice.
        """
        image = self.level(cell_m)
        images = {edge_m / cell_m: pair for edge_m, pair in self.levels.items()}
        finer = [size for size in images if _LEAST <= 1 / size <= _MOST]
        sizes: list[float] = []
        for _ in range(2):
            alike = [size for size in images if _LEAST <= size / (sizes or [1.0])[-1] <= _MOST]
            sizes += [min(alike)] if alike else []
        if finer and sizes:
            return [(max(finer), images[max(finer)]), (1.0, image), (sizes[0], images[sizes[0]])]
        if len(sizes) == 2:
            return [(1.0, image), *((size, images[size]) for size in sizes)]
        four, twice = ((up, self.level(up * cell_m)) for up in (4.0, 2.0))
        return [(1.0, image), twice, four]

    def level(self, cell_m: float) -> ImagePair:
        """Image of the medium itself; raises as `grids`."""
        cell_m = _rounded(cell_m)
        if cell_m not in self.levels:
            self.levels[cell_m] = self._traced(
                self._sources(cell_m), cell_m, self.settings, keep=True
            )
        return self.levels[cell_m]

    def frame(self, cell_m: float) -> Cube:
        """The cube in cells of this edge: of a lattice at least the domain, else its halvings."""
        if self.prepared.on_lattice:
            domain = self.scene.domain
            edge_m = math.ldexp(cell_m, lattice_depth(domain.edge_m, cell_m))
            return Cube.around(centre_m=domain.centre_m, edge_m=edge_m, leaf_edge_m=1.001 * cell_m)
        cube = self.prepared.cube
        return cube.at(round(math.log2(cube.edge_m / cell_m)))

    def _sources(self, cell_m: float) -> Sources:
        """Sources of the medium itself, a cone's on the lattice of the cells."""
        if not self.prepared.on_lattice:
            return self.prepared.sources
        finest_m = self.prepared.finest_lattice_m(wavelengths=1)
        if cell_m < finest_m:
            raise MediumError(
                f"spray.spacing_m: {cell_m:.3g}; the finest lattice whose parcels fit the memory "
                f"is {finest_m:.3g}"
            )
        return self.prepared.resprayed(self.cone_at(cell_m))

    def cone_at(self, cell_m: float) -> ConeSpray:
        """The cone on the lattice of the cells."""
        assert self.prepared.cone is not None
        return self.prepared.cone.model_copy(update={"spacing_m": cell_m})

    def variant(
        self,
        name: str,
        make: Callable[[], Sources] | None,
        cell_m: float,
        settings: Mapping[str, Any] | None = None,
        split: float | None = None,
    ) -> ImagePair:
        """Image of other sources, None: the medium itself, or with other `settings`, by the same
        rays; traced once.

        `split` takes the place of `domain.optical_depth_split`. Raises as `grids`.
        """
        if (name, cell_m) not in self.variants:
            sources = self._sources(cell_m) if make is None else make()
            varied = replace(self.settings, subpixels=False, rays_K=None, **(settings or {}))
            like = self.levels.get(_rounded(cell_m))
            rays = None if like is None else like.rays
            self.variants[name, cell_m] = self._traced(sources, cell_m, varied, split, rays)
        return self.variants[name, cell_m]

    def on_lattice(self, up: int) -> tuple[ConeSpray, ImagePair]:
        """The cone on a lattice so much coarser, and its image; raises `NO_COARSER_LATTICE`."""
        cone = self.prepared.cone
        assert cone is not None
        wider = self.cone_at(up * cone.lattice_m)
        name = f"{up} times the lattice"
        return wider, self.variant(name, lambda: self.prepared.resprayed(wider), self.coarse_m)

    def _traced(
        self,
        sources: Sources,
        cell_m: float,
        settings: TraceSettings,
        split: float | None = None,
        rays: Ints | None = None,
        keep: bool = False,
    ) -> ImagePair:
        frame = self.frame(cell_m)
        if self.prepared.on_lattice:
            frame = on_grid(frame, sources, voxel_m=frame.cell_m) or frame
        (tree,) = self.prepared.octrees(frame, [sources], split)
        columns, rows = self.scene.camera.pixels
        numbers = _picked(np.arange(rows * columns).reshape(rows, columns), self.stride)
        pixels = None if self.stride == 1 else numbers.reshape(-1)
        device = self.prepared.device
        result, cost = TraceCost.measured(
            device,
            counted(frame, sources, device).swept,
            settings,
            lambda: trace(tree, self.scene, device, settings, pixels=pixels, rays=rays),
        )
        self.costs.append(cost)
        image = ImagePair.of(result)
        if keep and pixels is None:
            self.traces[cell_m] = result
        return image if pixels is None else image.map(lambda row: row.reshape(numbers.shape))

    def known(self, cell_m: float) -> Trace | None:
        """The trace of all pixels of the medium itself, if there is one, without audit."""
        return self.traces.get(_rounded(cell_m))

    def put(self, cell_m: float, result: Trace) -> None:
        """Keeps the image of the whole run."""
        self.levels[_rounded(cell_m)] = self.picked(result)

    def picked(self, result: Trace) -> ImagePair:
        """The traced pixels of an image of the whole run, by the rays of this tracer's images."""
        if self.stride == 1:
            return ImagePair.of(result)
        image = ImagePair.of(result, middle=self.scene.camera.rays_across is None)
        return image.map(lambda image: _picked(image, self.stride))

    def difference(
        self, image_a: ImagePair, image_b: ImagePair
    ) -> tuple[ImageDifference, ImageDifference]:
        """Differences of the results of two images; maps (H, W) are NaN between traced pixels."""
        warm, emissivity = ImageDifference.between(self.temperature, image_a, image_b)
        return self._spread(warm), self._spread(emissivity)

    def _spread(self, difference: ImageDifference) -> ImageDifference:
        columns, rows = self.scene.camera.pixels
        map_K = np.full((rows, columns), np.nan)
        _picked(map_K, self.stride)[:] = difference.map_K
        return replace(difference, map_K=map_K)


def _rounded(cell_m: float) -> float:
    return float(f"{cell_m:.9g}")  # the same cells by halving and by lattice


def _picked(image: NDArray[_Scalar], stride: int) -> NDArray[_Scalar]:
    """Every n-th pixel of an image (H, W), as a view."""
    return image[stride // 2 :: stride, stride // 2 :: stride]


def temperature_of(prepared: Prepared, *, visible: float = VISIBLE_EMISSIVITY) -> NodeTemperature:
    """T_app of a scene's image at the wavelength `prepared.node`; `visible` as there."""
    scene = prepared.scene
    names = tuple(patch.name for patch in scene.patches)
    nothing = build_octree(prepared.cube.at(0), None, [], optical_depth_split=1.0)
    view = View.of(scene, OpticalCells.of(nothing, patches=names), prepared.device)
    return NodeTemperature.of(scene, prepared.node, view.sees_background_alone, visible=visible)
