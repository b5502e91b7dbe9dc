"""Kramers-Kronig against what is known in closed form: Lorentz oscillators and Voigt bands."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.errors import OpticsError
from cldit.optics.kramers_kronig import n_from_k
from cldit.optics.liquid import liquid, liquids


def _lorentz(wavelength_um: np.ndarray) -> np.ndarray:
    """m = sqrt(eps) of an oscillator at 2950 1/cm on top of eps = 1.8, width 30 1/cm."""
    number = 1e4 / wavelength_um
    strength = 0.03 * 2950.0**2
    return np.sqrt(1.8 + strength / (2950.0**2 - number**2 - 30j * number))


def _grid(step_per_cm: float) -> np.ndarray:
    """Fine around the band, and out to where k no longer matters."""
    wings = np.geomspace(300.0, 1e5, 400)
    number = np.union1d(wings, np.arange(2000.0, 4000.0, step_per_cm))
    return 1e4 / number


def test_lorentz_oscillator() -> None:
    """sqrt(eps) is analytic with a constant at infinity: n - n(anchor) follows from k alone.

    k linear over a step h of a band of half width g: h^2 / (8 g^2) = 5.6e-4 of the peak.
    """
    wavelength = _grid(1.0)
    m = _lorentz(wavelength)
    anchor = (2.5, float(_lorentz(np.array([2.5]))[0].real))
    n = n_from_k(wavelength, m.imag, anchor=anchor)
    inside = (wavelength > 2.0) & (wavelength < 5.0)
    assert n[inside] == pytest.approx(m.real[inside], abs=5.6e-4 * np.max(m.imag))


def test_error_falls_with_the_square_of_the_step() -> None:
    errors = []
    for step in (8.0, 4.0, 2.0):
        wavelength = _grid(step)
        m = _lorentz(wavelength)
        anchor = (2.5, float(_lorentz(np.array([2.5]))[0].real))
        n = n_from_k(wavelength, m.imag, anchor=anchor)
        inside = (wavelength > 3.3) & (wavelength < 3.5)
        errors.append(np.sqrt(np.mean((n - m.real)[inside] ** 2)))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.3)


@pytest.mark.parametrize("name", liquids())
def test_shipped_bands_obey_it(name: str) -> None:
    """n of the bands is closed form, n_from_k a quadrature of their k over 2 to 5.6 um.

    What differs is the background of other bands, a smooth curve that is fitted and taken off.
    The narrowest bands are 4 1/cm wide: steps of 0.3 1/cm leave (0.3 / 2)^2 / 8 of k = 0.1.
    """
    known = liquid(name)
    number = np.concatenate([np.arange(1790, 2600, 3), np.arange(2600, 3300, 0.3)])
    wavelength = 1e4 / np.concatenate([number, np.arange(3300, 4970, 3)])
    n, k = known.index(wavelength, known.temperature_K or 0.0)
    found = n_from_k(wavelength, k, anchor=(2.5, float(np.interp(-2.5, -wavelength, n))))
    near = (wavelength > 3.0) & (wavelength < 4.0)
    difference = (n - found)[near]
    ratio = (1e4 / 3000.0 / wavelength[near]) ** 2
    smooth = np.stack([np.ones_like(ratio), ratio, 1 / ratio], axis=1)
    rest = difference - smooth @ np.linalg.lstsq(smooth, difference, rcond=None)[0]
    assert np.max(np.abs(rest)) < 3e-4


def test_order_of_the_table_does_not_matter() -> None:
    wavelength = np.linspace(3.0, 4.0, 200)
    k = 0.1 * np.exp(-(((wavelength - 3.4) / 0.02) ** 2))
    rising = n_from_k(wavelength, k, anchor=(3.1, 1.33))
    falling = n_from_k(wavelength[::-1], k[::-1], anchor=(3.1, 1.33))
    assert falling[::-1] == pytest.approx(rising, abs=1e-12)
    assert n_from_k(wavelength, 0 * k, anchor=(3.1, 1.33)) == pytest.approx(1.33, abs=1e-15)


def test_bad_tables_are_refused() -> None:
    wavelength = np.array([3.0, 3.2, 3.4])
    k = np.array([0.0, 0.1, 0.0])
    for table, message in (
        ((wavelength, -k), "k = -0.1"),
        ((wavelength, [0, np.nan, 0]), "k = nan"),
        ((wavelength[:2], k), "equal numbers"),
        (([3.0, 3.4, 3.2], k), "rise or fall"),
        (([0.0, 3.2, 3.4], k), "positive"),
    ):
        with pytest.raises(OpticsError, match=message):
            n_from_k(*table, anchor=(3.1, 1.3))
    with pytest.raises(OpticsError, match="outside the table"):
        n_from_k(wavelength, k, anchor=(2.0, 1.3))
