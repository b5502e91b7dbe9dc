"""The quadrature, its order, the nearest ordinate; moments by Legendre's polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import eval_legendre

from cldit.transport.angular_moments import MOMENTS, discrete_to_moment, phase_coefficients
from cldit.transport.discrete_ordinates.quadrature import (
    NEAREST_SIDE,
    Ordinates,
    about_camera,
    focused,
    for_boundary,
    hilbert_order,
    isotropic,
    nearest,
    unfolded,
)
from tests.kernels.reference import moment_to_discrete
from tests.phase_tables import henyey_greenstein


def test_unfolded_sphere() -> None:
    """Axes and middles of octants, worked out by hand; the lower half is folded out to corners."""
    unit = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 1, 1], [1, -1, -1], [-1, -1, -1]], float)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    third = 1 / 3
    wanted = [(1, 0), (0, -1), (0, 0), (third, third), (2 * third, -2 * third)]
    wanted.append((-2 * third, -2 * third))
    np.testing.assert_allclose(unfolded(unit).T, wanted, atol=1e-15)


def test_order_along_a_curve() -> None:
    """Each run of a 32nd of all directions is a patch of the sphere: on average its directions lie
    no further from their mean than 1.5 times those of a cap of as much. In the order in which they
    were made, by height, runs are rings, and lie further."""
    count, runs = 4096, 32
    unit = isotropic(count, np.random.default_rng(1)).unit
    order = hilbert_order(unit)
    assert sorted(order) == list(range(count))

    def spread(numbers: np.ndarray) -> float:
        """RMS distance from the mean of a run."""
        patches = unit[numbers].reshape(runs, -1, 3)
        return float(np.sqrt(patches.var(axis=1).sum(axis=1).mean()))

    # A cap of height h = 2 / runs: its points have a mean height of 1 - h / 2.
    height = 2 / runs
    cap = np.sqrt(1 - (1 - height / 2) ** 2)
    assert spread(order) < 1.5 * cap < spread(np.arange(count))


def test_order_of_few() -> None:
    assert hilbert_order(np.array([[0.0, 0.0, 1.0]])).tolist() == [0]
    assert len(hilbert_order(np.zeros((0, 3)))) == 0


@pytest.mark.parametrize("lean", [0.0, 0.6, -0.9])
def test_weights_integrate_though_directions_lean(lean: float) -> None:
    """Mean of 1, z and z^2 over the sphere: 1, 0 and 1/3; and the density that was asked for."""
    count = 400
    axis = np.array([0.0, 1.0, 0.0])
    rng = np.random.default_rng(2)
    found = focused(count, rng, axis=axis, half_angle_rad=0.5, share=0.2, lean=lean)
    z = found.unit @ axis
    np.testing.assert_allclose(np.linalg.norm(found.unit, axis=1), 1.0, atol=1e-12)
    step = 2 / 320 / (1 - abs(lean))  # the largest, of a midpoint rule
    for power, mean in ((0, 1.0), (1, 0.0), (2, 1 / 3)):
        assert found.weight @ z**power == pytest.approx(mean, abs=step**2)
    around = z < np.cos(0.5)
    assert around.sum() == 320
    # Share of those around the cone that lie below its axis' middle: integral of 1 - lean z.
    edge = np.cos(0.5)
    below, whole = 1 + lean / 2, edge + 1 - lean / 2 * (edge**2 - 1)
    assert (z < 0).sum() / 320 == pytest.approx(below / whole, abs=1 / 320)


def test_share_of_the_cone() -> None:
    """Against the least of a scan of s^2 / n^1.5 + (1 - s)^2 / (N - n)^1.5."""
    count, radius = 1000, 60.0
    found = for_boundary(
        count,
        np.random.default_rng(3),
        low=np.zeros(3),
        high=np.full(3, 2.0),
        disc_centre=np.array([1.0, 101.0, 1.0]),
        disc_radius=radius,
    )
    solid = (1 - np.cos(np.arctan2(radius + 2**0.5, 100.0))) / 2
    inside = np.arange(1, count)
    error = solid**2 / inside**1.5 + (1 - solid) ** 2 / (count - inside) ** 1.5
    chosen = int((found.weight < 0.99 * found.weight.max()).sum())
    assert chosen == pytest.approx(inside[np.argmin(error)], abs=2)


def _few() -> list[Ordinates]:
    """Sets that lack octants, and directions along axes and across planes."""
    planes = np.array([[0.0, 1.0, 0.0], [0.0, -0.6, 0.8], [0.8, 0.6, 0.0], [-0.6, 0.64, 0.48]])
    rng = np.random.default_rng(6)
    forward = henyey_greenstein(0.9)
    sets = [about_camera(count, rng, forward) for count in (4, 8, 12)]
    return [*sets, isotropic(9, rng), Ordinates(planes, np.full(4, 0.25))]


@pytest.mark.parametrize("directions", _few(), ids=["4", "8", "12", "even", "planes"])
def test_nearest_directions_are_of_the_octant(directions: Ordinates) -> None:
    """Or there is none. A component of 0 counts as downwards, as in sweeps."""
    table = nearest(directions)
    assert table.shape == (8, NEAREST_SIDE, NEAREST_SIDE)
    octants = {tuple(up) for up in directions.unit > 0}
    for octant, numbers in enumerate(table):
        up = tuple(bool(octant >> axis & 1) for axis in range(3))
        if up in octants:
            assert np.all((directions.unit[numbers] > 0) == up)
        else:
            assert np.all(numbers == -1)


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
