"""Images on the stream channel of GigE Vision (GVSP): their packets, and a test image."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tests.emulators import gige_registers as reg

Image = Callable[[int, float], NDArray[np.uint16]]

_HEADERS = 36  # of IP, UDP and GVSP, which the packet size includes


def pattern(sensor: tuple[int, int]) -> Image:
    """14-bit noise that differs from image to image and is reproducible."""
    columns, rows = sensor
    base = np.random.default_rng(7).integers(0, 2**13, (rows, columns), dtype=np.uint16)
    return lambda number, exposure_s: base + np.uint16(number % 2**13)


def image_packets(
    image: NDArray[np.uint16],
    *,
    block: int,
    taken_s: float,
    pixel: int,
    corner: tuple[int, int],
    packet_size: int,
) -> list[bytes]:
    """Leader, parts and trailer of an image, in this order.

    block: number of the image on the stream. pixel: number of the pixel format. corner: column and
    row of its first pixel on the sensor. packet_size: bytes, including all headers.
    """
    kind = "<u2" if pixel == reg.MONO16 else "u1"
    data = np.ascontiguousarray(image, dtype=kind).tobytes()
    rows, columns = image.shape
    stamp = round(1e9 * taken_s)
    leader = struct.pack(">HHQIIIIIHH", 0, 1, stamp, pixel, columns, rows, *corner, 0, 0)
    size = packet_size - _HEADERS
    parts = [data[at : at + size] for at in range(0, len(data), size)]
    bodies = [(1, leader), *((3, part) for part in parts), (2, struct.pack(">HHI", 0, 1, rows))]
    return [
        struct.pack(">HHI", 0, block, (form << 24) | number) + body
        for number, (form, body) in enumerate(bodies)
    ]
