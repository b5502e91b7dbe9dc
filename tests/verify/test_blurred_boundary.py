"""What the blurred boundary takes off, against what three moments cost by Monte Carlo in NumPy.

In a thin cube light is scattered twice at most. Three moments and delta-M then err in the second
scattering as seen from the camera, the one that the final sweeps do not do by the phase function
itself. That error is known exactly: the difference of two integrals over the cube.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.run import Run
from cldit.transport.trace import Trace, trace

EDGE, SIZE, FIELD, BEHIND = 0.2, 0.05, 0.024, 0.08
G, ALBEDO, DEPTH = 0.85, 0.74, 0.3


def block(run_block: Callable[..., Run], radius_m: float, seed: int) -> Run:
    """A cube before a disc of this radius."""
    return run_block(
        {
            "droplet_absorption_per_m": (1 - ALBEDO) * DEPTH / SIZE,
            "droplet_scattering_per_m": ALBEDO * DEPTH / SIZE,
            "droplet_temperature_K": 400.0,
        },
        size_m=(SIZE,) * 3,
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 64},
        camera={"model": "orthographic", "pixels": [15, 15], "field_m": [FIELD, FIELD]},
        background={"radius_m": radius_m, "centre_m": [0.0, BEHIND, 0.0]},
        transport={"phase": {"henyey_greenstein": G}, "audit": False, "seed": seed},
    )


def _turned(d: Floats, cosine: Floats, rng: np.random.Generator) -> Floats:
    """Unit vectors (N, 3) at these angles to `d` (N, 3), turned about it by chance."""
    first = np.cross(d, np.where(np.abs(d[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    first /= np.linalg.norm(first, axis=1)[:, None]
    turn = 2 * np.pi * rng.random(len(d))
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(d, first)
    return np.asarray(cosine[:, None] * d + np.sqrt(1 - cosine**2)[:, None] * across)


def three_moments_cost(radius: float, rng: np.random.Generator, count: int = 1_000_000) -> float:
    """Weight of the background that light scattered twice has too much of, by the mean pixel."""
    half, extinction, forward = SIZE / 2, DEPTH / SIZE, G**3

    def way_out(p: Floats, d: Floats) -> Floats:
        with np.errstate(divide="ignore"):
            return np.asarray(((np.sign(d) * half - p) / d).min(axis=1))

    def disc(p: Floats, d: Floats) -> Floats:
        s = (BEHIND - p[:, 1]) / np.where(d[:, 1] > 0, d[:, 1], 1.0)
        on = p + s[:, None] * d
        hit = (d[:, 1] > 0) & (on[:, 0] ** 2 + on[:, 2] ** 2 <= radius**2)
        return np.asarray(hit, np.float64)

    def cosines() -> Floats:
        u = rng.random(count)
        return np.asarray((1 + G * G - ((1 - G * G) / (1 - G + 2 * G * u)) ** 2) / (2 * G))

    p = rng.uniform(-1, 1, (count, 3)) * [FIELD / 2, half, FIELD / 2]
    weight = SIZE * extinction * ALBEDO * np.exp(-extinction * (p[:, 1] + half))
    d = _turned(np.tile([[0.0, 1.0, 0.0]], (count, 1)), cosines(), rng)
    length = way_out(p, d)
    s = length * rng.random(count)
    weight *= length * extinction * ALBEDO * np.exp(-extinction * s)
    q = p + s[:, None] * d
    exact = _turned(d, cosines(), rng)
    wanted = disc(q, exact) * np.exp(-extinction * way_out(q, exact))
    ahead = forward * disc(q, d) * np.exp(-extinction * (length - s))
    even = rng.normal(size=(count, 3))
    even /= np.linalg.norm(even, axis=1)[:, None]
    cosine = (even * d).sum(axis=1)
    # (1 - f) times 1 + 3 g' x + 5 h' P_2(x), whose moments are (G - f) / (1 - f) and so on.
    smooth = 1 - forward + 3 * (G - forward) * cosine
    smooth += 5 * (G**2 - forward) * (1.5 * cosine**2 - 0.5)
    smooth *= disc(q, even) * np.exp(-extinction * way_out(q, even))
    return float(np.mean(weight * (ahead + smooth - wanted)))


@pytest.mark.slow
@pytest.mark.parametrize("radius_m", [0.015, 0.03])
def test_blurred_boundary_takes_off_what_three_moments_cost(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, radius_m: float
) -> None:
    """Pictures with a sharp and a blurred boundary have the same ordinates, so that their
    difference has hardly any noise.

    Third scatterings add albedo x DEPTH / 2 of it, a ninth. The mean of all places on a ray stands
    for each (3 % of the cost by the integrals above), and a map's bilinear interpolation flattens
    a spot by a tenth: a quarter in all.
    """
    found = {}
    for blurred in (False, True):

        def tuned(*arguments: Any, blurred: bool = blurred, **named: Any) -> Trace:
            tree, scene, device, settings = arguments
            tuning = replace(settings.tuning, blurred_boundary=blurred)
            return trace(tree, scene, device, replace(settings, tuning=tuning), **named)

        monkeypatch.setattr("cldit.transport.trace.trace", tuned)
        runs = [block(run_block, radius_m, seed) for seed in (1, 2)]
        found[blurred] = np.mean([run.weights.background.mean(dtype=float) for run in runs])
    cost = three_moments_cost(radius_m, np.random.default_rng(3))
    assert cost > 3e-4  # the test is of something
    assert found[False] - found[True] == pytest.approx(cost, rel=0.25)
