"""Preview of an image on coarse cells: which pixels have a T_app, at every wavelength.

A pixel has a T_app by its emissivity in the whole filter. Errors are estimated at the wavelength
at which the medium hides most light, where few of these pixels may reach that emissivity. So at
each wavelength the pixels count whose emissivity exceeds a value of its own: as many have it in the
preview as have a T_app.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import TransportError
from cldit.gpu.device import Device
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.transport.trace import settings_for, trace

_PIXELS, _CELLS = 256, 256  # along an edge


def previewed(scene: Scene, device: Device, prepared: Prepared) -> tuple[Floats, Floats]:
    """Emissivity (K, h, w) of the medium in few pixels at each wavelength, and in the filter
    (h, w); made once for a prepared medium."""
    found: tuple[Floats, Floats] = prepared.variant(
        "preview", lambda: _preview(scene, device, prepared)
    )
    return found


def visible_emissivities(scene: Scene, device: Device, prepared: Prepared) -> tuple[float, ...]:
    """Emissivity at each wavelength above which a pixel has a T_app."""
    count = len(prepared.properties.sources)
    if count == 1 or prepared.is_empty:
        return (VISIBLE_EMISSIVITY,) * count
    each, filtered = previewed(scene, device, prepared)
    return tuple(as_many(one, filtered, VISIBLE_EMISSIVITY) for one in each)


def as_many(one: NDArray[np.floating], other: NDArray[np.floating], least: float) -> float:
    """Value that as many of `one` exceed as `least` is exceeded by others; both have any shape.

    Beyond the largest of the others, in proportion.
    """
    mine, others = np.sort(one, axis=None), np.sort(other, axis=None)
    if not others[-1] > 0.0 or not mine[-1] > 0.0:
        return least
    if least > others[-1]:
        return float(least * mine[-1] / others[-1])
    return float(np.interp(least, others, mine))


def _preview(scene: Scene, device: Device, prepared: Prepared) -> tuple[Floats, Floats]:
    cube, camera, chosen = prepared.cube, scene.camera, prepared.properties.chosen
    finest_m = max(camera.field_m) / _CELLS
    coarse = min(cube.depth, max(3, math.ceil(math.log2(cube.edge_m / finest_m))))
    columns, rows = (min(count, _PIXELS) for count in camera.pixels)
    few = camera.model_copy(update={"pixels": (columns, rows), "rays_per_pixel": 1})
    seen = scene.model_copy(update={"camera": few})
    settings = replace(settings_for(scene), method="source", audit=False, order=0, gather=False)
    background_K = chosen.quadrature.reference_K
    shares = np.array([float(node.share(background_K)) for node in chosen.nodes])
    for depth in range(coarse, cube.depth + 1):
        trees = prepared.octrees(cube.at(depth), prepared.properties.sources)
        try:
            traces = [trace(tree, seen, device, settings) for tree in trees]
        except TransportError:  # cells so large reach behind a patch
            continue
        each = np.array([1.0 - one.weights.background.astype(float) for one in traces])
        return each, np.asarray(np.tensordot(shares, each, 1))
    each = np.ones((len(shares), rows, columns))  # the medium may be anywhere
    return each, each[0]
