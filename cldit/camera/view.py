"""Field of view of the sensor, and averaging of traced images into its pixels."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.errors import TransportError
from cldit.scene.camera import square_pixel_m
from cldit.scene.schema import Scene


@lru_cache(maxsize=16)
def overlap_matrix(count_in: int, count_out: int, share: float) -> "scipy.sparse.csr_array":
    """Matrix (count_out, count_in) of area means over equal pixels; rows sum to 1.

    The output covers the central `share` (0..1) of the input's length.
    """
    edges = count_in * (0.5 + share * (np.arange(count_out + 1) / count_out - 0.5))
    edges = np.clip(edges, 0.0, count_in)  # rounding only: share is at most 1
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    for row, (low, high) in enumerate(pairwise(edges)):
        inside = np.arange(int(low), min(int(np.ceil(high)), count_in))
        overlap = np.minimum(inside + 1, high) - np.maximum(inside, low)
        rows += [row] * inside.size
        columns += inside.tolist()
        values += (overlap / overlap.sum()).tolist()
    return scipy.sparse.csr_array((values, (rows, columns)), shape=(count_out, count_in))


@dataclass(frozen=True, kw_only=True)
class SensorView:
    """Footprint of the sensor: the largest centred rectangle of its shape within the field.

    field_m, centre_m: size, and centre (x, z), of the traced image in the plane of the target.
    pixels: columns and rows of the sensor.
    """

    field_m: tuple[float, float]
    centre_m: tuple[float, float]
    pixels: tuple[int, int]

    @classmethod
    def from_scene(cls, scene: Scene) -> "SensorView":
        """The view of a scene's sensor."""
        x, _, z = scene.target_m
        return cls(
            field_m=scene.camera.field_m,
            centre_m=(x, z),
            pixels=scene.camera.sensor.pixels,
        )

    @property
    def pixel_m(self) -> tuple[float, float]:
        """Width and height of a sensor pixel on the object; pixels are square."""
        edge = square_pixel_m(self.field_m, self.pixels)
        return edge, edge

    def image(self, traced: NDArray[np.floating]) -> NDArray[np.float64]:
        """Area means (rows, columns) of a traced image (H, W), row 0 at the top of both."""
        if traced.ndim != 2 or traced.size == 0:
            raise TransportError(f"traced image of shape {traced.shape}; allowed: (H, W)")
        width, height = (
            min(self.pixel_m[axis] * self.pixels[axis] / self.field_m[axis], 1.0) for axis in (0, 1)
        )
        columns = overlap_matrix(traced.shape[1], self.pixels[0], width)
        rows = overlap_matrix(traced.shape[0], self.pixels[1], height)
        across = columns @ np.asarray(traced, np.float64).T
        return np.asarray(rows @ across.T)
