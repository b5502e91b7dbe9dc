"""The infrared camera: where it stands, its field and its chip.

The sensor's values are typical of a cooled 640 x 512 InSb camera and are assumptions."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import field_validator

from cldit.scene.checks import Section, Within
from cldit.scene.values import Length, Pixels, Point, QuantumEfficiency, Temperature


class Sensor(Section):
    """The infrared camera's chip. Pitch, f-number, well, read noise: typical, not measured."""

    pixels: tuple[Pixels, Pixels] = (640, 512)
    """Columns and rows of the chip."""
    pitch_m: Annotated[float, Within(1e-6, 1e-3)] = 15e-6
    """Distance of its pixels."""
    f_number: Annotated[float, Within(0.5, 64.0)] = 2.5
    """Of the lens; says how much light a pixel gets."""
    quantum_efficiency: QuantumEfficiency = 0.8
    """Electrons per photon: a number, or a curve over the wavelength."""
    integration_time_s: Annotated[float, Within(320e-9, 1.0)] | None = None
    """Left out: 25 us (paper, Fig. 6), or less where the brightest pixel would saturate."""
    well_electrons: Annotated[float, Within(1e2, 1e9)] = 7e6
    """Electrons at which a pixel is full."""
    electrons_per_count: Annotated[float, Within(1e-3, 1e6)] = 40.0
    """Gain of the converter."""
    offset_counts: Annotated[float, Within(0.0, 65535.0)] = 200.0
    """Counts in the dark."""
    read_noise_electrons: Annotated[float, Within(0.0, 1e6)] = 200.0
    """Standard deviation of the noise that every read adds."""
    bits: Annotated[int, Within(8, 16)] = 14
    """Of the converter; counts end at 2^bits - 1."""
    bad_pixels: Annotated[int, Within(0, 100_000)] = 20
    """How many pixels are stuck at 0 or at full scale."""


class Camera(Section):
    """Stands on -y of its target and looks along +y; image right is +x, image up is +z."""

    model: Literal["pinhole", "orthographic"] = "pinhole"
    """`orthographic` has parallel lines of sight, `pinhole` those from one point."""
    distance_m: Annotated[float, Within(1e-3, 1e3)] = 1.0
    """From the target."""
    field_m: tuple[Length, Length] = (0.16, 0.16)
    """Width and height of the picture in the plane of the target."""
    pixels: tuple[Pixels, Pixels] = (1000, 1000)
    """Columns and rows that are traced; one number for both."""
    rays_per_pixel: Literal[1, 4, 16, 64, "adaptive"] = 1
    """1: through the middle; 4, 16, 64: even over it; adaptive: 1, and 16 where it is steep."""
    target_m: Point | None = None
    """The middle of the picture; the domain's centre where left out."""
    surroundings_K: Temperature = 295.0
    """What a front window reflects into the camera."""
    sensor: Sensor = Sensor()
    """The chip that records."""

    @field_validator("pixels", mode="before", json_schema_input_type=Pixels | tuple[Pixels, Pixels])
    @classmethod
    def _square(cls, value: object) -> object:
        return (value, value) if isinstance(value, int) else value
