"""Cells of optical depth 4, dark and lit from one side: gather and audit against `path`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import load_scene, parse_scene

EDGE = 0.04
CELL = EDGE / 16
SCENE: dict[str, Any] = {
    "size_m": (6 * CELL, 4 * CELL, 6 * CELL),
    "domain": {"edge_m": EDGE, "leaf_edge_m": 1.01 * CELL},
    "camera": {"pixels": [12, 12], "field_m": [8 * CELL, 8 * CELL]},
    "background": {"radius_m": 0.03, "temperatures_K": [400.0, 500.0]},
}
BLOCK = {
    "droplet_absorption_per_m": 0.2 * 4 / CELL,
    "droplet_scattering_per_m": 0.8 * 4 / CELL,
    "droplet_temperature_K": 350.0,
}
PHASE = {"henyey_greenstein": 0.6}


def wall(run: Run) -> Any:
    """Weight of the wall where the block is seen."""
    return run.weights.wall[run.maps.emissivity > 0.5].astype(float)


def test_gather_and_audit(run_block: Callable[..., Run]) -> None:
    """Without gather the wall's weight, some 0.1, is far too low: light that a thick cell sends
    straight back is lost in it. With it, what is left is noise and the simplified phase function of
    nothing at all, as every cell is thick: as near to `path` as two such runs are to each other.

    `path` with 1024 samples of standard deviation under 0.3: 0.01 a pixel, likewise the gather; the
    difference of both is at most 0.014 RMS.
    """
    truth = run_block(
        BLOCK,
        **SCENE,
        transport={"method": "path", "accuracy_K": 1e-3, "max_samples": 1024, "phase": PHASE},
    )
    changes = {
        "accuracy_K": 1e-3,
        "max_samples": 1024,
        "directions": 128,
        "phase": PHASE,
        "seed": 5,
    }
    changes["audit"] = True
    plain = run_block(BLOCK, **SCENE, transport={**changes, "gather": False})
    gathered = run_block(BLOCK, **SCENE, transport=changes)
    error = np.sqrt(np.mean((wall(plain) - wall(truth)) ** 2))
    left = np.sqrt(np.mean((wall(gathered) - wall(truth)) ** 2))
    assert error > 0.03
    assert left < 0.014
    kelvin = plain.maps.apparent_temperature_K - truth.maps.apparent_temperature_K
    kelvin = kelvin[np.isfinite(kelvin) & (truth.maps.emissivity > 0.05)].astype(float)
    true = float(np.sqrt(np.mean(kelvin**2)))
    # The audit is to first order in T_app, and adds its standard error.
    assert plain.info.accuracy_K is not None and gathered.info.accuracy_K is not None
    assert 0.7 * true < plain.info.accuracy_K < 1.5 * true
    assert gathered.info.accuracy_K < 0.4 * true


def test_audit_of_a_sample(run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the pixels give the same error as all, within what a third may miss of it."""
    transport = {"directions": 32, "phase": PHASE, "audit": True, "gather": False}
    whole = run_block(BLOCK, **SCENE, transport=transport).info.accuracy_K
    monkeypatch.setattr("cldit.transport.audit._PIXELS", 30)
    part = run_block(BLOCK, **SCENE, transport=transport).info.accuracy_K
    assert whole is not None and part is not None
    assert 0.5 * whole < part < 2.0 * whole


def test_audit_where_no_pixel_sees_the_spray(device: Device) -> None:
    """As `cldit bench` has it, which measures what a picture of nothing costs."""
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"] |= {"pixels": [8, 8], "field_m": [0.01, 0.01], "target_m": [0.09, 0.0, 0.09]}
    data["domain"]["leaf_edge_m"] = 4e-3
    data["transport"]["phase"] = {"henyey_greenstein": 0.6}
    run = simulate(parse_scene(data), device=device)
    assert run.weights.liquid.max() == 0.0
    assert run.weights.wall.min() == 1.0


def test_what_cannot_be_audited_says_so(run_block: Callable[..., Run]) -> None:
    """Light that would be scattered hundreds of times is not followed."""
    thick = {**BLOCK, "droplet_absorption_per_m": 0.0, "droplet_scattering_per_m": 1e6}
    run = run_block(thick, **SCENE, transport={"audit": True, "directions": 16})
    assert any("no audit by path tracing (light is scattered" in text for text in run.info.remarks)
    unwanted = run_block(BLOCK, **SCENE, transport={"audit": False, "directions": 16})
    assert any("no audit by path tracing (not wanted)" in text for text in unwanted.info.remarks)


def test_chains_that_stop_short_say_so(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the samples that are allowed, or by all chains of a picture; not where noise is wanted."""

    def short(**transport: Any) -> bool:
        run = run_block(BLOCK, **SCENE, transport={"directions": 16, **transport})
        return any("chains in thick cells: stopped" in text for text in run.info.remarks)

    assert short(accuracy_K=1e-3, max_samples=128)
    assert not short(accuracy_K=100.0)
    monkeypatch.setattr("cldit.transport.gather._MOST_CHAINS", 1e4)
    assert short(accuracy_K=1e-3, max_samples=10**6)
