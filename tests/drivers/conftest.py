"""What several tests of drivers share."""

from __future__ import annotations

import pytest

from tests.aravis import needs_aravis


@pytest.fixture(params=["gige_camera", "aravis_camera"])
def client(request: pytest.FixtureRequest) -> str:
    """Name of a driver for GigE Vision: each client of them."""
    if request.param == "aravis_camera":
        needs_aravis()
    return str(request.param)
