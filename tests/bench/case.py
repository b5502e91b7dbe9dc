"""Scene prepared to be traced with many settings, and the cost of each trace."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.bench.case import BenchError, Cost, changed, clocked
from cldit.gpu.device import Device
from cldit.medium.octree import Octree
from cldit.prepare.medium import Medium, prepare
from cldit.prepare.stages import Stages
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.phase import ScatteringTable
from cldit.transport.trace import Trace, TraceSettings, settings_for, trace
from cldit.transport.view import View


def one_pixel(scene: Scene) -> Scene:
    """Scene with only the pixel in the corner, to time a trace without its image."""
    camera = scene.camera
    width, height = (edge / n for edge, n in zip(camera.field_m, camera.pixels, strict=True))
    x, y, z = scene.target_m
    corner = (x - camera.field_m[0] / 2 + width / 2, y, z + camera.field_m[1] / 2 - height / 2)
    one = {"pixels": (1, 1), "field_m": (width, height), "target_m": corner}
    return scene.model_copy(update={"camera": camera.model_copy(update=one)})


@dataclass(frozen=True)
class Lattice:
    """Every n-th pixel of an image, in the middle of its block: `every` across and down, odd.

    Lines of sight are those of the same pixels in the whole image.
    """

    every: tuple[int, int]

    def __post_init__(self) -> None:
        if min(self.every) < 1 or not all(n % 2 for n in self.every):
            raise BenchError(f"every: {self.every} pixels; allowed: odd numbers from 1")

    def _along(self, pixels: int, every: int) -> tuple[int, int]:
        """Number of pixels, and index of the first."""
        count = pixels // every
        count -= (pixels - count) % 2  # both even or both odd: else they lie between pixels
        if count < 1:
            raise BenchError(f"every: {every} of {pixels} pixels leaves none; choose fewer")
        return count, (every - 1) // 2 + (pixels - count * every) // 2

    def of(self, scene: Scene) -> Scene:
        """Scene with these pixels only."""
        pixels, field = scene.camera.pixels, scene.camera.field_m
        counts = [self._along(n, k)[0] for n, k in zip(pixels, self.every, strict=True)]
        kept = [
            size * count * every / n
            for size, count, every, n in zip(field, counts, self.every, pixels, strict=True)
        ]
        return changed(scene, camera={"pixels": counts, "field_m": kept})

    def numbers(self, scene: Scene) -> tuple[list[int], list[int]]:
        """Columns and rows of these pixels in the whole image."""
        found = []
        for n, every in zip(scene.camera.pixels, self.every, strict=True):
            count, first = self._along(n, every)
            found.append(list(range(first, first + count * every, every)))
        return found[0], found[1]

    def pick(self, scene: Scene, weights: Weights) -> Weights:
        """Weights of these pixels, from the `weights` of the whole image of `scene`."""
        columns, rows = self.numbers(scene)
        where = np.ix_(rows, columns)
        return weights.map(lambda image: image[where])

    def share(self, scene: Scene) -> float:
        """Fraction of the pixels of the whole image."""
        columns, rows = self.of(scene).camera.pixels
        return columns * rows / float(np.prod(scene.camera.pixels))


@dataclass(frozen=True)
class Case:
    """Medium of a scene at one wavelength: the only one, or the middle node of several."""

    scene: Scene
    device: Device
    medium: Medium

    @classmethod
    def of(cls, scene: Scene, device: Device, *, cache: Path) -> Case:
        """Medium of `scene` on `device`; tables are kept in `cache`."""
        stages = Stages(None)
        return cls(scene, device, prepare(scene, device, stages, cache).grown())

    @property
    def tree(self) -> Octree:
        """Octree of the middle wavelength."""
        return self.medium.trees[len(self.medium.trees) // 2]

    @property
    def phase(self) -> ScatteringTable | None:
        """Mean phase function of the droplets at that wavelength, if the scene uses it."""
        phases = self.medium.properties.phases
        return phases[len(phases) // 2]

    def seen(self, scene: Scene) -> Case:
        """Same medium with another camera or other transport keys."""
        return replace(self, scene=scene)

    def settings(self, **transport: Any) -> TraceSettings:
        """Settings with keys of the scene's `transport` replaced."""
        return settings_for(changed(self.scene, transport=transport), self.phase)

    def run(self, settings: TraceSettings) -> tuple[Trace, Cost]:
        """Trace and its cost. Run new settings once before, as drivers compile at first launch."""
        result, cost = clocked(
            self.device, lambda: trace(self.tree, self.scene, self.device, settings)
        )
        wall_s = cost.wall_s - sum(program.build_s for program in result.programs)
        built_s = sum(program.build_core_s for program in result.programs)
        return result, Cost(cost.core_s - built_s if self.device.is_cpu else wall_s, wall_s)

    @cached_property
    def _temperature(self) -> NodeTemperature:
        nodes = self.medium.properties.chosen.nodes
        before = View.of(self.scene, OpticalCells.of(self.tree), self.device).sees_background
        return NodeTemperature.of(self.scene, nodes[len(nodes) // 2], before)

    def temperature_K(self, weights: Weights) -> Floats:
        """Apparent temperature (H, W) in the middle node's light; see `NodeTemperature`."""
        return self._temperature(weights)
