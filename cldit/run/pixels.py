"""What one ray through the middle of a pixel misses of the light of the whole pixel.

The picture itself tells, without another trace: of 3 x 3 pixels the ray in their middle stands to
their mean as the ray of a pixel three times as large to that pixel's light; of 5 x 5 likewise. From
both follows the order in the pixel's size, between 1/2 (edges, which pixels hit by chance) and 2
(smooth light), and by it the error of the pixel as it is. Where a pixel has several rays, the one
in its middle is compared with all.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cldit.radiance.weights import Weights
from cldit.run.errors import Cause
from cldit.run.node_temperature import NodeTemperature
from cldit.run.picture import Picture, Step
from cldit.run.pilot import Probed, temperature_of
from cldit.scene import Scene

Floats = NDArray[np.float64]

_SMALL, _LARGE = 3, 5
_KEY = "camera.rays_per_pixel"
_ADAPTIVE = 4  # rays a pixel, in the mean of the steep ones and others


def pixel_error(scene: Scene, probed: Probed, picture: Picture) -> tuple[Cause, Step | None]:
    """Error of T_app by pixel sampling, and its map.

    Args:
        scene: whose camera has the pixels.
        probed: the medium, for its wavelength.
        picture: (H, W).

    Returns:
        The cause, with its map where there is one.
    """
    if min(scene.camera.pixels) < 3 * _LARGE:
        return Cause("pixel sampling", None, "the picture has too few pixels", _KEY), None
    temperature = temperature_of(scene, probed)
    if picture.middle is not None:
        return _several(scene, temperature, picture.weights, picture.middle)
    small, large = (_of_blocks(temperature, picture.weights, edge) for edge in (_SMALL, _LARGE))
    if small.error_K is None:
        return Cause("pixel sampling", None, "no pixel has a T_app", _KEY), None
    order = _order(small, large, _LARGE / _SMALL)
    found = small.times(_SMALL**-order)
    columns, rows = scene.camera.pixels
    map_K = np.full((rows, columns), np.nan)
    full = found.map_K.repeat(_SMALL, 0).repeat(_SMALL, 1)
    map_K[: full.shape[0], : full.shape[1]] = full
    how = f"middle against mean of 3 x 3 and 5 x 5 pixels, extrapolated by order {order:.2g}"
    return Cause("pixel sampling", found.error_K, how, _KEY), Step(found.error_K, map_K)


def _several(
    scene: Scene, temperature: NodeTemperature, picture: Weights, middle: Weights
) -> tuple[Cause, Step | None]:
    """Of n x n rays a pixel: what one ray misses is seen, and falls with n.

    Where light is smooth, the rays of a pixel err alike, as n^-2. Where edges cross pixels, each
    ray errs as n^-1/2 and by chance, and their mean as n^-3/2.
    """
    one = Step.between(temperature, Picture(middle), Picture(picture))
    if one.error_K is None:
        return Cause("pixel sampling", None, "no pixel has a T_app", _KEY), None
    order = _order(one, _of_blocks(temperature, middle, _SMALL), _SMALL)
    rays = scene.camera.rays_per_pixel
    across = (_ADAPTIVE if rays == "adaptive" else rays) ** 0.5
    found = one.times(across ** -((4.0 + order) / 3.0))
    how = f"one ray in the middle against all, which err less by order {(4.0 + order) / 3.0:.2g}"
    return Cause("pixel sampling", found.error_K, how, _KEY), found


def _order(small: Step, large: Step, ratio: float) -> float:
    """Order in the pixel's size, of two whose sizes have that ratio."""
    if not small.error_K or not large.error_K:
        return 2.0
    return min(max(math.log(large.error_K / small.error_K) / math.log(ratio), 0.5), 2.0)


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
    return Step.between(of_blocks, Picture(middle), Picture(mean))
