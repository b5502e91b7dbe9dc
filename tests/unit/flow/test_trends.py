"""How a computed spray depends on gas, grid and parcels; against Naber and Siebers and the ECN."""

from __future__ import annotations

import functools

import pytest

from cldit.scene.spray import FlowBox
from cldit.spray.flow.verification import SPRAY_G, Found, at, find, mean_liquid_K

COARSE = FlowBox(spacing_m=2e-3)


@functools.cache
def spray(pressure_MPa: float, gas_K: int) -> Found:
    """On a grid of 2 mm, at 0.95 ms."""
    spec = at(pressure_MPa, gas_K, box=COARSE, droplets_per_parcel=1e4)
    return find(spec, cache=None)


def note(found: Found, name: str) -> float:
    return found.spray.notes[name]


def evaporated(found: Found) -> float:
    return note(found, "vapour_mass_kg") / note(found, "injected_mass_kg")


def test_pressure_and_heat_shorten_the_spray() -> None:
    cold, dense, hot = spray(0.45, 300), spray(0.9, 300), spray(0.9, 600)
    for name in ("vapour_penetration_m", "liquid_penetration_m"):
        # Naber and Siebers: 2^0.25 = 1.19 by the gas's density; half to one and a half of that.
        assert 1.09 < note(cold, name) / note(dense, name) < 1.29
    # At one density the hotter gas leaves less of the liquid, which ends sooner.
    assert note(hot, "liquid_penetration_m") < 0.97 * note(cold, "liquid_penetration_m")
    # At one pressure it is thinner too, and the vapour goes farther.
    assert note(hot, "vapour_penetration_m") > note(dense, "vapour_penetration_m")


def test_droplets_last_in_cold_gas_and_vapour_follows_the_temperature() -> None:
    assert evaporated(spray(0.9, 300)) < evaporated(spray(0.45, 300)) < 0.4
    assert evaporated(spray(0.6, 573)) > 0.8
    assert evaporated(spray(0.9, 600)) > 0.8


def test_nothing_is_colder_than_saturation_and_droplets_have_the_wet_bulb() -> None:
    hot = spray(0.6, 573)
    assert note(hot, "coldest_K") > 369 - 1  # adiabatic saturation, test_measures
    # Wet bulb of the undisturbed gas 386 K, of the vapour-laden gas in the plume less.
    assert 360 < mean_liquid_K(hot.spray) < 386


@pytest.mark.slow
@pytest.mark.parametrize(("pressure_MPa", "gas_K"), [(0.15, 620), (0.6, 573), (0.9, 300)])
def test_naber_and_siebers(pressure_MPa: float, gas_K: int) -> None:
    """Within 15 % for a jet as wide as the plumes are. For the nominal cone hot dense gas is at
    0.84, not within 15 %: 20 % keep it from getting worse."""
    found = find(at(pressure_MPa, gas_K), cache=None)
    assert note(found, "vapour_penetration_m") == pytest.approx(found.as_wide_m, rel=0.15)
    assert note(found, "vapour_penetration_m") == pytest.approx(found.naber_siebers_m, rel=0.20)


@pytest.mark.slow
def test_spray_g() -> None:
    """The ECN's largest liquid penetration is 30 mm, within 5. Up to the end of injection it is;
    afterwards the largest droplets go on to 37 mm: 8 mm keep it from getting worse."""
    history = find(SPRAY_G, cache=None).history
    injecting = history.time_s < 0.8e-3
    assert history.liquid_m[injecting].max() == pytest.approx(30e-3, abs=5e-3)
    assert history.liquid_m.max() == pytest.approx(30e-3, abs=8e-3)


@pytest.mark.slow
def test_grid_parcels_and_seed_hardly_matter() -> None:
    """Twice the spacing: 10 %; twice the parcels: 5 % of the vapour's penetration, 0.5 ms. Of the
    liquid's 10 %, for at its edge single parcels are seen: 8 % found, 4 % at 0.95 ms."""
    base = at(0.6, 573, time_s=0.5e-3)
    fine = find(base, cache=None)
    coarse = find(base.model_copy(update={"box": COARSE}), cache=None)
    many = find(base.model_copy(update={"droplets_per_parcel": 5e3}), cache=None)
    for name in ("vapour_penetration_m", "liquid_penetration_m"):
        assert note(coarse, name) == pytest.approx(note(fine, name), rel=0.10)
        within = 0.05 if name == "vapour_penetration_m" else 0.10
        assert note(many, name) == pytest.approx(note(fine, name), rel=within)
