"""What the rays of a picture miss of the light of its whole pixels, measured in some of them.

`cldit.transport.subpixels` draws the pixels and traces them by many more rays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.errors import Cause
from cldit.accuracy.picture import Picture, Step
from cldit.accuracy.pilot import temperature_of
from cldit.optics.visible import VISIBLE_DISC
from cldit.prepare.probed import Probed
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.subpixels import contrast_K

Floats = NDArray[np.float64]

_NAME, _KEY = "pixel sampling", "camera.rays_per_pixel"


def pixel_error(scene: Scene, probed: Probed, picture: Picture) -> tuple[Cause, Step | None]:
    """Error of T_app by pixel sampling, and its map.

    The sample's two halves see the picture's error with independent noise, whose product has its
    square for its mean; one standard error of that is added. The map is how far pixels are from
    their neighbours, as by which they were drawn, with the RMS that was found.

    Args:
        scene: whose camera has the pixels.
        probed: the medium, for its wavelength.
        picture: (H, W), with its `subpixels`.

    Returns:
        The cause, with its map where there is one.
    """
    found = picture.subpixels
    temperature = temperature_of(scene, probed)
    apparent_K = temperature(picture.weights)
    seen = np.isfinite(apparent_K) & picture.visible
    if found is None or not seen.any():
        return Cause(_NAME, None, "no pixel has a T_app", _KEY), None
    pixels = found.sample.pixels
    few = temperature.picked(pixels)

    here = picture.map(found.sample.pick)
    there = Picture(found.weights, found.difference)
    if found.references is not None:
        one, other = found.references
        here, there = _evaluated(here, one), _evaluated(there, other)
    apart = few(here.weights) - few(there.weights)
    noise = here.noise_K(few) - there.noise_K(few)
    both = np.isfinite(apart) & np.isfinite(noise) & here.visible & there.visible
    first, second = (np.where(both, apart + sign * noise, 0.0)[0] for sign in (1, -1))
    square, doubt = found.sample.mean_square(first, second, count=int(np.count_nonzero(seen)))
    error_K = (max(square, 0.0) + doubt) ** 0.5
    map_K = contrast_K(np.where(seen, apparent_K, np.nan))
    rms_K = float(np.sqrt(np.nanmean(map_K**2)))
    map_K *= error_K / rms_K if rms_K > 0 else 0.0
    how = f"the picture's rays against {found.across**2}, in each of {len(pixels)} pixels"
    return Cause(_NAME, error_K, how, _KEY), Step(error_K, map_K)


def _evaluated(picture: Picture, reference: Weights) -> Picture:
    """A picture as DIT has it: what it shows beyond its reference, over what that sees of the disc.

    Its weights give T_app as those of pixels that see the background alone; NaN where DIT wants to
    see more of it.

    Args:
        picture: (1, N).
        reference: (1, N) without the medium.
    """
    seen = reference.background
    # A fit of just half of the background ends above or below it by rounding.
    whole = np.where(seen > VISIBLE_DISC, seen, np.float32(np.nan)).astype(np.float32)
    beyond = reference.images | {"background": np.zeros_like(seen)}
    images = picture.weights.images
    mean = Weights.of({name: (image - beyond[name]) / whole for name, image in images.items()})
    difference = picture.difference
    return Picture(mean, None if difference is None else difference.map(lambda each: each / whole))
