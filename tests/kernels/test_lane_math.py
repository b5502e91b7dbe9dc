"""Elementary functions of lanes against NumPy in double precision, over their whole range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device

SINGLE, DOUBLE = np.finfo(np.float32), np.finfo(np.float64)


@pytest.fixture(
    params=[
        "one",
        "eight double",
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("eight", "one double")),
    ]
)
def lanes(request: pytest.FixtureRequest, apply: Any, device: Device) -> Any:
    """Function that applies an expression of `v` to numbers in lane i % 8, and its precision."""
    double = "double" in request.param
    if double and not device.info.float64:
        pytest.skip("the device has no double precision")
    width = 8 if "eight" in request.param else 1
    defines = f"#define SIMD_WIDTH {width}\n" + ("#define USE_FLOAT64 1\n" if double else "")

    def call(expression: str, numbers: Any, exact: Any, bound: Any) -> None:
        info = DOUBLE if double else SINGLE
        numbers = np.asarray(numbers, dtype=info.dtype)
        setup = f"const lane_t v = (lane_t)a; lane_t w = {expression};"
        out = f"LANE(w, i % {width})"
        # The series are in precision; the reference is rounded at most half as much as the result.
        got = apply("spray/lane_math.h", out, [numbers], defines=defines, setup=setup)
        wide = np.longdouble if double else np.float64
        expected = exact(numbers.astype(wide))
        error = np.abs(got - expected) / np.abs(expected).clip(min=info.tiny)
        limit = bound(numbers.astype(float)) if callable(bound) else bound
        assert np.all(error <= limit * info.eps), (error / limit / info.eps).max()

    call.largest = DOUBLE.max if double else SINGLE.max  # type: ignore[attr-defined]
    call.exponents = (-708.0, 709.0) if double else (-87.0, 88.0)  # type: ignore[attr-defined]
    call.smallest = DOUBLE.tiny if double else SINGLE.tiny  # type: ignore[attr-defined]
    return call


def both_signs(low: float, high: float, count: int = 4000) -> np.ndarray:
    positive = np.geomspace(low, high, count)
    return np.concatenate([-positive[::-1], positive])


def test_exp(lanes: Any) -> None:
    low, high = lanes.exponents
    numbers = np.concatenate([np.linspace(low, high, 20001), both_signs(1e-12, 1.0)])
    lanes("exp_of(v)", numbers, np.exp, 2)


def test_exp_beyond_its_range_is_that_at_its_end(lanes: Any) -> None:
    low, high = lanes.exponents
    lanes("exp_of(v)", [low - 1, 100 * low], lambda x: np.exp(low + 0 * x), 2)
    lanes("exp_of(v)", [high + 1, 100 * high], lambda x: np.exp(high + 0 * x), 2)


def test_expm1(lanes: Any) -> None:
    low, high = lanes.exponents
    numbers = np.concatenate([np.linspace(low, high, 20001), both_signs(1e-30, 10.0)])
    lanes("expm1_of(v)", numbers[numbers != 0], np.expm1, 3)


def test_log(lanes: Any) -> None:
    near = 1 + both_signs(1e-3, 0.9)
    numbers = np.concatenate([np.geomspace(lanes.smallest, lanes.largest / 4, 20001)[1:-1], near])
    lanes("log_of(v)", numbers[numbers != 1], np.log, 3)


def test_log1p(lanes: Any) -> None:
    numbers = np.concatenate(
        [both_signs(1e-30, 0.999), np.geomspace(0.1, lanes.largest / 2, 20001)]
    )
    lanes("log1p_of(v)", numbers, np.log1p, 3)


def test_cube_root(lanes: Any) -> None:
    numbers = np.geomspace(1e-290 if lanes.smallest < 1e-300 else 1e-30, lanes.largest / 4, 20001)[
        :-1
    ]
    lanes("cube_root(v)", numbers, np.cbrt, 3)


@pytest.mark.parametrize("power", [0.077, 0.687, -1 / 0.687])
def test_power(lanes: Any, power: float) -> None:
    numbers = np.geomspace(1e-20, 1e20, 20001)
    # The power itself is rounded to half of EPS.
    lanes(
        f"power_of(v, R({power!r}))",
        numbers,
        lambda x: x**power,
        lambda x: 3 + 2 * np.abs(power * np.log(x)),
    )
