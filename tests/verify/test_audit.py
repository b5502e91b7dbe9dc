"""The audit finds the error that a picture was given, without bias, and knows how well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.run import Run
from cldit.transport.monte_carlo import audit
from cldit.transport.monte_carlo.path import trace_path
from cldit.transport.trace import Trace
from cldit.transport.tuning import Tuning

from .test_thick import CELL, PHASE
from .test_thick import SCENE as WIDE

SCENE: dict[str, Any] = {name: part for name, part in WIDE.items() if name != "camera"}
# From a cell of optical depth 0.1 to one of 2, across the picture.
DEPTH = np.geomspace(0.1, 2.0, 6)[:, None, None] * np.ones((6, 4, 6)) / CELL
BLOCK = {
    "droplet_absorption_per_m": 0.3 * DEPTH,
    "droplet_scattering_per_m": 0.7 * DEPTH,
    "droplet_temperature_K": 350.0,
}


def camera(pixels: int, field: float = 8 * CELL) -> dict[str, Any]:
    return {"pixels": [pixels, pixels], "field_m": [field, field]}


@pytest.fixture
def to_audit(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Arguments of each audit, none of which is made."""
    kept: list[Any] = []

    def spy(*arguments: Any) -> Trace:
        kept.append(arguments[:2])
        return arguments[1]  # type: ignore[no-any-return]

    monkeypatch.setattr("cldit.transport.trace.audited", spy)
    return kept


