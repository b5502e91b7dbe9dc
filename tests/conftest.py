"""What many tests share: one OpenCL device for the whole run."""

from __future__ import annotations

import pytest

from cldit.gpu.device import Device, open_device


@pytest.fixture(scope="session")
def device() -> Device:
    return open_device()
