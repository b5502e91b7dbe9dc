"""Fits of the cone against their derivatives; evaporation against independent figures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.scene.sizes import NukiyamaTanasawa
from cldit.spray.cone import fluid_properties as fuel
from cldit.spray.cone.fluid_properties import (
    heptane_density_kg_m3,
    nitrogen_cp_J_kg_K,
    nitrogen_enthalpy_J_kg,
)
from cldit.spray.cone.wet_bulb import at_rest, d2_law, wet_bulb
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.sizes import strata_m
from tests.verify.droplet_published import LIVES, WET_BULB


def test_latent_heat_between_the_enthalpies() -> None:
    """Exact at the boiling point; elsewhere as far off as the docstring says."""
    t = np.array([fuel.HEPTANE_BOILING_K, 280.0, 390.0, 440.0])
    gap = fuel.heptane_vapour_enthalpy_J_kg(t) - fuel.heptane_liquid_enthalpy_J_kg(t)
    off = np.abs(gap / fuel.heptane_latent_heat_J_kg(t) - 1)
    assert np.all(off < [1e-12, 0.02, 0.02, 0.07])


@pytest.mark.parametrize(
    ("enthalpy", "cp"),
    [
        (fuel.heptane_liquid_enthalpy_J_kg, fuel.heptane_liquid_cp_J_kg_K),
        (fuel.heptane_vapour_enthalpy_J_kg, fuel.heptane_vapour_cp_J_kg_K),
        (nitrogen_enthalpy_J_kg, nitrogen_cp_J_kg_K),
    ],
    ids=["liquid", "vapour", "nitrogen"],
)
def test_cp_is_the_slope_of_enthalpy(enthalpy: Callable[..., Any], cp: Callable[..., Any]) -> None:
    """Central difference: its error is h^2/6 times a third derivative, < 1e-6 at h = 0.05 K."""
    t = np.array([120.0, 190.0, 205.0, 300.0, 371.0, 480.0, 700.0, 999.0, 1001.0, 1800.0])
    slope = (enthalpy(t + 0.05) - enthalpy(t - 0.05)) / 0.1
    assert slope == pytest.approx(cp(t), rel=2e-6)


def test_far_outside_the_fits_everything_stays_finite_and_rising() -> None:
    t = np.linspace(30.0, 3000.0, 500)
    for enthalpy in (
        fuel.heptane_liquid_enthalpy_J_kg,
        fuel.heptane_vapour_enthalpy_J_kg,
        nitrogen_enthalpy_J_kg,
    ):
        assert np.all(np.diff(enthalpy(t)) > 0)


@pytest.mark.parametrize(("pressure_Pa", "gas_K", "lives_us", "halves_us"), LIVES)
def test_life_of_a_droplet(
    kernels: DropletKernels,
    pressure_Pa: float,
    gas_K: float,
    lives_us: tuple[int, ...],
    halves_us: tuple[int, ...],
) -> None:
    """3 % for the other program's mixing rule and latent heats; and what the liquid's density
    changes on its way to the wet bulb, of which only K knows: d^2 goes with its power of 2/3."""
    hot_K, rate, start = wet_bulb(kernels, gas_K=gas_K, pressure_Pa=pressure_Pa, fuel_K=370.0)
    begin = start * 81e-12
    denser = heptane_density_kg_m3(hot_K) / heptane_density_kg_m3(370.0)
    within = 0.03 + abs(float(denser) ** (2 / 3) - 1)
    assert begin / rate == pytest.approx(lives_us[0] * 1e-6, rel=within)
    found = (begin - 0.5 ** (2 / 3) * 81e-12) / rate
    assert found == pytest.approx(halves_us[0] * 1e-6, rel=within)


@pytest.mark.parametrize("row", WET_BULB)
def test_wet_bulb_and_rate(kernels: DropletKernels, row: Any) -> None:
    """0.5 K and 2 %: mixing rule of the film; and half of the last digit of K."""
    pressure_Pa, gas_K, (bulb_K, rate_mm2_s), *_ = row
    hot_K, rate, _ = wet_bulb(kernels, gas_K=gas_K, pressure_Pa=pressure_Pa, fuel_K=370.0)
    assert hot_K == pytest.approx(bulb_K, abs=0.5)
    assert rate * 1e6 == pytest.approx(rate_mm2_s, abs=0.0005 + 0.02 * rate_mm2_s)


def test_more_vapour_than_the_surface_has_condenses_and_boiling_is_bounded(
    kernels: DropletKernels,
) -> None:
    at_369 = at_rest(369.0, kernels, gas_K=369.0, vapour_share=0.0, pressure_Pa=0.6e6)
    assert at_369.mass_kg_s > 0 and at_369.heat_W < 0
    share = 1 - float(np.exp(-1.0))
    assert at_rest(300.0, kernels, gas_K=300.0, vapour_share=share, pressure_Pa=0.6e6).mass_kg_s < 0
    boiling = at_rest([445.0, 460.0], kernels, gas_K=500.0, vapour_share=0.0, pressure_Pa=0.6e6)
    assert 1 < boiling.mass_kg_s[1] / boiling.mass_kg_s[0] < 5


@pytest.mark.parametrize("fuel_K", [300.0, 370.0, 430.0])
def test_distribution_shrinks_as_its_droplets_do(kernels: DropletKernels, fuel_K: float) -> None:
    """Against droplets drawn by mass from the distribution and shrunk one by one; 2e5 of them
    leave 0.2 %, the classes' spacing adds as much."""
    hot_K, rate, start = wet_bulb(kernels, gas_K=570.0, pressure_Pa=0.6e6, fuel_K=fuel_K)
    assert (start < 1) == (fuel_K > hot_K)
    sizes = NukiyamaTanasawa()  # exp(-D/m) D^3 D^3: a Gamma distribution of shape 7 by mass
    state = d2_law(strata_m(sizes, 1024), start)
    drawn = 1.5e-6 * np.random.default_rng(5).gamma(7.0, size=200_000)
    for age in (0.0, 5e-5, 3e-4, 1e-3):
        left = np.clip(start - rate * age / drawn**2, 0.0, 1.0) ** 1.5
        first = np.searchsorted(state.loss_m2, 0.0, side="right") - 1
        loss = age * rate
        f = np.interp(loss, state.loss_m2[first:], state.evaporated[first:])
        assert f == pytest.approx(1 - left.mean(), abs=4e-3)
        d = state.diameters_m(np.atleast_1d(f), 2000)[0]
        # several of 2000 lie in one of 1024 classes, and are equal to rounding
        assert np.all(np.diff(d) >= -1e-9 * d.max()) and d.min() > 0
        small = drawn * np.cbrt(left)
        sauter = left.sum() / (left[small > 0] / small[small > 0]).sum()
        assert 1 / np.mean(1 / d) == pytest.approx(sauter, rel=0.02)
        for count in (1, 2, 4, 8):  # whatever the number of classes
            few = state.diameters_m(np.atleast_1d(f), count)[0]
            assert 1 / np.mean(1 / few) == pytest.approx(1 / np.mean(1 / d), rel=1e-12)
