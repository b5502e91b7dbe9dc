"""Moments of light and sources against Legendre's polynomials."""

from __future__ import annotations

import numpy as np
from scipy.special import eval_legendre

from cldit.transport.angular_moments import MOMENTS, discrete_to_moment, phase_coefficients
from tests.kernels.reference import moment_to_discrete


def test_addition_theorem() -> None:
    """Light along one direction, scattered by moments 1, g, h: 1 + 3 g P_1 + 5 h P_2 of the
    angle."""
    rng = np.random.default_rng(4)
    one, other = rng.normal(size=(2, 300, 3))
    one /= np.linalg.norm(one, axis=1)[:, None]
    other /= np.linalg.norm(other, axis=1)[:, None]
    cosine = (one * other).sum(axis=1)
    g, h = 0.6, -0.3
    (counts,) = phase_coefficients(np.array([g]), np.array([h])).T
    assert len(counts) == MOMENTS - 1
    got = 1 + np.einsum("m,mn,mn->n", counts, moment_to_discrete(one), discrete_to_moment(other))
    expected = 1 + 3 * g * cosine + 5 * h * eval_legendre(2, cosine)
    np.testing.assert_allclose(got, expected, atol=1e-14)


def test_even_light_has_none() -> None:
    """Gauss's points in height, and as many round the axis, integrate exactly to degree 15."""
    z, weight = np.polynomial.legendre.leggauss(8)
    angle = 2 * np.pi * (np.arange(16) + 0.5) / 16
    across = np.sqrt(1 - z**2)
    x, y = np.outer(across, np.cos(angle)), np.outer(across, np.sin(angle))
    unit = np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=2).reshape(-1, 3)
    even = np.repeat(weight / weight.sum() / 16, 16)
    np.testing.assert_allclose(discrete_to_moment(unit) @ even, 0.0, atol=1e-15)
