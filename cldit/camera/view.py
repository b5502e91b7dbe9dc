"""What part of the traced picture the sensor sees, averaged by area into its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cldit.errors import TransportError
from cldit.scene.schema import Scene


@lru_cache(maxsize=16)
def overlap_matrix(count_in: int, count_out: int, share: float) -> csr_array:
    """Mean of equal pixels within each of others, (count_out, count_in); rows sum to 1.

    Args:
        count_in: pixels of the input.
        count_out: pixels of the output.
        share: part (0..1) of the input's length, its middle, that the output fills.
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
    return csr_array((values, (rows, columns)), shape=(count_out, count_in))


@dataclass(frozen=True, kw_only=True)
class SensorView:
    """The sensor's footprint: the largest rectangle of its shape in the middle of the field.

    field_m: width and height of the traced picture in the plane of its middle, centre_m (x, z).
    pixels: of the sensor, columns and rows.
    """

    field_m: tuple[float, float]
    centre_m: tuple[float, float]
    pixels: tuple[int, int]

    @classmethod
    def from_scene(cls, scene: Scene) -> SensorView:
        """What the scene's sensor sees."""
        x, _, z = scene.target_m
        return cls(
            field_m=scene.camera.field_m,
            centre_m=(x, z),
            pixels=scene.camera.sensor.pixels,
        )

    @property
    def pixel_m(self) -> tuple[float, float]:
        """Width and height of a sensor pixel on the object; pixels are square."""
        edge = min(self.field_m[0] / self.pixels[0], self.field_m[1] / self.pixels[1])
        return edge, edge

    def image(self, traced: NDArray[np.floating]) -> NDArray[np.float64]:
        """(rows, columns) means by area of a traced picture (H, W), row 0 at the top of both.

        Raises:
            TransportError: the traced picture is empty or has not two dimensions.
        """
        if traced.ndim != 2 or traced.size == 0:
            raise TransportError(f"traced picture of shape {traced.shape}, expected (H, W)")
        width, height = (
            min(self.pixel_m[axis] * self.pixels[axis] / self.field_m[axis], 1.0) for axis in (0, 1)
        )
        columns = overlap_matrix(traced.shape[1], self.pixels[0], width)
        rows = overlap_matrix(traced.shape[0], self.pixels[1], height)
        across = columns @ np.asarray(traced, np.float64).T
        return np.asarray(rows @ across.T)
