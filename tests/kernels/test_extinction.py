"""Helpers of linear extinction in a cell, against NumPy in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.arrays import Floats

COUNT = 4000
LINEAR = "#define LINEAR_COEFFICIENTS 1\n#define EMITTERS 1"
# A line p + t d from t = a on, through the leaf of 1 or 8 cells that has cell (3, 4, 5) in it.
SETUP = """
    __global const real *l = b_ + 6 * i;
    Traversal w = {{l[0], l[1], l[2], l[3], l[4], l[5], a, 3, 4, 5}};
    Crossing at; at.mask = {mask};
    const Extinction k = extinction_along(c, d_ + 3 * i, &w, &at);
"""


def lines(edge: int) -> tuple[list[Floats], Floats, Floats]:
    """Inputs of SETUP; where lines enter the leaf, from its middle; and their lengths in it."""
    rng = np.random.default_rng(edge)
    low = np.array([3, 4, 5]) & ~(edge - 1)
    p, q = rng.uniform(0, edge, (2, COUNT, 3))
    toward = (q - p) / np.linalg.norm(q - p, axis=1, keepdims=True)
    length = np.linalg.norm(q - p, axis=1)
    start = rng.uniform(-20, 20, COUNT)
    origin = low + p - start[:, None] * toward
    density = 10.0 ** rng.uniform(-6, 1.3, COUNT)
    gradient = rng.uniform(-1, 1, (COUNT, 3))
    gradient *= 2 * rng.uniform(0, 0.999, (COUNT, 1)) / np.abs(gradient).sum(1, keepdims=True)
    gradient /= edge
    line = np.concatenate([origin, toward], axis=1)
    inputs = [start, line.reshape(-1), density, gradient.reshape(-1)]
    return inputs, p - edge / 2, length


def along(inputs: list[Floats], entry: Floats) -> tuple[Floats, Floats]:
    """NumPy twin of `extinction_along`: at the entry, and the rise per length."""
    _, line, density, gradient = inputs
    gradient = gradient.reshape(-1, 3)
    rise = density * np.sum(gradient * line.reshape(-1, 6)[:, 3:], axis=1)
    return density * (1 + np.sum(gradient * entry, axis=1)), rise


@pytest.mark.parametrize("edge", [1, 8])
def test_optical_depth(apply: Any, edge: int) -> None:
    """Against Gauss's rule of k along the line, which is exact for what is linear. Places of 1e-6
    of 30 cells count twice their rounding, in units of the mean."""
    inputs, entry, length = lines(edge)
    got = apply(
        "extinction.h",
        "optical_depth(k, e)",
        [*inputs, length],
        defines=LINEAR,
        setup=SETUP.format(mask=edge - 1),
    )
    first, rise = along(inputs, entry)
    expected = length * (first + rise * length / 2)
    even = inputs[2] * length
    np.testing.assert_allclose(got / even, expected / even, atol=2e-5)
    assert np.all(got >= 0)
    assert np.ptp(expected / even) > 0.5


def test_constant_extinction(apply: Any) -> None:
    """Without LINEAR_COEFFICIENTS no gradient is read."""
    inputs, _, length = lines(1)
    got = apply(
        "extinction.h", "optical_depth(k, e)", [*inputs, length], setup=SETUP.format(mask=0)
    )
    np.testing.assert_array_equal(got, np.float32(inputs[2]) * np.float32(length))


@pytest.mark.parametrize("defines", ["", "#define USE_FLOAT64 1\n"])
def test_place_of_a_part(apply: Any, device: Any, defines: str) -> None:
    """The light lost up to the place is the wanted part of what the crossing takes."""
    if defines and not device.info.float64:
        pytest.skip("the device has no double precision")
    inputs, entry, length = lines(1)
    first, rise = along(inputs, entry)
    rng = np.random.default_rng(1)
    part = rng.uniform(0, 1, COUNT)
    depth = length * (first + rise * length / 2)
    got = apply(
        "extinction.h",
        "length_along(f, absorbed(optical_depth(k, e)), k)",
        [*inputs, length, part],
        defines=defines + LINEAR,
        setup=SETUP.format(mask=0),
    ).astype(float)
    assert np.all((got >= 0) & (got < length * (1 + 1e-3)))
    lost = -np.expm1(-got * (first + rise * got / 2)) / -np.expm1(-depth)
    np.testing.assert_allclose(lost, part, atol=2e-4 if not defines else 1e-9)
