"""The mean of weights, taken one by one."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.radiance.weights import Weights, compose, mean


def _some(seed: int) -> Weights:
    images = np.random.default_rng(seed).random((5, 3, 4)).astype(np.float32)
    return Weights(*images[:4], patches={"port": images[4]})


def test_its_light_is_the_mean_of_the_light() -> None:
    """Transfer is linear: to the rounding of float32, 6e-8 of each of five terms up to 300."""
    every = [_some(seed) for seed in range(7)]

    def light(weights: Weights) -> np.ndarray:
        return compose(weights, background=300.0, wall=200.0, patches={"port": 100.0})

    expected = np.mean([light(one) for one in every], axis=0)
    assert light(mean(iter(every))) == pytest.approx(expected, abs=5 * 300 * 6e-8)


def test_of_none_is_refused() -> None:
    with pytest.raises(ValueError, match="allowed: one or more"):
        mean([])
