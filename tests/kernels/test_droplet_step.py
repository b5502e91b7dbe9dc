"""Closed forms of a droplet's step against the same in extended precision, or their limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device

# Rates, as shares of 1/time, of shrinking and of the relaxation of the temperature.
SHRINK = np.array([-3.0, -1e-3, 1e-7, 1e-3, 0.3, 0.99, 1.0, 1.5, 1e3])
JACOBIAN = np.array([0.0, -1e-9, -1e-3, -0.02, -0.5, -3.0, -40.0, -1e4])
TIME = 4e-6
SPANS = np.array([[TIME], [9 * TIME]])


@pytest.fixture(params=["float", "double"])
def step(request: pytest.FixtureRequest, apply: Any, device: Device) -> Any:
    """Function that applies a helper to columns, and the bound of its error."""
    double = request.param == "double"
    if double and not device.info.float64:
        pytest.skip("the device has no double precision")
    defines = "#define SIMD_WIDTH 1\n#define EVAPORATION inert\n"
    defines += "#define USE_FLOAT64 1\n" if double else ""
    kind = np.float64 if double else np.float32

    def call(expression: str, *columns: Any) -> tuple[Any, list[Any]]:
        rounded = [np.ravel(column).astype(kind) for column in np.broadcast_arrays(*columns)]
        got = apply("spray/droplet_step.h", expression, rounded, defines=defines)
        return got.astype(np.longdouble), [column.astype(np.longdouble) for column in rounded]

    # Half of FIRM (1e-6; 3e-4), and some roundings of 1 over the other half.
    call.bound = 1e-6 if double else 2e-3  # type: ignore[attr-defined]
    call.eps = float(np.finfo(kind).eps)  # type: ignore[attr-defined]
    return call


def theta(shrink: Any, time: Any) -> Any:
    """Integral of dt/s; infinite for droplets that vanish."""
    x = np.minimum(shrink * time, 1)
    ends = x > 1 - 2e-6
    return np.where(ends, np.inf, -np.log1p(-np.where(ends, 0, x)) / shrink)


def test_theta(step: Any) -> None:
    """Up to s = 1e-6; x = 1 - s itself is rounded, which changes ln s by eps/s."""
    got, (shrink, time) = step("theta_of(a, b)", SHRINK / TIME, TIME)
    exact = theta(shrink, time)
    ends = ~np.isfinite(exact)
    assert np.all(got[ends] > 1e29)
    assert np.all(np.abs(got / exact - 1)[~ends] < 200 * step.eps)


def test_mean_rise(step: Any) -> None:
    """The limit of a droplet that vanishes is rate/(shrink - jacobian), for any Jacobian."""
    rate = -7e8
    got, (_, jacobian, shrink, time) = step(
        "mean_rise(a, b, c, d)", rate, JACOBIAN / TIME, SHRINK[:, None] / TIME, TIME
    )
    j = np.minimum(jacobian, -1e-9 / time)
    span = theta(shrink, time)
    y, ends = np.where(j == shrink, 1e-12 * j, j - shrink), np.isinf(span)
    life = np.where(shrink * time > 1, 1 / shrink, time)
    part = rate / j * (np.expm1(y * np.where(ends, 0, span)) / (y * life) - 1)
    exact = np.where(ends, rate / -y, part)
    assert np.all(np.abs(got / exact - 1) < step.bound)


def test_relaxed(step: Any) -> None:
    got, (rate, jacobian, span) = step("relaxed(a, b, c)", 3e6, JACOBIAN / TIME, SPANS)
    j = np.minimum(jacobian, -1e-9 / span)
    assert np.all(np.abs(got / (rate * np.expm1(j * span) / j) - 1) < step.bound)
    got, (_, jacobian, _) = step("relaxed(a, b, c)", 3e6, JACOBIAN[3:] / TIME, 1e30)
    assert np.all(np.abs(got / (3e6 / -jacobian) - 1) < step.bound)


def test_relaxed_ramp(step: Any) -> None:
    got, (rest, jacobian, span) = step("relaxed_ramp(a, b, c)", 3e6, JACOBIAN / TIME, SPANS)
    j = np.minimum(jacobian, -1e-6 / span)
    exact = rest * (np.expm1(j * span) / (j * span) - 1) / j
    assert np.all(np.abs(got / exact - 1) < step.bound)


def test_log_mean(step: Any) -> None:
    ratio = np.concatenate([np.geomspace(1e-30, 0.9, 60), 1 - np.geomspace(1e-12, 0.1, 60)])
    got, (x,) = step("log_mean(a)", ratio)
    near = x == 1
    exact = np.where(near, 1, (x - 1) / np.log(np.where(near, 0.5, x)))
    assert np.all(np.abs(got / exact - 1) < 8 * step.eps + 1e-9 * (x > 1 - 2e-9))
    assert step("log_mean(a)", [0.0, 1.0])[0].tolist() == [0.0, 1.0]
