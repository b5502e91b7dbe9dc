"""Traces of variants of a medium at few pixels and one wavelength, and how far they are apart.

A variant is compared with a trace by the same ordinates, whose own error cancels in part; what is
left of it is told from the rest by the halves of either (`cldit.run.picture`). The pixels are every
third, fifth, .. of the picture, whose lines of sight are those of the picture's own pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cldit.errors import MediumError
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import Sources, build_octrees
from cldit.medium.resolution import on_grid
from cldit.optics.spectral import SpectralNode
from cldit.run.cell_choice import finest_lattice_m
from cldit.run.gas_grid import GasGrid
from cldit.run.node_temperature import NodeTemperature
from cldit.run.picture import Picture, Step
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray
from cldit.transport.cells import OpticalCells
from cldit.transport.trace import Settings, trace
from cldit.transport.view import View

Floats = NDArray[np.float64]

_FEWEST = 100  # pixels along an edge that a pilot keeps
_LEAST, _MOST = 1.5, 3.0  # times as large, of cells that an error is extrapolated from


@dataclass(frozen=True)
class ParcelVariants:
    """Sources of one wavelength in which the parcels differ; see `cldit.medium.cloud.Variants`.

    sampling: error by sampling over the halves' difference.
    """

    halves: tuple[Sources, Sources]
    narrower: Sources | None
    sampling: float


@dataclass(frozen=True)
class Probed:
    """What the causes of the medium are measured on.

    frame: the cube, divided as the scene has it; on_lattice: whose cells are the cone's lattice, so
    that another cone goes with other cells. limit: cells that fit the memory. sources: at the
    wavelength of `node`, its `number`. parcels: None where the droplets are no sample. gas: the
    spray on other cells of gas; None: there is no gas, or its cells are the cone's. cone: the cone,
    where the spray is one; resprayed: the sources of another.
    """

    frame: Frame
    sources: Sources
    number: int
    node: SpectralNode
    parcels: ParcelVariants | None
    gas: GasGrid | None
    optical_depth_split: float
    limit: int
    on_lattice: bool
    cone: ConeSpray | None
    resprayed: Callable[[ConeSpray], Sources]


@dataclass(frozen=True)
class Pilot:
    """Traces variants of a medium.

    scene: with fewer pixels, every `stride`-th. kept: pictures of the medium itself by how often
    its cube is halved. earlier: pictures of the same spray on other lattices and their cells, by
    the cells' edge in m. variants: pictures of other sources by their name and how often the cube
    is halved.
    """

    scene: Scene
    device: Device
    settings: Settings
    probed: Probed
    stride: int
    temperature: NodeTemperature
    kept: dict[int, Picture] = field(default_factory=dict)
    earlier: Mapping[float, Picture] = field(default_factory=dict)
    variants: dict[tuple[str, int], Picture] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        scene: Scene,
        device: Device,
        settings: Settings,
        probed: Probed,
        before: Pilot | None = None,
    ) -> Pilot:
        """A pilot of a scene.

        Args:
            scene: what is traced, its `transport.accuracy_K` that of the trace.
            device: traces.
            settings: of the wavelength that is probed.
            probed: the medium.
            before: another pilot; its traces serve where it differs by the cone's lattice alone.
        """
        # Several rays a pixel see its own edges: pixels are left out of none of those.
        stride = _stride(scene.camera.pixels) if scene.camera.rays_per_pixel == 1 else 1
        columns, rows = (count // stride for count in scene.camera.pixels)
        camera = scene.camera.model_copy(update={"pixels": (columns, rows)})
        few = scene.model_copy(update={"camera": camera})
        return cls(
            scene=few,
            device=device,
            settings=replace(settings, method="source", audit=False, subpixels=stride == 1),
            probed=probed,
            stride=stride,
            temperature=temperature_of(few, probed),
            earlier={} if before is None else before._serving(few, probed),
        )

    def _serving(self, scene: Scene, probed: Probed) -> dict[float, Picture]:
        """Its traces by the cells' edge in m, where they are a scene's but for the lattice, and in
        the same light: wavelengths are chosen for each spray."""
        if not self.probed.on_lattice or _off_lattice(self.scene) != _off_lattice(scene):
            return {}
        if self.probed.node != probed.node:
            return {}
        edge_m = self.probed.frame.edge_m
        return {**self.earlier, **{edge_m / 2**depth: one for depth, one in self.kept.items()}}

    def coarser(self, depth: int) -> tuple[tuple[float, Picture], tuple[float, Picture]]:
        """The medium on two coarser cells, by the ratio of their edge to that of the cells.

        Args:
            depth: how often the cube of the cells is halved, 2 at least.

        Returns:
            The finer and the coarser: traced earlier where these are some two and four times as
            large, else traced on cells of just so many times.

        Raises:
            MediumError: that are more cells than memory holds.
            SprayError: no cone has such a lattice.
        """
        cell_m = self.probed.frame.edge_m / 2**depth
        sizes_m: list[float] = []
        for _ in range(2):
            finer_m = sizes_m[-1] if sizes_m else cell_m
            like = [one for one in self.earlier if _LEAST <= one / finer_m <= _MOST]
            if not like:
                break
            sizes_m.append(min(like))
        if len(sizes_m) == 2:
            first, second = ((one / cell_m, self.earlier[one]) for one in sizes_m)
            return first, second
        second, first = ((2.0**up, self.level(depth - up)) for up in (2, 1))
        return first, second

    def level(self, depth: int) -> Picture:
        """The medium itself, its cube halved `depth` times; traced once.

        Raises:
            MediumError: that are more cells than memory holds.
            SprayError: no cone has such a lattice.
        """
        if depth not in self.kept:
            probed = self.probed
            sources = probed.sources
            if probed.on_lattice:
                assert probed.cone is not None
                cone = self.cone_at(probed.cone, depth)
                self._refuse_large(probed.cone, cone)
                sources = probed.resprayed(cone)
            self.kept[depth] = self._traced(sources, depth, self.settings)
        return self.kept[depth]

    def _refuse_large(self, known: ConeSpray, wanted: ConeSpray) -> None:
        points = self.probed.sources[0]
        if points is None:
            return
        finest_m = finest_lattice_m(known.lattice_m, parcels=len(points.position_m), wavelengths=1)
        if wanted.lattice_m < finest_m:
            raise MediumError(
                f"spray.spacing_m: {wanted.lattice_m:.3g}; memory holds the parcels of a lattice "
                f"of {finest_m:.3g} at least"
            )

    def cone_at(self, cone: ConeSpray, depth: int) -> ConeSpray:
        """A cone on the lattice of the cells.

        Args:
            cone: with another lattice.
            depth: how often the cube is halved.
        """
        return cone.model_copy(update={"spacing_m": self.probed.frame.edge_m / 2**depth})

    def traced(self, sources: Sources, depth: int) -> Picture:
        """Picture of other sources in the same cube; where they have its cells, laid on them.

        Args:
            sources: droplets and gas at the wavelength that is probed.
            depth: how often the cube is halved.
        """
        return self._traced(sources, depth, replace(self.settings, subpixels=False))

    def variant(self, name: str, sources: Sources, depth: int) -> Picture:
        """As `traced`, once for each name and depth.

        Args:
            name: of the sources, which are always the same.
            sources: droplets and gas at the wavelength that is probed.
            depth: how often the cube is halved.
        """
        if (name, depth) not in self.variants:
            self.variants[name, depth] = self.traced(sources, depth)
        return self.variants[name, depth]

    def _traced(self, sources: Sources, depth: int, settings: Settings) -> Picture:
        frame = replace(self.probed.frame, depth=depth)
        if self.probed.on_lattice:
            frame = on_grid(frame, sources, voxel_m=frame.cell_m) or frame
        tree = build_octrees(
            frame,
            [sources],
            optical_depth_split=self.probed.optical_depth_split,
            max_cells=self.probed.limit,
        )[0]
        return Picture.of(trace(tree, self.scene, self.device, settings))

    def thinned(self, picture: Picture) -> Picture:
        """The pilot's pixels of the run's picture."""
        if self.stride == 1:
            return picture
        first, step = self.stride // 2, self.stride
        return picture.map(lambda image: image[first::step, first::step])

    def spread(self, image: Floats) -> Floats:
        """A map over the pixels of the picture.

        Args:
            image: (H / stride, W / stride) of the pilot's pixels.

        Returns:
            One value for each pixel of the picture, (H, W).
        """
        return image.repeat(self.stride, 0).repeat(self.stride, 1)

    def step(self, one: Picture, other: Picture) -> Step:
        """Difference of two of the pilot's pictures; its map is that of the picture.

        Args:
            one, other: of the pilot's pixels.
        """
        found = Step.between(self.temperature, one, other)
        return Step(found.error_K, self.spread(found.map_K))


def temperature_of(scene: Scene, probed: Probed) -> NodeTemperature:
    """T_app of a scene's picture in the light of the node that is probed."""
    names = tuple(patch.name for patch in scene.patches)
    nothing = build_octrees(replace(probed.frame, depth=0), [(None, [])], optical_depth_split=1.0)
    view = View.of(scene, OpticalCells.of(nothing[0], patches=names))
    return NodeTemperature.of(scene, probed.node, view.before_background)


def _off_lattice(scene: Scene) -> Scene:
    """The scene without the lattice of its cone."""
    if not isinstance(scene.spray, ConeSpray):
        return scene
    spray = scene.spray.model_copy(update={"spacing_m": None})
    return scene.model_copy(update={"spray": spray})


def _stride(pixels: tuple[int, int]) -> int:
    """The largest odd divisor of both numbers that leaves 100 pixels or more."""
    most = min(pixels) // _FEWEST
    fits = (n for n in range(1, most + 1, 2) if not any(count % n for count in pixels))
    return max(fits, default=1)
