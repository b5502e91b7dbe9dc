"""Difference of images without their noise, on images whose noise is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.radiance.weights import Weights

EDGE = 60  # pixels
SEEDS = range(12)


class Temperature:
    """Ten times what is emitted, to have no curve."""

    visible = 0.05

    def results(self, weights: Weights) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return 10.0 * weights.liquid.astype(float), 40.0 * (1.0 - weights.background.astype(float))


def pair(level: Any, noise_K: float, rng: np.random.Generator, *, shared: Any = 0.0) -> ImagePair:
    """Of T_app `level`, plus a noise of `noise_K` RMS in blocks of 3 x 3 pixels, and `shared`."""
    half = rng.normal(0.0, noise_K * 2**0.5, (2, EDGE // 3, EDGE // 3))
    one, other = half.repeat(3, 1).repeat(3, 2) + shared
    nothing = np.zeros((EDGE, EDGE), np.float32)

    def weights(kelvin: NDArray[np.float64], background: float) -> Weights:
        image = (kelvin / 10.0).astype(np.float32)
        return Weights(np.full_like(image, background), nothing, nothing, image)

    return ImagePair(weights(level + (one + other) / 2, 0.5), weights((one - other) / 2, 0.0))


def step(true_K: float, noise_K: float, seed: int, *, shared_K: float = 0.0) -> ImageDifference:
    rng = np.random.default_rng(seed)
    shared = rng.normal(0.0, shared_K, (2, 1, 1))
    one, other = (pair(level, noise_K, rng, shared=shared) for level in (400.0 + true_K, 400.0))
    kelvin: Any = Temperature()
    return ImageDifference.between(kelvin, one, other)[0]


def squares(**given: float) -> NDArray[np.float64]:
    return np.array([step(seed=seed, **given).error_K or 0.0 for seed in SEEDS]) ** 2


@pytest.mark.parametrize("true_K", [0.3, 1.0, 3.0])
def test_noise_is_left_out(true_K: float) -> None:
    """The square's mean is that of the true difference, one standard error added.

    A half's difference has a variance of v = 4 K^2 in each of 400 blocks. So the product's is v^2 +
    2 v t^2. Where t is small, leaving out squares below 0 adds 0.4 standard errors at most.
    """
    doubt = ((16.0 + 8.0 * true_K**2) / 400) ** 0.5
    found = squares(true_K=true_K, noise_K=1.0)
    within = 3 * doubt / len(SEEDS) ** 0.5 + 0.4 * doubt
    assert float(np.mean(found)) == pytest.approx(true_K**2 + doubt, abs=within)
    raw = [np.nanmean(step(true_K, 1.0, seed).map_K ** 2) for seed in SEEDS]
    assert float(np.mean(raw)) == pytest.approx(true_K**2 + 2.0, rel=0.1)  # as if it were a step


def test_noise_that_both_pictures_share_cancels() -> None:
    assert step(0.5, 0.0, 1, shared_K=5.0).error_K == pytest.approx(0.5, rel=1e-3)


def test_without_halves_it_is_the_difference() -> None:
    rng = np.random.default_rng(1)
    one, other = (ImagePair(pair(level, 1.0, rng).weights) for level in (401.0, 400.0))
    kelvin: Any = Temperature()
    found, _ = ImageDifference.between(kelvin, one, other)
    assert found.error_K == pytest.approx(float(np.sqrt(np.nanmean(found.map_K**2))))


def test_own_noise() -> None:
    """Half the difference of the halves is as large as the error of their mean."""
    kelvin: Any = Temperature()
    one = pair(400.0, 1.5, np.random.default_rng(2))
    noise = float(np.sqrt(np.mean(one.noise_K(kelvin)[0] ** 2)))
    assert noise == pytest.approx(1.5, rel=4 / (2 * 400) ** 0.5)
    assert not ImagePair(one.weights).noise_K(kelvin).any()
    clear = ImagePair(Weights(*(np.ones((EDGE, EDGE), np.float32),) * 4))
    assert ImageDifference.between(kelvin, clear, one)[0].error_K is None
    assert ImageDifference.between(kelvin, clear, clear)[1].error_K is None


def test_a_pixel_that_is_clear_in_one_image_has_an_error_of_emissivity() -> None:
    """A hundredth of the pixels see a hole by one ray, of an emissivity of 0.5 that counts as 20 K;
    a tenth are clear in both, and are not counted."""
    kelvin: Any = Temperature()
    rng = np.random.default_rng(1)
    sheet, holes = (pair(400.0, 0.0, rng).weights for _ in range(2))
    for image in (sheet, holes):
        image.background[:, : EDGE // 10] = 1.0
    place = rng.choice(EDGE**2 * 9 // 10, EDGE**2 // 100, replace=False)
    holes.background[:, EDGE // 10 :].flat[place] = 1.0
    warm, emissivity = ImageDifference.between(kelvin, ImagePair(holes), ImagePair(sheet))
    assert warm.error_K == 0.0
    assert emissivity.error_K == pytest.approx((20.0**2 / 90) ** 0.5, rel=1e-3)
    assert np.count_nonzero(emissivity.map_K) == len(place)
