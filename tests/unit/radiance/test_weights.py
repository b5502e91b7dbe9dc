"""Means of weights, for times and members of an ensemble."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.radiance.weights import Weights, compose


def test_mean_is_the_mean_of_radiance() -> None:
    """For any boundary, by equal and by given shares; patches included."""
    rng = np.random.default_rng(1)
    names = ("background", "wall", "vapour", "liquid", "lamp")
    parts = [
        Weights.of({name: rng.random((3, 4)).astype(np.float32) for name in names})
        for _ in range(3)
    ]

    def radiance(weights: Weights) -> np.ndarray:
        return compose(weights, background=3.0, wall=0.5, patches={"lamp": 7.0})

    each = [radiance(part) for part in parts]
    # Each of the six terms is rounded to single precision once.
    within = 6 * 7.0 * float(np.finfo(np.float32).eps)
    np.testing.assert_allclose(radiance(Weights.mean(parts)), np.mean(each, axis=0), atol=within)
    shares = [0.5, 0.3, 0.2]
    got = radiance(Weights.mean(parts, shares))
    np.testing.assert_allclose(got, np.tensordot(shares, each, 1), atol=within)
    one = Weights.mean(parts[:1])
    assert all(np.array_equal(one.images[name], parts[0].images[name]) for name in names)
    with pytest.raises(ValueError):
        Weights.mean(parts, [0.5, 0.5])
