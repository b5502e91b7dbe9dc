"""Preview of an image on the coarsest cells: which pixels have a T_app, at every wavelength.

A pixel has a T_app by its emissivity in the whole filter. Errors are estimated at the wavelength
at which the medium hides most light, where few of these pixels may reach that emissivity. So at
each wavelength the pixels count whose emissivity exceeds a value of its own: as many have it in the
preview as have a T_app. Both counts are of the same preview, whose cells smear the medium alike at
all wavelengths.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import TransportError
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.transport.trace import settings_for, trace

ACROSS = 32  # cells across the image, of the coarsest trace
_PIXELS = 8 * ACROSS  # along an edge


def coarsest_depth(scene: Scene, edge_m: float) -> int:
    """Number of times that a cube of this edge is halved for the coarsest trace."""
    return max(3, math.ceil(math.log2(ACROSS * edge_m / max(scene.camera.field_m))))


def visible_emissivities(prepared: Prepared) -> tuple[float, ...]:
    """Emissivity at each wavelength above which a pixel has a T_app."""
    count = len(prepared.properties.sources)
    if count == 1 or prepared.is_empty:
        return (VISIBLE_EMISSIVITY,) * count
    by_node, filtered = prepared.variant("preview", lambda: previewed(prepared))
    return tuple(as_many(node, filtered, VISIBLE_EMISSIVITY) for node in by_node)


def as_many(
    values: NDArray[np.floating], reference: NDArray[np.floating], threshold: float
) -> float:
    """Value that is exceeded by as many of `values` as of `reference` exceed `threshold`.

    Both have any shape. A threshold above all of `reference` is scaled by the ratio of the maxima.
    """
    rising, reference_rising = np.sort(values, axis=None), np.sort(reference, axis=None)
    if not reference_rising[-1] > 0.0 or not rising[-1] > 0.0:
        return threshold
    if threshold > reference_rising[-1]:
        return float(threshold * rising[-1] / reference_rising[-1])
    return float(np.interp(threshold, reference_rising, rising))


def previewed(prepared: Prepared) -> tuple[Floats, Floats]:
    """Emissivity (K, h, w) of the medium in few pixels at each wavelength, and in the filter
    (h, w), without light that is scattered."""
    scene, cube, chosen = prepared.scene, prepared.cube, prepared.properties.chosen
    camera = scene.camera
    coarse = min(cube.depth, coarsest_depth(scene, cube.edge_m))
    columns, rows = (min(count, _PIXELS) for count in camera.pixels)
    coarse_camera = camera.model_copy(update={"pixels": (columns, rows), "rays_per_pixel": 1})
    seen = scene.model_copy(update={"camera": coarse_camera})
    settings = replace(settings_for(scene), method="source", audit=False, order=0, gather=False)
    background_K = chosen.quadrature.reference_K
    shares = np.array([float(node.share(background_K)) for node in chosen.nodes])
    for depth in range(coarse, cube.depth + 1):
        trees = prepared.octrees(cube.at(depth), prepared.properties.sources)
        try:
            traces = [trace(tree, seen, prepared.device, settings) for tree in trees]
        except TransportError:  # cells so large reach behind a patch
            continue
        by_node = np.array([1.0 - traced.weights.background.astype(float) for traced in traces])
        return by_node, np.asarray(np.tensordot(shares, by_node, 1))
    by_node = np.ones((len(shares), rows, columns))  # the medium may be anywhere
    return by_node, by_node[0]
