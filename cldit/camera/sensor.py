"""The sensor of the infrared camera: radiance to electrons to counts.

Mean electrons of a pixel that sees the radiance L:

    N = L * pitch^2 * pi / (4 F^2 + 1) * quantum efficiency * integration time

The lens fills a cone of half angle arctan(1 / (2 F)), so that the irradiance of the pixel is
pi L sin^2 = pi L / (4 F^2 + 1): thin lens, distant object, no losses in the glass.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Reals
from cldit.camera.calibration import Calibration
from cldit.errors import SceneError, TransportError
from cldit.optics.response import Filter, scene_filter
from cldit.scene.camera import USUAL_INTEGRATION_S
from cldit.scene.schema import Scene

# A Poisson distribution of more electrons is drawn as normal: its skewness is below 1 %.
NORMAL_ABOVE_ELECTRONS = 1e4


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """A sensor of `pixels` (columns, rows) behind a lens and a filter.

    `bad_pixel_count` of them, drawn with `seed`, are stuck at 0 or at full scale.
    """

    filter_um: Filter  # includes a quantum efficiency given as a curve
    pixels: tuple[int, int]
    pitch_m: float
    f_number: float
    quantum_efficiency: float
    integration_time_s: float
    well_electrons: float
    electrons_per_count: float
    offset_counts: float
    read_noise_electrons: float
    bits: int
    bad_pixel_count: int
    seed: int

    def __post_init__(self) -> None:
        if self.bad_pixel_count > self.pixels[0] * self.pixels[1]:
            raise SceneError(
                f"camera.sensor.bad_pixels: {self.bad_pixel_count} is outside "
                f"0..{self.pixels[0] * self.pixels[1]}, the number of pixels"
            )
        if self.saturation_counts <= self.offset_counts:
            raise SceneError(
                f"camera.sensor.offset_counts: {self.offset_counts:g} leaves no room below "
                f"saturation at {self.saturation_counts:g} counts"
            )

    @classmethod
    def from_scene(cls, scene: Scene, integration_time_s: float | None = None) -> "SensorModel":
        """The sensor of `scene`, with `integration_time_s` in place of the scene's if given."""
        sensor = scene.camera.sensor
        efficiency = sensor.quantum_efficiency
        return cls(
            filter_um=scene_filter(scene),
            pixels=sensor.pixels,
            pitch_m=sensor.pitch_m,
            f_number=scene.camera.sensor.f_number,
            quantum_efficiency=efficiency if isinstance(efficiency, float) else 1.0,
            integration_time_s=integration_time_s
            or sensor.integration_time_s
            or USUAL_INTEGRATION_S,
            well_electrons=sensor.well_electrons,
            electrons_per_count=sensor.electrons_per_count,
            offset_counts=sensor.offset_counts,
            read_noise_electrons=sensor.read_noise_electrons,
            bits=sensor.bits,
            bad_pixel_count=sensor.bad_pixels,
            seed=scene.rig.seed,
        )

    def exposed_for(self, brightest: float) -> "SensorModel":
        """The sensor with an integration time at which `brightest` fills at most 80 % of the range.

        The time is never longer than before: darker scenes need more shots, not motion blur.
        """
        range_counts = self.saturation_counts - self.offset_counts
        counts = brightest * self.electrons_per_radiance / self.electrons_per_count
        if counts <= 0.8 * range_counts:
            return self
        time_s = self.integration_time_s * 0.8 * range_counts / counts
        return replace(self, integration_time_s=float(f"{time_s:.3g}"))

    @property
    def electrons_per_radiance(self) -> float:
        """Electrons per photon s-1 m-2 sr-1."""
        throughput = self.pitch_m**2 * math.pi / (4.0 * self.f_number**2 + 1.0)
        return throughput * self.quantum_efficiency * self.integration_time_s

    @property
    def saturation_counts(self) -> int:
        """The largest count, limited by the converter or by the full well."""
        full = self.offset_counts + self.well_electrons / self.electrons_per_count
        return int(min(2**self.bits - 1, full))

    def mean_electrons(self, radiance: Reals) -> NDArray[np.float64]:
        """Mean electrons of each pixel, without saturation; any shape."""
        return np.asarray(radiance, np.float64) * self.electrons_per_radiance

    def bad_pixels(self) -> NDArray[np.bool_]:
        """Mask (rows, columns) of the stuck pixels."""
        mask = np.zeros(self.pixels[0] * self.pixels[1], dtype=bool)
        mask[self._stuck()[0]] = True
        return mask.reshape(self.pixels[::-1])

    def _stuck(self) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
        """Flat indices of the stuck pixels, and their counts."""
        rng = np.random.default_rng([self.seed, 0xBAD])
        places = rng.choice(self.pixels[0] * self.pixels[1], self.bad_pixel_count, replace=False)
        full = rng.random(self.bad_pixel_count) < 0.5
        return places, np.where(full, self.saturation_counts, 0).astype(np.uint16)

    def expose(self, radiance: Reals, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Counts (rows, columns) of one exposure: shot and read noise, rounding, saturation.

        radiance: (rows, columns), photons s-1 m-2 sr-1; values below 0 count as 0. rng: random
        generator of the noise.
        """
        if radiance.shape != self.pixels[::-1]:
            raise TransportError(
                f"radiance of shape {radiance.shape}, the sensor has {self.pixels[::-1]}"
            )
        if not np.all(np.isfinite(radiance)):
            raise TransportError(
                f"radiance is not finite in {np.count_nonzero(~np.isfinite(radiance))} pixels"
            )
        mean = np.maximum(self.mean_electrons(radiance), 0.0)
        dim = mean < NORMAL_ABOVE_ELECTRONS
        electrons = mean + np.sqrt(mean) * rng.standard_normal(mean.shape)
        electrons[dim] = rng.poisson(mean[dim])
        electrons += self.read_noise_electrons * rng.standard_normal(mean.shape)
        counts = np.rint(self.offset_counts + electrons / self.electrons_per_count)
        image = np.clip(counts, 0, self.saturation_counts).astype(np.uint16)
        places, values = self._stuck()
        image.reshape(-1)[places] = values
        return image

    def calibration(self) -> Calibration:
        """Calibration of this camera."""
        return Calibration(
            filter_um=self.filter_um,
            counts_per_radiance=self.electrons_per_radiance / self.electrons_per_count,
            offset_counts=self.offset_counts,
            electrons_per_count=self.electrons_per_count,
            read_noise_electrons=self.read_noise_electrons,
            saturation_counts=float(self.saturation_counts),
        )
