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
    pitch_m: Annotated[float, Within(1e-6, 1e-3)] = 15e-6
    f_number: Annotated[float, Within(0.5, 64.0)] = 2.5
    quantum_efficiency: QuantumEfficiency = 0.8  # a number, or a curve
    # None: 25 us (paper, Fig. 6), or less where the scene's brightest pixel would saturate
    integration_time_s: Annotated[float, Within(320e-9, 1.0)] | None = None
    well_electrons: Annotated[float, Within(1e2, 1e9)] = 7e6
    electrons_per_count: Annotated[float, Within(1e-3, 1e6)] = 40.0
    offset_counts: Annotated[float, Within(0.0, 65535.0)] = 200.0
    read_noise_electrons: Annotated[float, Within(0.0, 1e6)] = 200.0
    bits: Annotated[int, Within(8, 16)] = 14
    bad_pixels: Annotated[int, Within(0, 100_000)] = 20


class Camera(Section):
    """Stands on -y of its target and looks along +y; image right is +x, image up is +z."""

    model: Literal["pinhole", "orthographic"] = "pinhole"
    distance_m: Annotated[float, Within(1e-3, 1e3)] = 1.0
    field_m: tuple[Length, Length] = (0.16, 0.16)  # width, height in the plane of the target
    pixels: tuple[Pixels, Pixels] = (1000, 1000)  # columns, rows
    # 1: through the middle; 4, 16, 64: even over the pixel; adaptive: 1, and 16 where it is steep
    rays_per_pixel: Literal[1, 4, 16, 64, "adaptive"] = 1
    target_m: Point | None = None  # the middle of the picture; the domain's centre where left out
    surroundings_K: Temperature = 295.0  # what a front window reflects into the camera
    sensor: Sensor = Sensor()

    @field_validator("pixels", mode="before")
    @classmethod
    def _square(cls, value: object) -> object:
        return (value, value) if isinstance(value, int) else value
