"""Point spread of the lens in focus: diffraction, a given spread, MTF or samples, on weights.

The modulation transfer functions multiply each other, and the coefficients of an image's discrete
cosine transform: that is a convolution with the image mirrored at its edges. It is linear, changes
no even image, and keeps the sum of every image, so it adds no light and keeps the energy balance.

Diffraction by a round aperture of diameter D at the wavelength l has, with f over its cut-off
D / (l s) in the plane at the distance s (Goodman, Introduction to Fourier Optics, 6.3),

    MTF = 2 / pi (arccos f - f sqrt(1 - f^2)).

It is averaged over the filter by the light of a black body. Frequencies beyond the pixels' Nyquist
frequency appear below it in the traced image. A frequency f in 1/pixel so gets the mean MTF of f
and 1 - f, by the share of either in edges, which have 1 / f^4 of their power there. An edge at any
place in a pixel is then blurred to 0.05 of its step in the worst pixel. Weights below 0 beside the
middle of a narrow spread are set to 0: so no pixel gets less than no light.

Samples of a point spread have no symmetry: they multiply the Fourier transform of the mirrored
image, with the same aliases. They keep even images, and the sum of others but for the edges.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Image
from cldit.optics.planck import part_radiance
from cldit.optics.response import edges_um, scene_filter
from cldit.optics.spectral import reference_temperature_K
from cldit.radiance.weights import Weights
from cldit.scene.camera import Camera
from cldit.scene.schema import Scene

_COLDEST_K = 100.0  # colder light has no share in most filters
_RADIAL = 16384  # frequencies of which the MTF is made: 1e-4 apart for discs of 100 pixels
_PARTS = 8  # of the filter, whose Airy discs differ in size by 1 % in one of 0.3 um at 3.4 um


def airy(frequency: Floats) -> Floats:
    """MTF of a round aperture, at frequencies over its cut-off, any shape."""
    f = np.clip(frequency, 0.0, 1.0)
    return np.asarray(2.0 / np.pi * (np.arccos(f) - f * np.sqrt(1.0 - f**2)))


def _disc(phase: Floats) -> Floats:
    """MTF of an even disc, 2 J1(x) / x, any shape; x is 2 pi times radius and frequency."""
    safe = np.where(phase > 1e-6, phase, 1.0)
    return np.where(phase > 1e-6, 2.0 * scipy.special.j1(safe) / safe, 1.0)


def _aliases(count: int, size_m: float) -> list[tuple[Floats, Floats]]:
    """Frequencies (N + 1,) along a side of N pixels, 1/m, and their aliases; with their shares."""
    per_pixel = np.arange(count + 1) / (2.0 * count)
    frequencies = np.stack([per_pixel, 1.0 - per_pixel])
    shares = frequencies[::-1] ** 4 / np.sum(frequencies**4, axis=0)
    return [(f * count / size_m, share) for f, share in zip(frequencies, shares, strict=True)]


@dataclass(frozen=True)
class PointSpread:
    """MTF of a lens for the pixels of the traced image.

    light: share of each wavelength [m] of the filter. camera: with a lens. discs_m: radii in the
    plane of the target of discs out of focus, of equal light; none where rays sample the aperture.
    """

    camera: Camera
    light: tuple[tuple[float, float], ...]
    discs_m: tuple[float, ...] = ()

    @classmethod
    def of(cls, scene: Scene, discs_m: tuple[float, ...] = ()) -> "PointSpread":
        """The point spread of a scene's camera, which has a lens."""
        filter_um = scene_filter(scene)
        middle_K = reference_temperature_K(scene.background.temperatures_K)
        at_K = np.array([max(middle_K, _COLDEST_K)])
        edges = np.linspace(*edges_um(filter_um), _PARTS + 1)
        parts = [
            float(part_radiance(at_K, filter_um=filter_um, low_um=low, high_um=high)[0])
            for low, high in pairwise(edges)
        ]
        middles_m = 0.5e-6 * (edges[:-1] + edges[1:])
        light = [(float(m), part / sum(parts)) for m, part in zip(middles_m, parts, strict=True)]
        return cls(scene.camera, tuple(light), discs_m)

    def mtf(self, per_m: Floats) -> Floats:
        """MTF at spatial frequencies in the plane of the target, 1/m, any shape."""
        camera, lens = self.camera, self.camera.lens
        assert lens is not None
        out = np.ones(per_m.shape)
        if lens.diffraction:
            cutoff = camera.aperture_m / camera.distance_m  # times the wavelength
            out *= sum(share * airy(per_m * long_m / cutoff) for long_m, share in self.light)
        if self.discs_m:
            out *= np.mean([_disc(2.0 * np.pi * radius_m * per_m) for radius_m in self.discs_m], 0)
        on_sensor = per_m * camera.pixel_m / camera.sensor.pitch_m
        if lens.spread_m is not None:
            out *= np.exp(-2.0 * (np.pi * lens.spread_m * on_sensor) ** 2)
        if lens.mtf is not None:
            known_per_mm, values = np.array(lens.mtf).T
            out *= np.interp(1e-3 * on_sensor, known_per_mm, values)
        return np.asarray(out)

    @cached_property
    def transfer(self) -> Floats:
        """(H, W) factor of each coefficient of an image's cosine transform."""
        camera = self.camera
        sides = [
            _aliases(count, size_m)
            for count, size_m in zip(camera.pixels, camera.field_m, strict=True)
        ]
        highest = [float(alias.max()) for _, (alias, _) in sides]
        tabulated = np.linspace(0.0, float(np.linalg.norm(highest)), _RADIAL)
        mtf = self.mtf(tabulated)
        parts = [
            down_share[:, None] * share * np.interp(np.hypot(down[:, None], across), tabulated, mtf)
            for down, down_share in sides[1]
            for across, share in sides[0]
        ]
        transform = np.sum(parts, axis=0)
        spread = np.maximum(scipy.fft.idctn(transform, type=1), 0.0)
        positive = scipy.fft.dctn(spread, type=1)
        return np.asarray((positive / positive[0, 0])[:-1, :-1])

    @cached_property
    def sampled_transfer(self) -> NDArray[np.complex128] | None:
        """(2 H, W + 1) factor of the mirrored image's Fourier transform by samples; None: none."""
        camera, lens = self.camera, self.camera.lens
        if lens is None or lens.point_spread is None:
            return None
        samples = np.array(lens.point_spread)
        sides = []
        for count, size_m, number in zip(
            camera.pixels, camera.field_m, reversed(samples.shape), strict=True
        ):
            step = camera.spread_step_m * count / size_m  # in traced pixels
            places = (np.arange(number) - number // 2) * step
            frequency = np.fft.fftfreq(2 * count)
            alias = frequency - np.where(frequency < 0.0, -1.0, 1.0)
            share = alias**4 / (frequency**4 + alias**4)
            sides.append(
                sum(
                    (part * np.sinc(f * step) ** 2)[:, None]
                    * np.exp(-2j * np.pi * f[:, None] * places)
                    for f, part in ((frequency, share), (alias, 1.0 - share))
                )
            )
        across, down = sides
        transform = down @ samples @ across[: camera.pixels[0] + 1].T
        spread = np.maximum(
            scipy.fft.irfft2(transform, [2 * n for n in reversed(camera.pixels)]), 0.0
        )
        return np.asarray(scipy.fft.rfft2(spread / spread.sum()))

    def image(self, sharp: Image) -> Image:
        """The blurred image (H, W)."""
        out = scipy.fft.idctn(scipy.fft.dctn(sharp.astype(np.float64)) * self.transfer)
        if self.sampled_transfer is not None:
            rows, columns = out.shape
            mirrored = np.pad(out, ((0, rows), (0, columns)), mode="symmetric")
            out = scipy.fft.irfft2(
                scipy.fft.rfft2(mirrored) * self.sampled_transfer, mirrored.shape
            )[:rows, :columns]
        return np.asarray(out, np.float32)

    def __call__(self, weights: Weights) -> Weights:
        """Blurred weights (H, W)."""
        return weights.map(self.image)


def blur_of(scene: Scene) -> Callable[[Weights], Weights]:
    """Point spread of the scene's lens; the weights themselves where nothing spreads them."""
    lens = scene.camera.lens
    if lens is None or not (lens.diffraction or lens.spread_m or lens.mtf or lens.point_spread):
        return lambda weights: weights
    return PointSpread.of(scene)
