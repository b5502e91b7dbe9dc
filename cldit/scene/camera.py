"""The infrared camera: position, field of view and sensor.

The sensor's defaults are assumptions, typical of a cooled 640 x 512 InSb camera.
"""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import field_validator, model_validator

from cldit.scene.checks import Former, Section, Within
from cldit.scene.values import (
    Length,
    Pixels,
    Point,
    PointSamples,
    QuantumEfficiency,
    Temperature,
    TransferCurve,
)

USUAL_INTEGRATION_S = 25e-6  # paper, Fig. 6


class Sensor(Section):
    """Sensor and lens of the infrared camera. The defaults are typical values, not measured."""

    pixels: tuple[Pixels, Pixels] = (640, 512)
    """Columns and rows of the sensor."""
    pitch_m: Annotated[float, Within(1e-6, 1e-3)] = 15e-6
    """Distance between the centres of neighbouring pixels."""
    f_number: Annotated[float, Within(0.5, 64.0)] = 2.5
    """f-number of the lens."""
    quantum_efficiency: QuantumEfficiency = 0.8
    """Electrons per photon: a number, pairs of wavelength (um) and value, or a file of pairs."""
    integration_time_s: Annotated[float, Within(320e-9, 1.0)] | None = None
    """Exposure time. Default: 25 us (paper, Fig. 6), less if the brightest pixel would saturate."""
    well_electrons: Annotated[float, Within(1e2, 1e9)] = 7e6
    """Full-well capacity of a pixel."""
    electrons_per_count: Annotated[float, Within(1e-3, 1e6)] = 40.0
    """Conversion gain."""
    offset_counts: Annotated[float, Within(0.0, 65535.0)] = 200.0
    """Counts without light."""
    read_noise_electrons: Annotated[float, Within(0.0, 1e6)] = 200.0
    """Standard deviation of the read noise."""
    bits: Annotated[int, Within(8, 16)] = 14
    """Resolution of the converter; the largest count is 2^bits - 1."""
    bad_pixels: Annotated[int, Within(0, 100_000)] = 20
    """Number of defective pixels, stuck at 0 or at full scale."""


def square_pixel_m(field_m: tuple[float, float], pixels: tuple[int, int]) -> float:
    """Edge of the square pixels of a sensor whose footprint is the largest within the field."""
    return min(size / count for size, count in zip(field_m, pixels, strict=True))


def square_pixels(field_m: tuple[float, float], longer: int) -> tuple[int, int]:
    """Columns and rows of square pixels, `longer` along the longer side of the field."""
    columns, rows = (min(longer, max(1, round(longer * side / max(field_m)))) for side in field_m)
    return columns, rows


class Lens(Section):
    """Lens of finite aperture: what is out of focus is blurred."""

    _former: ClassVar[Former] = {
        "f_number": (None, "use camera.sensor.f_number"),
        "focal_length_m": (None, "it follows from distance_m, field_m and sensor.pitch_m"),
    }

    focus_m: Length | None = None
    """Distance from the camera to the plane in focus. Default: the target's."""
    diffraction: bool = True
    """Diffraction by the aperture, at the wavelengths of the filter."""
    spread_m: Annotated[float, Within(1e-8, 1e-2)] | None = None
    """Standard deviation, on the sensor, of a Gaussian point spread in focus. Default: none."""
    mtf: TransferCurve | None = None
    """Further MTF in focus: pairs of frequency on the sensor (1/mm) and value, or a file."""
    point_spread: PointSamples | None = None
    """Samples of a point spread in focus, as in the image: rows of numbers, or a file or TIFF."""
    point_spread_pixel_m: Annotated[float, Within(1e-8, 1e-3)] | None = None
    """Distance between the samples of `point_spread` on the sensor."""

    @model_validator(mode="after")
    def _stated(self) -> "Lens":
        if (self.point_spread is None) != (self.point_spread_pixel_m is None):
            names = "point_spread", "point_spread_pixel_m"
            missing, present = names if self.point_spread is None else names[::-1]
            raise ValueError(f"{missing}: missing with {present}; allowed: both or none")
        return self


