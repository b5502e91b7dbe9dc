"""Division of work among a device and the others that it was opened with."""

from __future__ import annotations

import numpy as np

from cldit.gpu.device import Device


def shares(device: Device, count: int) -> list[tuple[Device, range]]:
    """Range of `count` rows or pixels for each device, in proportion to its compute units."""
    devices = (device, *device.others)
    units = np.cumsum([0, *(one.info.compute_units for one in devices)])
    bounds = [round(count * int(unit) / int(units[-1])) for unit in units]
    return [
        (one, range(first, last))
        for one, first, last in zip(devices, bounds[:-1], bounds[1:], strict=True)
    ]
