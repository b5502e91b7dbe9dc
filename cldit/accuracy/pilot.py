"""Traces of variants of a medium at few pixels and one wavelength, and how far they are apart.

A variant is compared with a trace by the same ordinates, whose own error cancels in part; what is
left of it is told from the rest by the halves of either (`cldit.accuracy.picture`). Of a large
picture some pixels are drawn (`cldit.accuracy.drawn_pixels`), the same for all traces of a run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.drawn_pixels import DrawnPixels, all_are_traced
from cldit.accuracy.picture import Picture, Step
from cldit.errors import MediumError, TransportError
from cldit.gpu.device import Device
from cldit.medium.octree import Sources, build_octrees
from cldit.medium.resolution import on_grid
from cldit.prepare.cell_choice import finest_lattice_m
from cldit.prepare.probed import Probed
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray
from cldit.transport.cells import OpticalCells
from cldit.transport.trace import Settings, trace
from cldit.transport.view import View

Floats = NDArray[np.float64]

# Pixels, and cells, along an edge of the coarse picture that says where the medium is seen.
_LOOK, _LOOK_CELLS = 256, 256
_LEAST, _MOST = 1.5, 3.0  # times as large, of cells that an error is extrapolated from


@dataclass(frozen=True)
class Pilot:
    """Traces variants of a medium.

    drawn: the pixels that are traced; None: all of the picture. temperature: theirs. kept: pictures
    of the medium itself by how often its cube is halved. earlier: pictures of the same spray on
    other lattices and their cells, by the cells' edge in m. variants: pictures of other sources by
    their name and how often the cube is halved.
    """

    scene: Scene
    device: Device
    settings: Settings
    probed: Probed
    drawn: DrawnPixels | None
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
            before: another pilot of the same camera; its pixels are drawn once, and its traces
                serve where it differs by the cone's lattice alone.
        """
        mine = replace(settings, method="source", audit=False, subpixels=False)
        temperature = temperature_of(scene, probed)
        camera, drawn = scene.camera, None
        # Which pixels have several rays, where they are adaptive, is seen in all of the picture.
        if camera.rays_per_pixel != "adaptive" and not all_are_traced(camera.pixels):
            drawn = None if before is None else before.drawn
            if drawn is None:
                emissivity = looked(scene, device, mine, probed)
                background = temperature.before_background
                drawn = DrawnPixels.of(background, emissivity, seed=mine.seed)
            temperature = temperature.picked(drawn.sample.pixels)
        return cls(
            scene=scene,
            device=device,
            settings=replace(mine, subpixels=drawn is None),
            probed=probed,
            drawn=drawn,
            temperature=temperature,
            earlier={} if before is None else before._serving(scene, probed),
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
        pixels = None if self.drawn is None else self.drawn.sample.pixels
        return Picture.of(trace(tree, self.scene, self.device, settings, pixels=pixels))

    def picked(self, picture: Picture) -> Picture:
        """The pilot's pixels of the run's picture."""
        return picture if self.drawn is None else picture.map(self.drawn.pick)

    def step(self, one: Picture, other: Picture) -> Step:
        """Difference of two of the pilot's pictures; its map is that of the picture.

        Args:
            one, other: of the pilot's pixels.
        """
        return Step.between(self.temperature, one, other, self.drawn)

    def noise_K(self, picture: Picture) -> float | None:
        """RMS error of one of the pilot's pictures by its own halves; None: no pixel has one."""
        return picture.error_K(self.temperature, self.drawn)


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


def looked(scene: Scene, device: Device, settings: Settings, probed: Probed) -> Floats:
    """Where the medium is seen, roughly: of few pixels, on coarse cells that scatter nothing.

    Args:
        scene: whose field it is.
        device: traces.
        settings: of the wavelength that is probed.
        probed: the medium.

    Returns:
        Emissivity (h, w).
    """
    frame, camera = probed.frame, scene.camera
    finest_m = max(camera.field_m) / _LOOK_CELLS
    coarse = min(frame.depth, max(3, math.ceil(math.log2(frame.edge_m / finest_m))))
    columns, rows = (min(count, _LOOK) for count in camera.pixels)
    few = camera.model_copy(update={"pixels": (columns, rows), "rays_per_pixel": 1})
    look = scene.model_copy(update={"camera": few})
    for depth in range(coarse, frame.depth + 1):
        tree = build_octrees(
            replace(frame, depth=depth),
            [probed.sources],
            optical_depth_split=probed.optical_depth_split,
            max_cells=probed.limit,
        )[0]
        try:
            found = trace(tree, look, device, replace(settings, order=0, gather=False))
        except TransportError:  # cells so large reach behind a patch
            continue
        return np.asarray(1.0 - found.weights.background, float)
    return np.ones((rows, columns))  # the medium may be anywhere