class Camera(Section):
    """Camera on the -y side of the target, looking along +y; image right is +x, image up is +z."""

    _former: ClassVar[Former] = {"exposure_times": (3, "three are solved")}

    model: Literal["pinhole", "orthographic"] = "pinhole"
    """Lines of sight: `pinhole`, all through one point; `orthographic`, parallel."""
    distance_m: Annotated[float, Within(1e-3, 1e3)] = 1.0
    """Distance from the target."""
    field_m: tuple[Length, Length] = (0.16, 0.16)
    """Width and height of the field of view in the plane of the target."""
    pixels: tuple[Pixels, Pixels] = (1000, 1000)
    """Columns and rows of the traced image; one number for a square image."""
    rays_per_pixel: Literal[1, 4, 16, 64, "auto"] = "auto"
    """auto: 1 to 256 for each pixel, chosen by the run; 1: through its centre; else a grid."""
    target_m: Point | None = None
    """Point at the centre of the image. Default: the domain's centre."""
    surroundings_K: Temperature = 295.0
    """Temperature that a front window reflects into the camera."""
    sensor: Sensor = Sensor()
    """Sensor and lens."""
    exposure: Literal["instant", "times", "smear"] = "instant"
    """`instant`: no motion; `times`: mean light of three times; `smear`: droplets move alone."""
    lens: Lens | None = None
    """Lens of the sensor's f-number. Default: none, a pinhole, with everything in focus."""

    @field_validator("pixels", mode="before", json_schema_input_type=Pixels | tuple[Pixels, Pixels])
    @classmethod
    def _square(cls, value: object) -> object:
        return (value, value) if isinstance(value, int) else value

    @field_validator("rays_per_pixel", mode="before")
    @classmethod
    def _auto(cls, value: object) -> object:
        return "auto" if value == "adaptive" else value  # its name in version 0.1

    @model_validator(mode="after")
    def _with_lens(self) -> "Camera":
        if self.lens is None:
            return self
        if self.model != "pinhole":
            raise ValueError(f"lens: given with model {self.model}; allowed: model pinhole")
        if self.rays_per_pixel == 1:
            raise ValueError("rays_per_pixel: 1 with a lens; allowed: auto, 4, 16 or 64")
        if self.lens.point_spread is not None:
            rows, columns = np.shape(self.lens.point_spread)
            size_m = (columns * self.spread_step_m, rows * self.spread_step_m)
            if any(size > field for size, field in zip(size_m, self.field_m, strict=True)):
                raise ValueError(
                    f"lens.point_spread: {size_m[0]:.3g} x {size_m[1]:.3g} m at the target; "
                    f"allowed: at most the field, {self.field_m[0]:g} x {self.field_m[1]:g} m"
                )
        return self

    @property
    def exposure_s(self) -> float:
        """Exposure time of the sensor; 25 us (paper, Fig. 6) if it is not given."""
        return self.sensor.integration_time_s or USUAL_INTEGRATION_S

    @property
    def smear_s(self) -> float:
        """Time over which droplets are spread along their velocity."""
        return self.exposure_s if self.exposure == "smear" else 0.0

    @property
    def pixel_m(self) -> float:
        """Edge of a pixel of the sensor on the target; pixels are square."""
        return square_pixel_m(self.field_m, self.sensor.pixels)

    @property
    def focus_m(self) -> float:
        """Distance from the camera to the plane in focus."""
        return (self.lens and self.lens.focus_m) or self.distance_m

    @property
    def focal_length_m(self) -> float:
        """Focal length of the lens, which images the field onto the sensor."""
        sensor_m = self.distance_m * self.sensor.pitch_m / self.pixel_m  # behind the lens
        return 1.0 / (1.0 / self.focus_m + 1.0 / sensor_m)

    @property
    def aperture_m(self) -> float:
        """Diameter of the lens' aperture; 0 for a pinhole."""
        return 0.0 if self.lens is None else self.focal_length_m / self.sensor.f_number

    @property
    def spread_step_m(self) -> float:
        """Distance between samples of the given point spread, at the target; 0 without one."""
        on_sensor_m = (self.lens and self.lens.point_spread_pixel_m) or 0.0
        return on_sensor_m * self.pixel_m / self.sensor.pitch_m

    @property
    def seen_through(self) -> str:
        """The lens, or the pinhole or parallel lines of sight in its place, for reports."""
        if self.lens is None:
            return f"none ({self.model})"
        return (
            f"f/{self.sensor.f_number:g}, focal length {1e3 * self.focal_length_m:.4g} mm, "
            f"in focus at {self.focus_m:g} m"
        )

    @property
    def rays_across(self) -> int | None:
        """Rays across each pixel, whose square is their number; None: the run chooses them."""
        return None if self.rays_per_pixel == "auto" else math.isqrt(self.rays_per_pixel)
