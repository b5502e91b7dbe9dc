"""A scene compiles in the physics that it needs, and none of its values: read from the built
programs' defines."""

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
    ("arrays", "emitters", "scatters"),
    [
        (VAPOUR, 1, False),
        (ABSORBING, 1, False),
        ({**VAPOUR, **ABSORBING}, 2, False),
        ({**VAPOUR, **SCATTERING}, 2, True),
        ({"vapour_absorption_per_m": 0.0}, 0, False),
    ],
)
def test_defines(
    run_block: Callable[..., Run], arrays: dict[str, float], emitters: int, scatters: bool
) -> None:
    built = run_block(arrays, size_m=CUBE, **SMALL).info.defines
    assert built["image.cl"].get("EMITTERS", 0) == emitters
    for name in ("sweep.cl", "source_update.cl"):
        assert (name in built) == scatters
    assert ("HAS_SCATTERING" in built["image.cl"]) == scatters


def test_scenes_that_differ_by_values_share_their_programs(run_block: Callable[..., Run]) -> None:
    """Camera, background, emitter, optical depth, tolerance and cutoff compile nothing anew."""
    parallel = {"pixels": 8, "model": "orthographic"}
    runs = [
        run_block(VAPOUR, size_m=CUBE, **SMALL),
        run_block(ABSORBING, size_m=CUBE, **{**SMALL, "camera": parallel}),
        run_block(VAPOUR, size_m=CUBE, **SMALL, background={"shape": "enclosure"}),
        run_block(VAPOUR, size_m=CUBE, **SMALL, transport={"cutoff": 1e-3}),
        run_block(VAPOUR, size_m=CUBE, **SMALL, transport={"accuracy_K": 0.02}),
    ]
    assert all(run.info.defines == runs[0].info.defines for run in runs)
    assert [bool(np.any(run.weights.wall)) for run in runs] == [True, True, False, True, True]


def test_parts_that_are_absent_are_zero(run_block: Callable[..., Run]) -> None:
    run = run_block(VAPOUR, size_m=CUBE, **SMALL)
    assert not np.any(run.weights.liquid)
    assert run.info.accuracy_K is None
