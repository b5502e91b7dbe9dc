"""Sums of shots: the variance of one exposure, and what all pixels share."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.dit.drift_axis import Place
from cldit.dit.shots import Sums
from tests.verify.evaluation_bias import Shot

SHAPE = (12, 16)


@pytest.mark.parametrize("steady", [False, True])
@pytest.mark.parametrize("common_removed", [False, True])
def test_variance_is_that_about_a_fit(steady: bool, common_removed: bool) -> None:
    """Against least squares of each pixel over place and image mean."""
    rng = np.random.default_rng(1)
    common = 50.0 * rng.standard_normal(7)[:, None, None] * rng.random(SHAPE)
    images = 4000.0 + common + 5.0 * rng.standard_normal((7, *SHAPE))
    sums = Sums.empty(SHAPE, 16383.0)
    places = np.arange(7.0) * 1.7
    for number, image in enumerate(images):
        shot = Shot(str(number), "injection", 400.0, 400.0, image)
        sums.add(image, shot, place=Place(places[number], 0.0, 0, places[number]))
    columns = [np.ones(7)]
    columns += [places] if steady else []
    columns += [images.mean(axis=(1, 2))] if common_removed else []
    values = images.reshape(7, -1)
    fitted = np.linalg.lstsq(np.array(columns).T, values)[0]
    rest = np.sum((values - np.array(columns).T @ fitted) ** 2, axis=0)
    spare = 6.0 - steady - common_removed
    assert sums.spare(steady=steady, common_removed=common_removed) == pytest.approx(spare)
    variance = sums.variance(steady=steady, common_removed=common_removed)
    np.testing.assert_allclose(variance.ravel(), rest / spare, rtol=1e-6)
    if common_removed:
        assert variance.mean() == pytest.approx(25.0, rel=0.5)  # without the common part of 50
