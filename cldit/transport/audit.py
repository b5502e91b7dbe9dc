"""How far a picture of `source` is from the truth: some of its pixels, traced by `path` as well.

The sweeps' own two halves know how much directions matter, but share what is simplified: the phase
function in the sweeps, and one source in each cell. `path` shares none of it. Of each pixel two
independent answers are traced; the product of their differences from the picture has the square of
the picture's error for its mean, whatever the noise of either.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.kelvin import error_K
from cldit.transport.path import trace_path
from cldit.transport.result import Settings, Trace

Floats = NDArray[np.float64]

_PIXELS = 2000
_SAMPLES = 256  # a pixel: with these about 2 core-seconds on `gdi`
_LONGEST = 50.0  # scatterings of a chain; beyond it the audit would cost more than the picture


def audited(
    cells: OpticalCells, scene: Scene, device: Device, settings: Settings, result: Trace
) -> Trace:
    """`result` with `audit_K`: its RMS error of T_app over pixels of emissivity above 0.05, as
    found in a sample of them, one standard error of that added.

    Traces whose source is as simple as the medium (isotropic, no thick cell) are left as they are;
    those where light is scattered too often to be followed say so in `unaudited`.
    """
    deepest = float(cells.depth[cells.address].max(initial=0.0))
    if not cells.needs.scattering or settings.order is not None:
        return result
    if settings.phase is None and deepest <= settings.thick:
        return result
    often = scatterings(cells, deepest)
    if not settings.audit or often > _LONGEST:
        why = f"light is scattered up to {often:.3g} times" if settings.audit else "not wanted"
        return replace(
            result,
            unaudited=f"no audit by path tracing ({why}): the stated error is that of the "
            "directions alone; thick cells and the phase function may add to it",
        )
    sparse = replace(settings, max_samples=_SAMPLES, accuracy_K=0.0, seed=settings.seed + 1)
    truth = trace_path(cells, scene, device, sparse, None, most=_PIXELS)
    if truth.weights_difference is None or truth.standard_error is None:
        return result
    traced = np.flatnonzero(truth.standard_error.background + truth.standard_error.wall)
    means, spread, mine = (
        _planes(weights, traced, cells)
        for weights in (truth.weights, truth.weights_difference, result.weights)
    )
    products = error_K(mine, mine - means - spread, cells, scene) * error_K(
        mine, mine - means + spread, cells, scene
    )
    products = products[np.isfinite(products)]
    if len(products) < 2:
        return result
    doubt = float(np.std(products)) / len(products) ** 0.5
    error = float(np.sqrt(max(float(np.mean(products)) + doubt, 0.0)))
    seconds = truth.seconds["image"] + truth.seconds["scattering"]
    return replace(result, audit_K=error, seconds={**result.seconds, "audit": seconds})


def scatterings(cells: OpticalCells, deepest: float) -> float:
    """A bound for the mean number of scatterings of a chain: what absorption allows, and what the
    way out does (in a convex body light that enters evenly travels 4 V / S in the mean, whatever
    the scattering: Bardsley and Dubi 1981)."""
    across = deepest * max(cells.box().shape)
    return min(1.0 / max(float(cells.coalbedo.min()), 1e-300), max(across, 1.0))


def _planes(weights: Weights, pixels: NDArray[np.int64], cells: OpticalCells) -> Floats:
    """Weights (C, N) in the order and units of `cells`."""
    planes = []
    for name in cells.needs.components:
        plane = weights.images[name].reshape(-1)[pixels].astype(np.float64)
        planes.append(plane / cells.scale if name in cells.needs.emitters else plane)
    return np.stack(planes)
