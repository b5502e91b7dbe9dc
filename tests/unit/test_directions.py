"""Sets of directions, and the order in which neighbours are close by."""

from __future__ import annotations

import numpy as np

from cldit.transport.directions import along_curve, isotropic, unfolded


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
    order = along_curve(unit)
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
    assert along_curve(np.array([[0.0, 0.0, 1.0]])).tolist() == [0]
    assert len(along_curve(np.zeros((0, 3)))) == 0
