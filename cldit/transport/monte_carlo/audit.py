"""Audit of a `source` image: some of its pixels are also traced by `path`.

The two halves of the ordinates show the error of the quadrature, but share the simplifications: the
moments of the phase function, and few degrees of freedom of sources in cells. `path` has none of
them. Each pixel of the sample has two independent estimates by `path`. The mean of the product of
their differences from the image is the square of the image's error, for any noise of either. Thin
isotropic media are audited too, since both halves share the error of the cell size.

The sample minimises the variance of the audit. Let e be the error of a pixel, and s / sqrt(n) the
noise of one estimate from n paths. The mean square of the product is about (e^2 + s^2 / n)^2. The
variance of its sum over the pixels is smallest if pixels are drawn with probabilities proportional
to e^2 + s^2 / n and, for a given total of paths, if n = (s / e)^2. Both e and s are due to
scattering on the line of sight. On `gdi`, at any accuracy, e / s is nearly the same in all pixels;
e^2 and s^2 grow with the 2.5th to 3rd power of the light scattered to the camera over the
emissivity. No traced value influences the sample, so there is no bias.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cldit.arrays import Floats
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.radiance.weights import Weights
from cldit.transport.cells import OpticalCells
from cldit.transport.monte_carlo.path import trace_path
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.result import Audit, Trace, TraceInput


def audited(trace_input: TraceInput, result: Trace, sample: PixelSample | None = None) -> Trace:
    """Result of a trace by `source` with its `audit`, or with the reason for none in `unaudited`.

    `sample` are the pixels to trace; None: they are drawn here.
    """
    cells, settings = trace_input.cells, trace_input.settings
    if not cells.needs.scattering or settings.order == 0:
        return result  # exact
    often = scatterings(cells, settings.order)
    tuning = settings.tuning
    if not settings.audit:
        return replace(result, unaudited="no audit by path tracing (transport.audit: false)")
    affordable = tuning.audit_scatterings / (often * tuning.audit_samples_least)
    if affordable < tuning.audit_pixels_least:
        return replace(
            result,
            unaudited=f"no audit by path tracing (light is scattered up to {often:.3g} times)",
        )
    weights = result.weights if result.middle is None else result.middle
    emissivity = 1.0 - weights.background.reshape(-1).astype(np.float64)
    visible = trace_input.view.has_temperature(emissivity, np.arange(len(emissivity)))
    drawn_count = int(min(tuning.audit_pixels, affordable))

    def draw(scattered: Floats) -> PixelSample:
        if sample is not None:
            return sample
        eligible = visible & (scattered > 0)
        share = np.divide(scattered, emissivity, out=np.zeros_like(scattered), where=eligible) ** 3
        share[eligible] += tuning.audit_even * share[eligible].mean() if eligible.any() else 0.0
        return PixelSample.of(share, size=drawn_count, seed=settings.seed)

    drawn = min(drawn_count, max(int(np.count_nonzero(visible)), 1))
    affordable_samples = tuning.audit_scatterings / (often * drawn)
    least_samples, most_samples = tuning.audit_samples_least, tuning.audit_samples_most
    samples = int(np.clip(affordable_samples, least_samples, most_samples))
    enough = _enough(
        _planes(weights, cells),
        trace_input.temperature,
        count=max(int(np.count_nonzero(visible)), 1),
        allowed_K2=(tuning.audit_share * settings.accuracy_K) ** 2,
    )
    sparse = replace(settings, max_samples=samples, whole_pixels=False, seed=settings.seed + 1)
    truth = trace_path(replace(trace_input, settings=sparse), None, draw=draw, enough=enough)
    seconds = truth.seconds["image"] + truth.seconds["scattering"]
    if truth.pixel_sample is None or truth.weights_difference is None:
        return result
    if truth.short:  # no reference
        return replace(result, unaudited=f"no audit by {truth.short}")
    places = truth.pixel_sample.pixels
    means, spread = truth.weights.images, truth.weights_difference.images

    def error(sign: float) -> Weights:
        flat = ((name, image.reshape(1, -1)[:, places]) for name, image in weights.images.items())
        return Weights.of({name: plane - means[name] - sign * spread[name] for name, plane in flat})

    return replace(
        result,
        audit=Audit(truth.pixel_sample, (error(1.0), error(-1.0))),
        seconds={**result.seconds, "audit": seconds},
    )


def _enough(
    image: Floats, temperature: TraceTemperature, *, count: int, allowed_K2: float
) -> Callable[[PixelSample, Floats, Floats], bool]:
    """Test whether an audit is precise enough, or more paths would not improve it.

    Args:
        image: (C, P) weights.
        count: pixels with a T_app.
        allowed_K2: square of the wanted standard error.
    """

    def enough(drawn: PixelSample, means: Floats, spread: Floats) -> bool:
        planes = image[:, drawn.pixels]
        lower, upper = (
            np.nan_to_num(temperature.error_K(planes, planes - means + sign * spread))
            for sign in (-1.0, 1.0)
        )
        square, doubt = drawn.mean_square(lower, upper, count=count)
        # A square of many times its standard error does not end the trace by chance.
        if doubt <= max(allowed_K2, square / 4):
            return True
        # Without the noise of the paths, the standard error would be at least 0.7 of its value.
        return drawn.by_noise(lower, upper) <= 0.5

    return enough


def scatterings(cells: OpticalCells, order: int | None) -> float:
    """Estimate of the largest mean number of scatterings of a path, up to `order`.

    Absorption bounds it, and so does the size: in a convex body isotropic incident light has a mean
    path of 4 V / S for any scattering (Bardsley and Dubi, SIAM J. Appl. Math. 40, 1981). In a slab
    this is twice its depth.
    """
    depth = cells.dense(cells.box(), cells.depth)
    across = 2.0 * min(float(depth.sum(axis=axis).max()) for axis in range(3))
    order_limit = np.inf if order is None else float(order)
    return max(1.0, min(order_limit, 1.0 / max(float(cells.coalbedo.min()), 1e-300), across))


def _planes(weights: Weights, cells: OpticalCells) -> Floats:
    """Weights (C, N) in the order and units of `cells`."""
    planes = []
    for name in cells.needs.components:
        plane = weights.images[name].reshape(-1).astype(np.float64)
        planes.append(plane / cells.scale if name in cells.needs.emitters else plane)
    return np.stack(planes)
