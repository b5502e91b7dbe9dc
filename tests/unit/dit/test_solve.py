"""Sums of shots and their places on the axis of a drift; errors of a pixel in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from cldit.arrays import Floats
from cldit.camera.curve import Curve
from cldit.dit.agreement import agreeing
from cldit.dit.drift_axis import BREAK_s, Place, Places, drift_axis
from cldit.dit.maps import Maps, Reason
from cldit.dit.shots import Sums
from cldit.dit.solve import Drift, Signals, solve
from tests.verify.evaluation_bias import Shot

SOURCE = np.array([1.0, 2.0, 4.0])
VARIANCE = 1e-6


def _maps(references: float, injections: float, residual: Floats | float = 0.0) -> Maps:
    """Maps of a pixel that transmits 0.4; the means are off their lines by the `residual` (3,)."""

    def signals(slope: float, start: float, exposures: float) -> Signals:
        return Signals(
            source=SOURCE,
            mean=(slope * SOURCE + start + residual)[:, None, None],
            camera=lambda seen: np.full_like(seen, VARIANCE),
            exposures=np.full(3, exposures),
        )

    return solve(
        signals(1.0, 0.0, references),
        signals(0.4, 0.5, injections),
        usable=np.ones((3, 1, 1), bool),
        curve=Curve(filter_um=(3.3, 3.5)),
    )[0]


@pytest.mark.parametrize(("references", "injections"), [(2.0, 32.0), (32.0, 2.0), (5.0, 5.0)])
def test_each_kind_has_the_error_of_its_own_number(references: float, injections: float) -> None:
    """Var(1 - s / g) = (s / g)^2 Var(g) + Var(s) for g = 1; slopes of a line have VARIANCE over
    the number of exposures and the sum of squares of SOURCE."""
    spread = float(np.sum((SOURCE - SOURCE.mean()) ** 2))
    expected = np.sqrt(VARIANCE / spread * (0.4**2 / references + 1.0 / injections))
    error = _maps(references, injections).emissivity_standard_error[0, 0]
    assert float(error) == pytest.approx(expected, rel=1e-5)


def test_three_backgrounds_have_two_degrees_of_freedom() -> None:
    """A residual in the direction that no line of three points has, of 3 and 2 exposures: its
    square over the variances of both means, of six means and four fitted values."""
    direction = np.cross(SOURCE, np.ones(3))
    residual = 1.5e-3 * direction / np.sqrt(direction @ direction)
    square = 1.5e-3**2 / VARIANCE * (3.0 + 2.0)
    maps = _maps(3.0, 2.0, residual)
    assert maps.reduced_chi2[0, 0] == pytest.approx(square / 2.0, rel=1e-5)
    assert maps.fit_probability[0, 0] == pytest.approx(chi2.sf(square, 2), rel=1e-4)


def test_errors_are_widened_until_they_agree_with_the_residuals() -> None:
    """Four times the variance that is stated, at four backgrounds: errors are doubled, and reduced
    chi-square is 1 of 2 K - 4 = 4 degrees of freedom."""
    image = np.ones((9, 9), np.float32)
    maps = Maps(image, 400.0 * image, 0.01 * image, image, np.zeros((9, 9), np.uint8),
                4.0 * image, 1e-4 * image, image)  # fmt: skip
    widened, remark = agreeing(maps, np.full((9, 9), 4))
    assert "widened by 2 (median)" in remark
    np.testing.assert_allclose(widened.apparent_temperature_standard_error_K, 2.0, rtol=1e-6)
    np.testing.assert_allclose(widened.reduced_chi2, 1.0, rtol=1e-6)
    np.testing.assert_allclose(widened.fit_probability, chi2.sf(4.0, 4), rtol=1e-5)


@pytest.mark.parametrize("slope", [0.0, 1e-60, 1e-200])
def test_a_pixel_that_does_not_see_the_disc_has_no_common_errors(slope: float) -> None:
    """As one of a defective sensor: its emissivity 1 - s / g and all its changes mean nothing."""
    slopes = np.array([1.0, slope])

    def signals(transmission: float, start: float) -> Signals:
        return Signals(
            source=SOURCE,
            mean=(SOURCE[:, None] * transmission * slopes + start)[:, None],
            camera=lambda seen: np.full_like(seen, VARIANCE),
            exposures=np.full(3, 5.0),
        )

    maps, changes = solve(
        signals(1.0, 0.0),
        signals(0.4, 0.5),
        usable=np.ones((3, 1, 2), bool),
        curve=Curve(filter_um=(3.3, 3.5)),
        drifts=[Drift(cause="offset", variance=np.full(3, VARIANCE))],
    )
    assert maps.reason[0].tolist() == [Reason.OK, Reason.BACKGROUND_NOT_VISIBLE]
    assert changes.shape == (2, 3, 1, 2)
    assert np.isfinite(changes[..., 0]).all() and np.isnan(changes[..., 1]).all()


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


@dataclass(frozen=True)
class _Shot:
    background_setpoint_K: float = 400.0
    time_s: float | None = None
    stable_s: float | None = None


def _at(*times_s: float | None) -> list[float]:
    return [place.at for place in drift_axis([_Shot(time_s=time_s) for time_s in times_s]).places]


def test_even_times_lie_where_numbers_do() -> None:
    assert _at(None, None, None, None) == [1.0, 2.0, 3.0, 4.0]
    assert _at(10.0, 12.5, 15.0, 17.5) == [1.0, 2.0, 3.0, 4.0]


def test_a_wait_takes_its_time_in_any_order_of_shots() -> None:
    assert _at(30.0, 0.0, 2.0, 32.0, 34.0, 4.0) == [16.0, 1.0, 2.0, 17.0, 18.0, 3.0]


@pytest.mark.parametrize(
    ("times_s", "cause"),
    [
        ((None, None, None), "shot number: no shot has a time"),
        ((1.0, None, 3.0), "1 of 3 shots have no time"),
        ((1.0, 1.0, 2.0), "some times are equal"),
    ],
)
def test_without_all_times_numbers_count(times_s: tuple[float | None, ...], cause: str) -> None:
    axis = drift_axis([_Shot(time_s=time_s) for time_s in times_s])
    assert [place.at for place in axis.places] == [1.0, 2.0, 3.0]
    assert cause in axis.line(through=False)


def test_a_break_takes_one_interval_and_is_said() -> None:
    times_s = (0.0, 2.0, 4.0, 4.0 + 3.0 * BREAK_s, 6.0 + 3.0 * BREAK_s)
    axis = drift_axis([_Shot(time_s=time_s) for time_s in times_s])
    assert [place.at for place in axis.places] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert [place.part for place in axis.places] == [0, 0, 0, 1, 1]
    assert axis.places[3].lag == pytest.approx(3.0 * BREAK_s / 2.0 - 1.0)
    assert axis.line(through=False).endswith("after a break (3 h) it restarts")
    assert axis.line(through=True).endswith("it continues, as the references show")
    places = Places.of(axis.places)
    np.testing.assert_allclose(places.through().at, 1.0 + np.array(times_s) / 2.0)
    np.testing.assert_allclose(places.about_part_means(places.at), [-1.0, 0.0, 1.0, -0.5, 0.5])


def test_a_wait_for_the_black_body_is_no_break() -> None:
    assert not drift_axis([_Shot(time_s=time_s) for time_s in (0.0, 2.0, 4.0, BREAK_s)]).breaks_s


def test_a_black_body_drifts_from_when_it_was_stable() -> None:
    """Or from the first shot before it, where nobody noted that."""
    noted = drift_axis([_Shot(time_s=time_s, stable_s=-6.0) for time_s in (0.0, 2.0, 4.0)])
    assert [place.since for place in noted.places] == [3.0, 4.0, 5.0]
    warm = [_Shot(500.0, time_s=time_s) for time_s in (40.0, 42.0, 44.0)]
    unnoted = drift_axis([*(_Shot(time_s=time_s) for time_s in (0.0, 2.0, 4.0)), *warm])
    assert [place.since for place in unnoted.places] == [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]
