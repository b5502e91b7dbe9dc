"""The sum of weights and isothermal emission as a run sees it: near 1, and loud where it is not.

Rationale: see cldit/transport/energy_balance.py. The check is of use only if it finds what it is
for, so kernels are spoiled on purpose, by an amount that no picture would show, and the run
must refuse.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.errors import TransportError
from cldit.gpu import kernel_source
from cldit.run import Run, RunInfo
from cldit.transport.energy_balance import EnergyBalance

EDGE = 0.2


def block(run_block: Callable[..., Run], *, scattering: float = 0.7, **transport: Any) -> Run:
    """At temperatures of their own: no cavity, so that the weights alone prove nothing."""
    per_m = 0.5 / (EDGE / 16)
    return run_block(
        {
            "vapour_absorption_per_m": 0.1 * per_m,
            "droplet_absorption_per_m": 0.2 * per_m,
            "droplet_scattering_per_m": scattering * per_m,
            "vapour_temperature_K": 600.0,
            "droplet_temperature_K": 330.0,
        },
        size_m=(EDGE / 2,) * 3,
        domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 16},
        camera={"pixels": 16, "field_m": [0.15, 0.15]},
        walls={"temperature_K": 300.0},
        transport=transport,
    )


@pytest.mark.parametrize(
    ("changes", "bound"),
    [
        ({}, 1e-4),
        ({"phase": {"henyey_greenstein": 0.85}}, 1e-4),
        pytest.param({"gather": True, "accuracy_K": 1.0}, 1e-4, marks=pytest.mark.slow),
        ({"scattering": 0.0}, 2e-6),
    ],
)
def test_source_closes(
    run_block: Callable[..., Run], changes: dict[str, Any], bound: float
) -> None:
    """The largest of all pixels within the solver's tolerance, or without scattering rounding."""
    found = block(run_block, **changes).info.closure
    assert found is not None
    assert found.value == "largest"
    assert abs(found.mean) <= abs(found.largest) < bound


@pytest.mark.parametrize(
    "transport",
    [
        {"phase": {"henyey_greenstein": 0.85}},
        pytest.param(
            {"phase": {"henyey_greenstein": 0.85}, "gather": False}, marks=pytest.mark.slow
        ),
    ],
)
def test_droplets_of_one_temperature_emit_what_they_hide(
    run_block: Callable[..., Run], transport: dict[str, Any]
) -> None:
    """Of uneven droplets, thick cells among them, what is emitted is the same share of a black
    body's light as the background and the walls lack, whatever scatters: the sum of weights knows
    of emission only that it is missing, and would not tell if its unit were wrong."""
    per_m = np.random.default_rng(4).uniform(0.0, 3.0, (4, 4, 4)) / (EDGE / 16)

    def seen(scattering: float, **more: Any) -> tuple[Any, Any]:
        run = run_block(
            {
                "droplet_absorption_per_m": (1.0 - scattering) * per_m,
                "droplet_scattering_per_m": scattering * per_m,
                "droplet_temperature_K": 330.0,
            },
            size_m=(EDGE / 2,) * 3,
            domain={"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / 16},
            camera={"pixels": 16, "field_m": [0.15, 0.15]},
            transport={"accuracy_K": 1.0, "max_samples": 128, **more},
        )
        return run.weights.liquid, 1.0 - run.weights.background - run.weights.wall

    liquid, hidden = seen(0.0)
    black = float(liquid.sum() / hidden.sum())
    liquid, hidden = seen(0.8, **transport)
    assert hidden.max() > 0.2
    # Each chain keeps its light to rounding; sweeps to what the closure bounds, 1e-3.
    np.testing.assert_allclose(liquid / black, hidden, atol=1e-3)


def test_path_closes_but_for_noise(run_block: Callable[..., Run]) -> None:
    found = block(run_block, method="path", accuracy_K=1.0).info.closure
    assert found is not None
    assert found.value == "mean"
    assert 1e-5 < abs(found.largest) < 0.1
    assert found.bound < 0.02  # five standard errors over 256 pixels of 128 samples


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "before", "after", "transport"),
    [
        ("sweep.cl", "RAYS(own_ray) = outgoing - gap * share;",
         "RAYS(own_ray) = R(0.995) * (outgoing - gap * share);", {}),
        ("sweep.cl", "c == seen ? in->", "c == seen && c != WALL ? in->", {}),
        ("image.cl", "transmitted *= decay(t);", "transmitted *= decay(R(0.99) * t);", {}),
        # What a row that was never written may hold.
        *(
            ("image.cl", "= sum[c] / rays;", f"= row == 7 ? {left} : sum[c] / rays;", {})
            for left in ("R(0)", "R(NAN)")
        ),
        ("path.cl", "weight *= albedo;", "weight *= R(0.95) * albedo;", {"method": "path"}),
        ("branching.cl", "b.transmitted *= decay(t);", "b.transmitted *= decay(R(1.1) * t);",
         {"method": "branching", "order": 1}),
    ],
)  # fmt: skip
def test_spoiled_kernels_are_found(
    run_block: Callable[..., Run],
    monkeypatch: pytest.MonkeyPatch,
    file: str,
    before: str,
    after: str,
    transport: dict[str, Any],
) -> None:
    read = kernel_source.read_source

    def spoiled(name: str) -> str:
        text = read(name)
        if name == file:
            assert before in text
            text = text.replace(before, after)
        return text

    monkeypatch.setattr(kernel_source, "read_source", spoiled)
    with pytest.raises(TransportError, match=r"energy is not conserved: .* allowed: .* row \d+"):
        block(run_block, **{"accuracy_K": 1.0, **transport})


def test_bounds() -> None:
    outside = np.full((2, 3, 4), 0.25)
    within = np.full((3, 4), 0.5)
    assert EnergyBalance.of(outside, within, bound=0.0).largest == 0.0
    within[1, 2] += 0.01
    assert EnergyBalance.of(outside, within, bound=0.011).pixel == (1, 2)
    with pytest.raises(
        TransportError, match=r"\+0\.01 \(largest\); allowed: 0\.009.*row 1, column 2"
    ):
        EnergyBalance.of(outside, within, bound=0.009)
    # As noise of one pixel in twelve it is no evidence; of all of them it is.
    assert EnergyBalance.of(outside, within, bound=0.0, noise=0.02).value == "mean"
    with pytest.raises(TransportError, match="mean"):
        EnergyBalance.of(outside + 0.01, np.full((3, 4), 0.5), bound=0.0, noise=0.02)
    for wrong in (np.nan, np.inf):
        within[2, 3] = wrong
        with pytest.raises(TransportError, match="row 2, column 3"):
            EnergyBalance.of(outside, within, bound=1.0, noise=0.02)


def test_kept_with_the_run(run_block: Callable[..., Run]) -> None:
    info = block(run_block).info
    assert RunInfo.from_dict(json.loads(info.to_json())) == info


def test_few_noisy_pixels_do_not_tell_their_noise() -> None:
    """One pixel that is off by 2e-4 may be noise; one that is off by 3 % is not."""
    half = np.full((1, 1), 0.5)
    assert EnergyBalance.of(half[None] - 2e-4, half, bound=1e-4, noise=0.02).bound == 0.02
    with pytest.raises(TransportError, match="energy is not conserved"):
        EnergyBalance.of(half[None] - 0.03, half, bound=1e-4, noise=0.02)