def test_unbiased(
    run_block: Callable[..., Run], to_audit: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture of `path` itself, which has its own noise, with an error added to two weights.

    The error is largest where the least is scattered, so chances are as wrong as they can be; the
    audit must only be less sharp. Sixteen audits of 60 of 484 pixels: their mean is good to a
    quarter of one, four of which are allowed. One that took the noise of its chains for an error
    would find 1.5 times as much, one that took all pixels as drawn alike 0.7 times.
    """
    monkeypatch.setattr("cldit.transport.trace.Tuning", lambda: Tuning(audit_pixels=60))
    transport = {"directions": 8, "gather": False, "phase": PHASE, "accuracy_K": 1.0}
    run_block(BLOCK, **SCENE, camera=camera(22), transport=transport)
    given, result = to_audit[0]  # the next is without spray
    cells, settings = given.cells, given.settings
    many = replace(settings, max_samples=512, accuracy_K=0.0, seed=77)
    truth = trace_path(replace(given, settings=many), None)
    assert truth.weights_difference is not None
    # Half of it in the background and half in the wall, of either sign.
    clear = truth.weights.background
    sign = np.random.default_rng(5).choice([-1.0, 1.0], clear.shape)
    shift = np.where(clear < 0.9, 0.02 * (0.2 + clear) * sign, 0.0)
    shifted = replace(
        truth.weights,
        background=(truth.weights.background + shift).astype(np.float32),
        wall=(truth.weights.wall - shift).astype(np.float32),
    )
    mine = audit._planes(shifted, cells)
    added = mine - audit._planes(truth.weights, cells)
    own = audit._planes(truth.weights_difference, cells)
    visible = mine[0] < 0.95
    expected = sum(
        float(np.mean(np.nan_to_num(given.temperature.error_K(mine, part))[visible] ** 2))
        for part in (added, own)
    )
    assert expected > 0.5
    count = int(np.count_nonzero(visible))
    answers = []
    for seed in range(16):
        wanted = replace(settings, seed=seed, audit=True)
        found = audit.audited(
            replace(given, settings=wanted), replace(result, weights=shifted)
        ).audit
        assert found is not None
        places = mine[:, found.sample.pixels]
        one, other = (
            np.nan_to_num(given.temperature.error_K(places, audit._planes(error, cells)))
            for error in found.errors
        )
        answers.append(found.sample.mean_square(one, other, count=count))
    squares, doubts = np.array(answers).T
    scatter = float(squares.std(ddof=1))
    assert abs(squares.mean() - expected) < 4 * scatter / 4
    # Of sixteen the scatter is good to 18 %, and of even steps it is less than of single draws.
    assert 0.6 * scatter < np.sqrt(np.mean(doubts**2)) < 2.0 * scatter


@pytest.mark.parametrize(
    ("shape", "model"),
    [pytest.param("disc", "pinhole", marks=pytest.mark.slow), ("enclosure", "orthographic")],
)
def test_what_stands_before_the_background(
    run_block: Callable[..., Run], to_audit: list[Any], shape: str, model: str
) -> None:
    """As the kernels trace it without spray: round a disc of half the picture, and behind a patch
    that stands before a part of it."""
    patch = {
        "name": "plate",
        "centre_m": [0.0, 0.025, 0.01],
        "facing": "-y",
        "radius_m": 0.008,
        "temperature_K": 300.0,
    }
    scene = SCENE | {"background": SCENE["background"] | {"shape": shape, "radius_m": 0.015}}
    run = run_block(
        BLOCK,
        **scene,
        camera={"model": model, "pixels": [31, 20], "field_m": [0.05, 0.05]},
        patches=[patch],
        transport={"directions": 8, "gather": False},
    )
    seen = to_audit[0][0].view.sees_background
    np.testing.assert_array_equal(seen, run.reference.background > 0.5)
    assert 0.1 < seen.mean() < 0.95


@pytest.mark.parametrize("pixels", [1, 9])
@pytest.mark.slow
def test_few_pixels(run_block: Callable[..., Run], pixels: int) -> None:
    """All are traced; the error of each weight is at most some 0.1, of T_app some 10 K."""
    transport = {"directions": 16, "gather": False, "phase": PHASE, "audit": True}
    run = run_block(BLOCK, **SCENE, camera=camera(pixels, 2 * CELL), transport=transport)
    assert run.info.accuracy_K is not None and 0.0 < run.info.accuracy_K < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("rays", [4, "auto"])
def test_light_from_all_of_a_pixel(run_block: Callable[..., Run], rays: Any) -> None:
    """The audit is of one ray a pixel of the same sources, which err alike; of 81 pixels all are
    audited, and their noise is that of `path` alone."""
    transport = {"directions": 16, "gather": False, "phase": PHASE, "audit": True}
    one = run_block(BLOCK, **SCENE, camera=camera(9, 2 * CELL), transport=transport)
    whole = camera(9, 2 * CELL) | {"rays_per_pixel": rays}
    several = run_block(BLOCK, **SCENE, camera=whole, transport=transport)
    assert several.info.accuracy_K == pytest.approx(one.info.accuracy_K, rel=0.2)


@pytest.mark.slow
def test_thin_isotropic_media_are_audited(run_block: Callable[..., Run]) -> None:
    """Two large cells across, whose sources are not as smooth as the picture has them: halves
    of many directions agree on an error that the audit finds."""
    block = {
        "droplet_absorption_per_m": 0.02 / CELL,
        "droplet_scattering_per_m": 0.18 / CELL,
        "droplet_temperature_K": 350.0,
    }
    scene = SCENE | {"camera": camera(10, 5 * CELL)}
    transport = {"phase": "isotropic", "gather": False, "directions": 128, "accuracy_K": 0.5}
    sure = {"method": "path", "accuracy_K": 0.05, "max_samples": 2048, "seed": 9}
    truth = run_block(block, **scene, transport={**transport, **sure})
    run = run_block(block, **scene, transport={**transport, "audit": True})
    error_K = run.maps.apparent_temperature_K.astype(float) - truth.maps.apparent_temperature_K
    counted = np.isfinite(error_K) & (truth.maps.emissivity > 0.05)
    true = float(np.sqrt(np.mean(error_K[counted] ** 2)))
    assert run.info.accuracy_K is not None
    assert 0.5 * true < run.info.accuracy_K < 2.0 * true


@pytest.mark.parametrize(
    ("albedo", "walls_K"),
    [
        # A conservative medium sees its walls alone: 0.5 K without the quotient ...
        pytest.param(1.0, 370.0, marks=pytest.mark.slow),
        (1.0, 5000.0),  # ... and 27 K
        # At one temperature everything looks alike.
        pytest.param(0.9, 370.0, marks=pytest.mark.slow),
    ],
)
def test_paths_are_balanced(run_block: Callable[..., Run], albedo: float, walls_K: float) -> None:
    """T_app is that of the walls in every pixel, and the noise of the paths is none of its own.

    Each half of the paths is divided by its energy balance, so that what is left is rounding: 1e-5
    of the light at most, of which T_app changes by T^2 / 4200 K at 370 K (Wien), by T at 5000 K.
    """
    block = {
        "droplet_absorption_per_m": (1 - albedo) * 0.5 / CELL,
        "droplet_scattering_per_m": albedo * 0.5 / CELL,
        "droplet_temperature_K": 370.0,
    }
    scene = SCENE | {"walls": {"temperature_K": walls_K}, "camera": camera(4, 5 * CELL)}
    scene["background"] = SCENE["background"] | {"temperatures_K": [300.0, 1000.0]}
    run = run_block(block, **scene, transport={"phase": "isotropic", "audit": True})
    seen_K = run.maps.apparent_temperature_K[run.maps.has_temperature]
    assert np.abs(seen_K.astype(float) - walls_K).max() < 0.05
    assert run.errors is not None
    (trace,) = (cause for cause in run.errors.causes if cause.name == "trace")
    assert trace.error_K is not None and trace.error_K < 0.05 and "path" in trace.how


def test_unknown_is_said(run_block: Callable[..., Run]) -> None:
    """A background that no pixel sees: nowhere is there an apparent temperature."""
    scene = SCENE | {"camera": camera(8)}  # no pixel has its middle on the axis
    scene["background"] = SCENE["background"] | {"radius_m": 1e-6}
    transport = {"directions": 8, "phase": PHASE, "gather": False, "audit": True}
    run = run_block(BLOCK, **scene, transport=transport)
    assert not np.isfinite(run.maps.apparent_temperature_K).any()
    assert run.info.accuracy_K is None
    assert any("not stated: no pixel has a T_app" in text for text in run.info.remarks)
