"""Planck's law against mpmath's quadrature, its limits, and its inverse."""

import mpmath
import numpy as np
import pytest

from cldit.errors import SceneError
from cldit.optics.planck import (
    band_radiance,
    band_radiance_slope,
    temperature_of_radiance,
    temperature_slope_of_radiance,
)

FILTERS = [(3.3, 3.5), (2.0, 5.0), (3.4, 3.40001), (0.2, 50.0), (8.0, 14.0), (49.0, 50.0)]
TEMPERATURES = [1.0, 77.0, 5000.0]


def _reference(kelvin: float, filter_um: tuple[float, float], *, slope: bool = False) -> mpmath.mpf:
    """The definition, wavelength by wavelength, in 25 digits."""
    with mpmath.workdps(25):
        h, c, k = mpmath.mpf("6.62607015e-34"), mpmath.mpf(299792458), mpmath.mpf("1.380649e-23")
        t = mpmath.mpf(kelvin)
        low, high = (mpmath.mpf(edge) * mpmath.mpf("1e-6") for edge in filter_um)

        def of_inverse(u: mpmath.mpf) -> mpmath.mpf:  # u = 1 / lambda; d lambda = du / u^2
            x = h * c * u / (k * t)
            value = 2 * c * u**2 / mpmath.expm1(x)
            return value * x * mpmath.exp(x) / mpmath.expm1(x) / t if slope else value

        first, last = 1 / high, 1 / low
        scale = k * t / (h * c)  # one unit of x
        size = of_inverse(first) * min(scale, last - first)  # quad's tolerance is absolute
        cuts = [first]
        while cuts[-1] < last and cuts[-1] - first < 60 * scale:
            cuts.append(min(last, cuts[-1] + 4 * scale))
        return size * mpmath.quad(lambda u: of_inverse(u) / size, cuts)


@pytest.mark.parametrize("filter_um", FILTERS)
@pytest.mark.parametrize("slope", [False, True])
def test_against_mpmath(filter_um: tuple[float, float], slope: bool) -> None:
    function = band_radiance_slope if slope else band_radiance
    for kelvin in TEMPERATURES:
        expected = _reference(kelvin, filter_um, slope=slope)
        got = float(function(kelvin, filter_um=filter_um))
        if expected < 1e-300:  # at the end of float64: gradual underflow
            assert 0.0 <= got < 1e-299
        else:
            # 1e-10 is what is promised to callers; the narrow filter's own width carries 1e-11
            assert abs(got / float(expected) - 1) < 1e-10


def test_limits() -> None:
    values = band_radiance([0.0, 5e-324, 1e-6, 1.0, np.inf, np.nan, -1.0], filter_um=(3.3, 3.5))
    np.testing.assert_array_equal(values, [0, 0, 0, 0, np.inf, np.nan, np.nan])
    slopes = band_radiance_slope([0.0, 5e-324, 1.0, np.nan, -1.0], filter_um=(3.3, 3.5))
    np.testing.assert_array_equal(slopes, [0, 0, 0, np.nan, np.nan])
    # Rayleigh-Jeans: B -> slope * T, next order x / 2 = 2e-6 at 1e9 K
    limit = band_radiance_slope(np.inf, filter_um=(3.3, 3.5))
    assert band_radiance(1e9, filter_um=(3.3, 3.5)) == pytest.approx(limit * 1e9, rel=1e-5)
    assert band_radiance_slope(1e9, filter_um=(3.3, 3.5)) == pytest.approx(limit, rel=1e-9)


@pytest.mark.parametrize("filter_um", FILTERS)
def test_round_trip(filter_um: tuple[float, float]) -> None:
    kelvin = np.concatenate([np.geomspace(1.0, 5000.0, 4001), [1e5, 1e7, 1e9]])
    radiance = band_radiance(kelvin, filter_um=filter_um)
    usable = radiance > 1e-290  # below, float64 has no digits left to invert
    assert usable[kelvin > 60.0].all()
    back = temperature_of_radiance(radiance, filter_um=filter_um)
    # Forward and inverse are one quadrature and its table: 1e-12, plus the rounding of ln B
    # (1e-16 * |ln B| / x).
    np.testing.assert_allclose(back[usable], kelvin[usable], rtol=2e-12)
    slope = temperature_slope_of_radiance(radiance[usable], filter_um=filter_um)
    inverse = band_radiance_slope(kelvin[usable], filter_um=filter_um)
    np.testing.assert_allclose(slope * inverse, 1.0, rtol=1e-8)  # the spline's slope: one order


@pytest.mark.parametrize("filter_um", FILTERS)
def test_many_temperatures_are_read_from_a_table(filter_um: tuple[float, float]) -> None:
    """More than 4096 at once come from a spline; a thousand at once are integrated, each by itself.
    What is promised to callers is 1e-10, for the value and its slope."""
    kelvin = np.geomspace(1.0, 5000.0, 8192)
    for function in (band_radiance, band_radiance_slope):
        table = function(kelvin, filter_um=filter_um)
        direct = np.concatenate(
            [function(part, filter_um=filter_um) for part in np.split(kelvin, 8)]
        )
        normal = direct > 1e-300
        assert normal[kelvin > 60.0].all()
        np.testing.assert_allclose(table[normal], direct[normal], rtol=1e-10)
        assert np.any(table[normal] != direct[normal])  # two ways


def test_inverse_limits() -> None:
    got = temperature_of_radiance(
        [0.0, -0.0, -1.0, np.nan, np.inf, 5e-324, 1e308], filter_um=(3.3, 3.5)
    )
    np.testing.assert_array_equal(got[:5], [0, 0, np.nan, np.nan, np.inf])
    assert 1.0 < got[5] < 10.0  # x = ln(1e24 / 5e-324) = 800 at 5 K
    assert np.isfinite(got[6])
    slope = temperature_slope_of_radiance([0.0, -1.0, np.nan, np.inf], filter_um=(3.3, 3.5))
    np.testing.assert_array_equal(slope[:3], [np.inf, np.nan, np.nan])
    assert slope[3] * band_radiance_slope(np.inf, filter_um=(3.3, 3.5)) == pytest.approx(1.0)


@pytest.mark.parametrize("filter_um", [(3.5, 3.3), (3.4, 3.4), (0.0, 1.0), (np.nan, 3.0)])
def test_no_filter(filter_um: tuple[float, float]) -> None:
    with pytest.raises(SceneError, match="filter_um"):
        band_radiance(300.0, filter_um=filter_um)
