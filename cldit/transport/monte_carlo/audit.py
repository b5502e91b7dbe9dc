"""Audit of a `source` image: some of its pixels are traced by `path` as well.

The two halves of the ordinates show the error of the quadrature, but share the simplifications: the
phase function's moments, and linear sources in cells. `path` shares none. Each pixel of the sample
gets two independent estimates by `path`. The product of their differences from the image has the
square of the image's error for its mean, whatever the noise of either.

Which pixels, and how many paths? Let e be a pixel's error, and s / sqrt(n) the noise of one
estimate from n paths. The product's mean square is about (e^2 + s^2 / n)^2. The variance of its sum
over the pixels is least where pixels are drawn with probabilities in proportion to e^2 + s^2 / n,
and, for a given total of paths, where n = (s / e)^2. Both e and s come from what a line of sight
scatters. On `gdi`, at any accuracy, e / s is much the same in all pixels; e^2 and s^2 grow with the
2.5th to 3rd power of the light scattered to the camera over the emissivity. No traced value decides
what is traced, so there is no bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.monte_carlo.path import trace_path
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.result import Settings, Trace
from cldit.transport.temperature_error import counted, temperature_error_K
from cldit.transport.view import View

Floats = NDArray[np.float64]


def audited(
    cells: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    result: Trace,
) -> Trace:
    """`result` with `audit_K`, or with the reason for none in `unaudited`.

    `audit_K` is the RMS error of T_app over pixels before the background, of emissivity above 0.05,
    estimated from a sample of them, plus one standard error. A trace without simplifications
    (isotropic, no thick cell) is returned as it is.

    Args:
        view: of the scene.
        settings: of the trace.
        result: the trace, by method `source`.
    """
    deepest = float(cells.depth[cells.address].max(initial=0.0))
    if not cells.needs.scattering or settings.order == 0:
        return result
    if settings.phase is None and deepest <= settings.thick_depth:
        return result
    often = scatterings(cells, deepest, settings.order)
    why = ""
    if not settings.audit:
        why = "not wanted"
    elif often > settings.tuning.audit_scatterings:
        why = f"light is scattered up to {often:.3g} times"
    elif scene.camera.rays_per_pixel != 1:
        why = "its rays go through the middle of a pixel, the image's do not"
    if why:
        return replace(
            result,
            unaudited=f"no audit by path tracing ({why}): the stated error is that of the "
            "ordinates alone; thick cells and the phase function may add to it",
        )
    square, doubt, seconds = mean_square_error(cells, scene, view, device, settings, result.weights)
    if not np.isfinite(square):
        return result
    error = (max(square, 0.0) + doubt) ** 0.5
    return replace(result, audit_K=error, seconds={**result.seconds, "audit": seconds})


def mean_square_error(
    cells: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    weights: Weights,
) -> tuple[float, float, float]:
    """Unbiased estimate of the mean square error of T_app, by `path`.

    The mean is over the pixels before the background of emissivity above 0.05; those that scatter
    nothing have no error.

    Args:
        view: of the scene.
        weights: of the image to audit.

    Returns:
        Mean square error in K^2, below 0 where noise has it so; its standard error; and the
        seconds of both. NaN where no such pixel scatters.
    """
    tuning = settings.tuning
    emissivity = 1.0 - weights.background.reshape(-1).astype(np.float64)
    visible = counted(view, emissivity, np.arange(len(emissivity)))

    def draw(scattered: Floats) -> PixelSample:
        here = visible & (scattered > 0)
        share = np.divide(scattered, emissivity, out=np.zeros_like(scattered), where=here) ** 3
        share[here] += tuning.audit_even * share[here].mean() if here.any() else 0.0
        return PixelSample.of(share, most=tuning.audit_pixels, seed=settings.seed)

    count = int(np.count_nonzero(visible))
    more = max(0.1 / settings.accuracy_K, tuning.audit_pixels / max(count, 1))
    samples = int(
        np.clip(tuning.audit_samples * more, tuning.audit_samples_least, tuning.audit_samples_most)
    )
    sparse = replace(settings, max_samples=samples, accuracy_K=0.0, seed=settings.seed + 1)
    truth = trace_path(cells, scene, device, sparse, None, draw=draw, view=view)
    seconds = truth.seconds["image"] + truth.seconds["scattering"]
    if (
        truth.pixel_sample is None
        or truth.weights_difference is None
        or not len(truth.pixel_sample.pixels)
    ):
        return float("nan"), float("nan"), seconds
    mine = _planes(weights, cells)[:, truth.pixel_sample.pixels]
    means, spread = (_planes(some, cells) for some in (truth.weights, truth.weights_difference))
    one, other = (
        np.nan_to_num(temperature_error_K(mine, mine - each, cells, scene))
        for each in (means + spread, means - spread)
    )
    # Of a product of two numbers with the same mean and noise, this is the variance.
    variance = (one**2 - other**2) ** 2 / 4
    total, doubt = truth.pixel_sample.total(one * other, variance)
    return total / count, doubt / count, seconds


def scatterings(cells: OpticalCells, deepest: float, order: int | None) -> float:
    """Bound of the mean number of scatterings of a path.

    The order and absorption bound it, and so does the size: in a convex body isotropic incident
    light travels 4 V / S in the mean, whatever the scattering (Bardsley and Dubi, SIAM J. Appl.
    Math. 40, 1981).

    Args:
        deepest: largest optical depth of a cell's edge.
        order: most scatterings, None for all.
    """
    across = deepest * max(cells.box().shape)
    most = np.inf if order is None else float(order)
    return min(most, 1.0 / max(float(cells.coalbedo.min()), 1e-300), max(across, 1.0))


def _planes(weights: Weights, cells: OpticalCells) -> Floats:
    """Weights (C, N) in the order and units of `cells`."""
    planes = []
    for name in cells.needs.components:
        plane = weights.images[name].reshape(-1).astype(np.float64)
        planes.append(plane / cells.scale if name in cells.needs.emitters else plane)
    return np.stack(planes)
