"""Pixels of an image by the rays that the scene asks for, or that the expected error needs."""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Ints, Reals
from cldit.transport.image import Rays
from cldit.transport.ray_choice import PixelResults, RayChoice
from cldit.transport.result import Subpixels, TraceInput, TraceSettings
from cldit.transport.subpixels import measured_subpixels, sampled_subpixels

_SAMPLES = 7  # that measure the error
_CLOSE = 1.1  # of the allowed error
_GAIN = 0.8  # of an error by more rays: else it is noise of paths, which rays do not reduce


@dataclass(frozen=True)
class TracedPixels:
    """An image, with its pixels' rays.

    halves: (images, C + 1, H, W) weights, the part from within the medium last. middle: the same by
    one ray a pixel; None: `halves` are. across: (H, W) rays across each pixel. subpixels: some
    pixels by many more rays; None: not asked for, or no pixel has a T_app.
    """

    halves: Reals
    middle: Reals | None
    across: Ints
    subpixels: Subpixels | None = None


def traced_pixels(
    rays: Rays,
    trace_input: TraceInput,
    pixels: Ints | None = None,
    rays_wanted: Ints | None = None,
) -> TracedPixels:
    """Traces all pixels, or those of the flat numbers `pixels` (N,) as an image of one row.

    `rays_wanted` (H, W) are the rays across each pixel; None: the number of the scene, or, with
    `settings.rays_K`, as many as the error needs.
    """
    scene, settings, view = trace_input.scene, trace_input.settings, trace_input.view
    columns, rows = view.pixels
    rays_across = scene.camera.rays_across or 1
    if pixels is not None:
        across = np.full(len(pixels), rays_across)
        return TracedPixels(rays.through(pixels, across)[:, :, None, :], None, across[None])
    images = rays.middle()
    if scene.camera.lens is not None and scene.camera.rays_across is None:
        # Four rays across a pixel behind a lens, where neither scene nor error choose them.
        rays_across = 4
    across = (
        np.full(rows * columns, rays_across) if rays_wanted is None else rays_wanted.reshape(-1)
    )
    several = np.flatnonzero(across > 1)
    middle = images.copy() if settings.rays_K is not None or len(several) else None
    subpixels = None
    results = PixelResults.of(view, trace_input.temperature)
    if settings.rays_K is not None:
        choice = RayChoice(rays, images, results)
        subpixels = _chosen(choice, settings)
        across = choice.across
    elif len(several):
        images[:, :, several] = rays.through(several, across[several])

    def shaped(planes: Reals) -> Reals:
        return planes.reshape(*planes.shape[:2], rows, columns)

    halves = shaped(images)
    if settings.subpixels and settings.rays_K is None:
        mean = halves[0] if len(halves) < 2 else (halves[0] + halves[1]) / 2
        subpixels = sampled_subpixels(rays, mean, across, results, settings)
    shown = None if middle is None else shaped(middle)
    return TracedPixels(halves, shown, across.reshape(rows, columns), subpixels)


def _chosen(choice: RayChoice, settings: TraceSettings) -> Subpixels | None:
    """Adds rays until a sample of pixels measures `settings.rays_K` or less."""
    assert settings.rays_K is not None
    before_K = np.inf
    for number in range(_SAMPLES):
        subpixels, error_K = measured_subpixels(choice, settings, number)
        enough = error_K <= _CLOSE * settings.rays_K or error_K > _GAIN * before_K
        if enough or not choice.reach(settings.rays_K):
            break
        before_K = error_K
    return subpixels
