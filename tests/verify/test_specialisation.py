"""A scene compiles in what it needs, and nothing else: read from the built programs' defines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cldit.run import Run

CUBE = (0.05, 0.05, 0.05)
SMALL = {
    "domain": {"edge_m": 0.1, "leaf_edge_m": 0.01},
    "camera": {"pixels": 8},
}
VAPOUR = {"vapour_absorption_per_m": 10.0, "vapour_temperature_K": 500.0}
ABSORBING = {"droplet_absorption_per_m": 10.0, "droplet_temperature_K": 400.0}
SCATTERING = {"droplet_scattering_per_m": 10.0}


@pytest.mark.parametrize(
    ("arrays", "flags"),
    [
        (VAPOUR, {"HAS_VAPOUR"}),
        (ABSORBING, {"HAS_DROPLETS"}),
        ({**VAPOUR, **ABSORBING}, {"HAS_VAPOUR", "HAS_DROPLETS"}),
        ({**VAPOUR, **SCATTERING}, {"HAS_VAPOUR", "HAS_DROPLETS", "HAS_SCATTERING"}),
        ({"vapour_absorption_per_m": 0.0}, set()),
    ],
)
def test_defines(run_block: Callable[..., Run], arrays: dict[str, float], flags: set[str]) -> None:
    run = run_block(arrays, size_m=CUBE, **SMALL)
    built = run.info.defines
    assert {name for name in built["image.cl"] if name.startswith("HAS_")} == flags
    assert ("sweep.cl" in built) == ("HAS_SCATTERING" in flags)
    assert ("source_update.cl" in built) == ("HAS_SCATTERING" in flags)
    assert "BOUNDARY_DISC" in built["image.cl"] and "CAMERA_PINHOLE" in built["image.cl"]


def test_enclosure_compiles_no_disc(run_block: Callable[..., Run]) -> None:
    run = run_block(VAPOUR, size_m=CUBE, **SMALL, background={"shape": "enclosure"})
    assert "BOUNDARY_DISC" not in run.info.defines["image.cl"]
    assert not np.any(run.weights.wall)


def test_parts_that_are_absent_are_zero(run_block: Callable[..., Run]) -> None:
    run = run_block(VAPOUR, size_m=CUBE, **SMALL)
    assert not np.any(run.weights.liquid)
    assert run.info.accuracy_K is None
