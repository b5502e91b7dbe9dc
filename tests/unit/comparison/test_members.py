"""Errors of the mean of few injections, against drawn ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from cldit.comparison.chi_square import chi_square
from cldit.comparison.members import Members
from cldit.run import open_run

RUN = open_run(Path(__file__).parents[2] / "data" / "run-0.1.0")
COUNT = 12


def test_p_is_uniform_for_a_mean_of_twelve() -> None:
    """Two images scatter with normal amplitudes: the mean is as far off as Hotelling's T^2 says.

    With the components of known size p is below 0.05 in 10 % of the draws.
    """
    rng = np.random.default_rng(1)
    seen = np.ones((20, 30), bool)
    half, warm = (np.full(seen.shape, one, np.float32) for one in (0.5, 430.0))
    maps = replace(RUN.maps, emissivity=half, apparent_temperature_K=warm)
    images = rng.standard_normal((2, np.count_nonzero(seen)))
    nothing = np.zeros((COUNT, images.shape[1]))
    kelvin = maps.apparent_temperature_K[seen].astype(float)
    chances = []
    for _ in range(300):
        members = Members.about_mean(RUN, maps, seen, nothing, nothing)
        own = maps.emissivity[seen].astype(float) * members.curve.slope(kelvin)
        amounts = rng.standard_normal((COUNT, 2)) * (3.0, 2.0)
        members = Members.about_mean(RUN, maps, seen, nothing, own * (amounts @ images))
        parts, (rest_K2, _) = members.of_mean
        assert len(parts) == 2 and np.all(rest_K2 < 1e-9)
        change = members.image(amounts.mean(axis=0) @ images + 0.05 * rng.standard_normal(len(own)))
        test = chi_square(
            change,
            np.full(change.shape, 0.05),
            np.array([part.kelvin for part in parts]),
            seen,
            degrees=(np.inf, parts[0].degrees),
        )
        assert test is not None
        chances.append(test.p_value)
    assert 5 <= np.sum(np.array(chances) < 0.05) <= 26  # 15 +- 3.8 expected
    assert kstest(chances, "uniform").pvalue > 1e-3
