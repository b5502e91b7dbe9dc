"""A tracer whose images are numbers, so that their errors are known."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from cldit.accuracy.image_pair import ImageDifference
from cldit.medium.frame import Cube
from cldit.prepare.stages import Stages

EDGE_m, FIELD_m = 0.2, 0.16  # of the cube, and of the image


def step(error_K: float | None) -> ImageDifference:
    """A difference that is alike in all pixels."""
    return ImageDifference(error_K, np.full((2, 2), np.nan if error_K is None else error_K))


class NumberTracer:
    """Does what a `VariantTracer` does. The medium's own image on cells is `level_K` of their edge,
    other images are `variants_K` by name, or raise what is there. `emissivity` is its difference
    over that of T_app."""

    def __init__(
        self,
        level_K: Callable[[float], float],
        variants_K: Mapping[str, float | Exception] | None = None,
        *,
        emissivity: float = 0.5,
        on_lattice: bool = False,
        scene: Any = None,
        **prepared: Any,
    ) -> None:
        self.level_K, self.variants_K, self.emissivity = level_K, variants_K or {}, emissivity
        self.step = 1.5 if on_lattice else 2.0
        self.scene = scene or SimpleNamespace(
            camera=SimpleNamespace(field_m=(FIELD_m, FIELD_m)), spray=None
        )
        self.prepared = SimpleNamespace(
            scene=self.scene,
            stages=Stages(None),
            on_lattice=on_lattice,
            cube=Cube((0.0, 0.0, 0.0), edge_m=EDGE_m, depth=7),
            cone=None,
        )
        vars(self.prepared).update(prepared)
        self.traced: list[float] = []  # cells of the medium's own images
        self.varied: set[int] = set()  # halvings of the cube, of other images
        self.cell_m, self.coarse_m, self.image = 1e-3, 2e-3, None
        self.temperature: Any = None
        self.predicted: dict[str, Any] = {}
        self.estimates: dict[str, Any] = {}

    def on_cells(self, cell_m: float, coarse_m: float, **of_image: Any) -> NumberTracer:
        tracer = copy.copy(self)
        own = {"cell_m": cell_m, "coarse_m": coarse_m, "estimates": dict(self.estimates)}
        vars(tracer).update(own | of_image)
        return tracer

    def tell(self, work: str) -> None:
        self.prepared.stages.tell(work)

    def level(self, cell_m: float) -> float:
        image = self.level_K(cell_m)
        self.traced.append(cell_m)
        return image

    def grids(self, cell_m: float) -> list[tuple[float, float]]:
        return [(up, self.level(up * cell_m)) for up in (1.0, self.step, self.step**2)]

    def variant(self, name: str, make: Callable[[], Any], cell_m: float) -> float:
        assert not isinstance(make(), str)
        self.varied.add(round(math.log2(EDGE_m / cell_m)))
        image = self.variants_K[name]
        if isinstance(image, Exception):
            raise image
        return self.level(cell_m) + image

    def difference(self, image_a: float, image_b: float) -> tuple[ImageDifference, ...]:
        change = abs(image_a - image_b)
        return step(change), step(self.emissivity * change)
