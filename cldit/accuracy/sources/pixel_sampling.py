"""Error by the rays that sample the area of a pixel, measured in some of the pixels.

`cldit.transport.subpixels` draws the pixels and traces them by many more rays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources.base import ErrorSource, remedies
from cldit.accuracy.variant_tracer import VariantTracer, temperature_of
from cldit.optics.visible import VISIBLE_DISC
from cldit.radiance.apparent_temperature import NodeTemperature
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.monte_carlo.pixel_sampling import sampled_square
from cldit.transport.ray_choice import MOST_ACROSS, contrasts

MOST_RAYS = (
    f"no pixel has more than {MOST_ACROSS**2} rays; allowed: more camera.pixels, or a larger "
    "transport.accuracy_K"
)


class _PixelSampling(ErrorSource):
    """Pixels and their rays, which no resolution includes."""

    name = "pixel sampling"
    shared_by = "pixels"
    cost_power = 4 / 3  # at edges the error falls with the number of rays to the power -3/4
    cost_share = 0.3  # rays are the smaller part of most runs
    remedy = remedies(
        "more camera.pixels, or a larger transport.accuracy_K",
        camera__rays_per_pixel="camera.rays_per_pixel: auto",
    )

    def is_free(self, scene: Scene) -> bool:
        return scene.camera.rays_across is None and scene.transport.method == "source"

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        assert at.image is not None
        if at.settings.whole_pixels and at.scene.transport.method == "path":
            return []  # random places in each pixel: part of the noise of paths
        if at.scene.transport.method != "source":
            reason = "not known from random samples; transport.method: source estimates it"
            return [Estimate.unknown(self.name, reason)]
        temperature = temperature_of(at.prepared, visible=at.settings.visible)
        return [pixel_error(temperature, at.image)]

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        return replace(old, pixels_K=share_K)


PIXEL_SAMPLING = _PixelSampling()


def pixel_error(temperature: NodeTemperature, image: ImagePair) -> Estimate:
    """Errors of both results by pixel sampling, from an image (H, W) with its `subpixels`.

    Two halves of the sample have the image's error with independent noise; their product has its
    square as its mean, and one standard error of that is added. The maps are those of sampled
    pixels that are alike.
    """
    name, subpixels = PIXEL_SAMPLING.name, image.subpixels
    results = np.stack(temperature.results(image.weights))
    results[0, ~image.visible(temperature)] = np.nan
    count = int(np.count_nonzero(np.isfinite(results[0])))
    if subpixels is None or not count:
        return Estimate.unknown(name, "no pixel has a T_app")
    pixels = subpixels.sample.pixels
    sampled = temperature.picked(pixels)

    by_rays = image.map(subpixels.sample.pick)
    by_many = ImagePair(subpixels.weights, subpixels.difference)
    if subpixels.references is not None:
        reference_a, reference_b = subpixels.references
        by_rays, by_many = _evaluated(by_rays, reference_a), _evaluated(by_many, reference_b)
    change = np.subtract(*(np.stack(sampled.results(pair.weights)) for pair in (by_rays, by_many)))
    noise = by_rays.noise_K(sampled) - by_many.noise_K(sampled)
    finite = np.isfinite(change) & np.isfinite(noise)
    finite[0] &= by_rays.visible(sampled) & by_many.visible(sampled)
    half_a, half_b = (np.where(finite, change + sign * noise, 0.0)[:, 0] for sign in (1, -1))
    emissivity = 1.0 - image.weights.background.astype(float)
    errors_K, maps_K = [], []
    for contrast, *halves in zip(contrasts(results), half_a, half_b, strict=True):
        square, doubt = subpixels.sample.mean_square(*halves, count=count)
        errors_K.append((max(square, 0.0) + doubt) ** 0.5)
        like, features = np.isfinite(contrast), (emissivity, contrast)
        if image.rays is not None:  # more of them at edges, where more is left as well
            features = emissivity, image.rays.astype(float)
        squares = sampled_square(subpixels.sample, halves[0] * halves[1], features, like)
        maps_K.append(np.sqrt(squares))
    rays = "{0}" if subpixels.across.min() == subpixels.across.max() else "{0} to {1}"
    rays = rays.format(subpixels.across.min() ** 2, subpixels.across.max() ** 2)
    method = f"the image's rays against {rays}, in each of {len(pixels)} pixels"
    return Estimate(Cause(name, errors_K[0], method), errors_K[1], maps_K)


def _evaluated(image: ImagePair, reference: Weights) -> ImagePair:
    """An image (1, N) as DIT evaluates it: its excess over the reference, per visible disc.

    Its weights give T_app like those of pixels that see the background alone; NaN where less of
    the disc is visible than DIT needs.
    """
    seen = reference.background
    # A fit of just half of the background ends above or below it by rounding.
    visible = np.where(seen > VISIBLE_DISC, seen, np.float32(np.nan)).astype(np.float32)
    beyond = reference.images | {"background": np.zeros_like(seen)}
    images = image.weights.images
    mean = Weights.of({name: (weight - beyond[name]) / visible for name, weight in images.items()})
    difference = image.difference
    return ImagePair(
        mean, None if difference is None else difference.map(lambda weight: weight / visible)
    )
