"""Errors of weights as errors of apparent temperature T_app, to first order, during a trace.

The image (stage 4 of `trace_source`) refines pixels by them; the final gather and `path` stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.optics.planck import band_radiance, band_radiance_slope, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import background_radiance
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.view import View

Floats = NDArray[np.float64]


def _radiances(cells: OpticalCells, scene: Scene) -> Floats:
    """Radiance (C,) of each weight; the background has its median temperature."""
    filter_um = scene_filter(scene)

    def black(temperature_K: float) -> float:
        return float(band_radiance(temperature_K, filter_um=filter_um))

    wall = black(scene.walls.temperature_K)
    grey = [
        background_radiance(blackbody=black(temperature_K), wall=wall, emissivity=emissivity)
        for temperature_K, emissivity in (
            (float(np.median(scene.background.temperatures_K)), scene.background.emissivity),
            *((patch.temperature_K, patch.emissivity) for patch in scene.patches),
        )
    ]
    return np.array([grey[0], wall, *grey[1:], *(cells.scale for _ in cells.needs.emitters)])


def _sum(radiances: Floats, weights: NDArray[np.floating]) -> Floats:
    """Sum (N,) of radiances (C,) times weights (C, N).

    BLAS is avoided, since its threads keep a core busy for a while after each product.
    """
    return np.asarray(np.einsum("c,cn->n", radiances, weights))


def counted(
    view: View, emissivity: NDArray[np.floating], pixels: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(N,) which pixels have a T_app: they see the background, with emissivity above 0.05.

    Args:
        view: camera and background.
        emissivity: (N,) of the medium.
        pixels: (N,) flat numbers.
    """
    out = np.asarray(emissivity > VISIBLE_EMISSIVITY)
    out[out] = view.on_background(pixels[out])
    return out


def apparent_temperature_K(mean: NDArray[np.floating], cells: OpticalCells, scene: Scene) -> Floats:
    """T_app of weights in the whole filter.

    Args:
        mean: (C, N) weights of pixels that have a T_app.
        cells, scene: give the radiance of each weight, and the filter.

    Returns:
        (N,) in K.
    """
    apparent = _sum(_radiances(cells, scene)[1:], mean[1:]) / (1.0 - mean[0])
    return temperature_of_radiance(np.maximum(apparent, 0.0), filter_um=scene_filter(scene))


def temperature_error_K(
    mean: NDArray[np.floating],
    difference: NDArray[np.floating],
    cells: OpticalCells,
    scene: Scene,
    *,
    outside: float | None = None,
) -> Floats:
    """Error of T_app in K for an error of the weights.

    Where the line of sight misses the background, the emissivity is that of one that hits it: this
    only steers a trace.

    Args:
        mean: (C, N) weights.
        difference: (C, N) error of the weights.
        cells, scene: give the radiance of each weight, and the filter.
        outside: radiance for walls and patches, where the answer must not depend on theirs.

    Returns:
        (N,) errors; NaN at emissivities up to 0.05.
    """
    filter_um = scene_filter(scene)
    own = _radiances(cells, scene)[1:]
    if outside is not None:
        own[: cells.needs.boundaries - 1] = outside
    emissivity = 1.0 - mean[0]
    apparent = _sum(own, mean[1:]) / np.maximum(emissivity, 1e-9)
    out = np.full(mean.shape[1], np.nan)
    here = (emissivity > VISIBLE_EMISSIVITY) & (apparent > 0)
    if here.any():
        apparent = apparent[here]
        radiance = _sum(own, difference[1:, here]) + difference[0, here] * apparent
        temperature = temperature_of_radiance(apparent, filter_um=filter_um)
        slope = band_radiance_slope(temperature, filter_um=filter_um)
        out[here] = radiance / emissivity[here] / slope
    return out


def pixels_to_refine(
    image: NDArray[np.floating], cells: OpticalCells, scene: Scene, *, accuracy_K: float
) -> NDArray[np.int64]:
    """Pixels in which one ray cannot stand for the pixel's area, and their neighbours.

    A ray in the middle misses the mean over a pixel by a 24th of the second difference where the
    image is smooth, and by up to half of it at an edge. A quarter is taken here, both in T_app and
    in the brightness temperature before the median background.

    Args:
        image: (C, H, W) weights from one ray a pixel.
        cells, scene: as in `temperature_error_K`.
        accuracy_K: largest error to leave.

    Returns:
        (N,) flat numbers.
    """
    _, rows, columns = image.shape
    marked = np.zeros((rows, columns), bool)
    for axis in (1, 2):
        if image.shape[axis] < 3:
            continue
        missing = np.zeros_like(image)
        inner = [slice(None)] * 3
        inner[axis] = slice(1, -1)
        missing[tuple(inner)] = np.diff(image, n=2, axis=axis) / 4
        curved = np.flatnonzero(np.max(np.abs(missing), axis=0) > 1e-5)
        there, missed = (part.reshape(len(part), -1)[:, curved] for part in (image, missing))
        apparent_K = np.nan_to_num(np.abs(temperature_error_K(there, missed, cells, scene)))
        seen = np.maximum(_sum(_radiances(cells, scene), there), 1e-300)
        bright = temperature_of_radiance(seen, filter_um=scene_filter(scene))
        slope = band_radiance_slope(bright, filter_um=scene_filter(scene))
        missed_K = np.abs(_sum(_radiances(cells, scene), missed)) / np.maximum(slope, 1e-300)
        marked.flat[curved[np.maximum(apparent_K, missed_K) > accuracy_K]] = True
    wide = marked.copy()
    for axis in (0, 1):
        one = wide.copy()
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        wide[tuple(ahead)] |= one[tuple(behind)]
        wide[tuple(behind)] |= one[tuple(ahead)]
    return np.flatnonzero(wide)
