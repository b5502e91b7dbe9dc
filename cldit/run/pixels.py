"""What one ray through the middle of a pixel misses of the light of the whole pixel.

The picture itself tells, without another trace: of 3 x 3 pixels the ray in their middle stands to
their mean as the ray of a pixel three times as large to that pixel's light; of 5 x 5 likewise. From
both follows the order in the pixel's size, between 1/2 (edges, which pixels hit by chance) and 2
(smooth light), and by it the error of the pixel as it is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cldit.radiance.weights import Weights
from cldit.run.errors import Cause
from cldit.run.node_temperature import NodeTemperature
from cldit.run.pilot import Probed, Step, temperature_of
from cldit.scene import Scene

Floats = NDArray[np.float64]

_SMALL, _LARGE = 3, 5
_ADAPTIVE = 4  # rays a pixel, in the mean of the steep ones and others


def pixel_error(
    scene: Scene, probed: Probed, picture: Weights, middle: Weights | None
) -> tuple[Cause, Step | None]:
    """Error of T_app by pixel sampling, and its map.

    Args:
        scene: whose camera has the pixels.
        probed: the medium, for its wavelength.
        picture: (H, W).
        middle: of one ray a pixel, where `picture` is of several.
    """
    key = "camera.rays_per_pixel"
    if min(scene.camera.pixels) < 3 * _LARGE:
        return Cause("pixel sampling", None, "the picture has too few pixels", key), None
    temperature = temperature_of(scene, probed)
    one_ray = picture if middle is None else middle
    small, large = (_of_blocks(temperature, one_ray, edge) for edge in (_SMALL, _LARGE))
    if small.error_K is None:
        return Cause("pixel sampling", None, "no pixel has a T_app", key), None
    order = 2.0
    if small.error_K > 0 and large.error_K:
        order = math.log(large.error_K / small.error_K) / math.log(_LARGE / _SMALL)
        order = min(max(order, 0.5), 2.0)
    rays = scene.camera.rays_per_pixel
    across = (_ADAPTIVE if rays == "adaptive" else rays) ** 0.5
    found = small.times((_SMALL * across) ** -order)
    columns, rows = scene.camera.pixels
    map_K = np.full((rows, columns), np.nan)
    full = found.map_K.repeat(_SMALL, 0).repeat(_SMALL, 1)
    map_K[: full.shape[0], : full.shape[1]] = full
    how = f"middle against mean of 3 x 3 and 5 x 5 pixels, extrapolated by order {order:.2g}"
    return Cause("pixel sampling", found.error_K, how, key), Step(found.error_K, map_K)


def _of_blocks(temperature: NodeTemperature, weights: Weights, edge: int) -> Step:
    """Middle against mean of blocks of edge x edge pixels, wholly before the background."""

    def blocks(image: NDArray[np.generic]) -> NDArray[np.generic]:
        rows, columns = (count // edge for count in image.shape)
        cut = image[: rows * edge, : columns * edge]
        return cut.reshape(rows, edge, columns, edge)

    half = edge // 2
    inside = np.asarray(blocks(temperature.before_background).all(axis=(1, 3)))
    of_blocks = NodeTemperature(temperature.scene, temperature.grid_K, temperature.radiance, inside)
    mean = weights.map(lambda image: np.asarray(blocks(image).mean(axis=(1, 3))))
    middle = weights.map(lambda image: np.asarray(blocks(image)[:, half, :, half]))
    return Step.between(of_blocks, middle, mean)
