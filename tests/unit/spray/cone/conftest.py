"""Kernels for the droplets of the cone."""

from __future__ import annotations

import pytest

from cldit.gpu.device import Device
from cldit.spray.cone.wet_bulb import droplet_kernels
from cldit.spray.droplet.arrays import DropletKernels


@pytest.fixture(scope="session")
def kernels(device: Device) -> DropletKernels:
    return droplet_kernels(device)
