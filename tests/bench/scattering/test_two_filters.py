"""The slab behind the evaluation with two filters, and what it gives back.

Rationale: the share that a slab absorbs is held against Chandrasekhar's H function, solved here,
and against thin slabs; the evaluation against slabs of known size and temperature.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.arrays import Image
from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from tests.bench.scattering.two_filters import Band, absorbed, one_filter, own_share, two_filters

INDEX = ((3.4, 1.338, 0.0341, (3.3, 3.5)), (3.55, 1.405, 0.0136, (3.5, 3.6)))
WALLS_K, DROPLETS_K = 450.0, 380.0


def _h(albedo: float) -> float:
    """H(1) by its own integral equation, in the form that converges (Chandrasekhar 1950, V 4)."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    h = np.ones_like(mu)
    for _ in range(500):
        inner = (weights * mu * h) @ (1.0 / (mu[:, None] + mu[None, :]))
        h = 1.0 / (np.sqrt(1.0 - albedo) + 0.5 * albedo * inner)
    return float(1.0 / (np.sqrt(1.0 - albedo) + 0.5 * albedo * np.sum(weights * mu * h / (1 + mu))))


@pytest.mark.parametrize("albedo", [0.1, 0.5, 0.9])
def test_thick_slabs_absorb_what_a_half_space_does(albedo: float) -> None:
    """sqrt(1 - albedo) H(1); 64 constant layers over a depth of 20 are good for 0.4 %."""
    wanted = np.sqrt(1.0 - albedo) * _h(albedo)
    assert absorbed(20.0, albedo) == pytest.approx(wanted, rel=4e-3)


def test_limits_of_the_slab() -> None:
    assert absorbed(1e-4, 0.7) == pytest.approx(0.3e-4, rel=2e-3)  # scattered once: 1 - albedo
    assert absorbed(2.0, 0.0) == pytest.approx(-np.expm1(-2.0), rel=1e-12)
    assert absorbed(5.0, 1.0) == 0.0


def test_the_table_is_the_slab() -> None:
    random = np.random.default_rng(3)
    depth, albedo = np.exp(random.uniform(-4.0, 2.4, 30)), random.uniform(0.0, 0.999, 30)
    wanted = [absorbed(t, a) / -np.expm1(-t) for t, a in zip(depth, albedo, strict=True)]
    np.testing.assert_allclose(own_share(depth, albedo), wanted, rtol=3e-3, atol=1e-3)
    assert np.isnan(own_share([np.nan, 1.0], 0.5)).tolist() == [True, False]


def _maps(emissivity: Image, kelvin: Image, error_K: float) -> Maps:
    blank = np.zeros_like(emissivity)
    error = np.full(emissivity.shape, error_K, np.float32)
    return Maps(emissivity, kelvin, blank, error, blank.astype(np.uint8), blank, blank, blank)


def _bands(depth: np.ndarray, size_um: np.ndarray, error_K: float = 0.05) -> tuple[Band, Band]:
    """Slabs of these depths at 3.4 um and of these droplets at 380 K before walls of 450 K."""
    found = []
    for um, n, k, filter_um in INDEX:
        curve = Curve(filter_um=filter_um)
        seen = (-np.expm1(-depth)).astype(np.float32)
        band = Band(_maps(seen, seen, error_K), curve, um, n, k)
        own = np.array(
            [own_share(t, band.albedos([d])[0]) for t, d in zip(depth, size_um, strict=True)]
        )
        wall, emits = curve.radiance([WALLS_K, DROPLETS_K])
        kelvin = curve.temperature(own * emits + (1.0 - own) * wall).astype(np.float32)
        found.append(replace(band, maps=_maps(seen, kelvin, error_K)))
    return found[0], found[1]


def test_size_and_temperature_come_back() -> None:
    depth, size = (
        np.array([0.3, 0.6, 1.0, 2.0, 3.0, 1.0]),
        np.array([6.0, 9.0, 9.0, 12.0, 9.0, 10.0]),
    )
    bands = _bands(depth, size)
    found = two_filters(bands, wall_temperature_K=WALLS_K)
    # Between the 28 sizes all is taken as straight; 1.5 K of the 70 K to the walls.
    np.testing.assert_allclose(found.temperature_K, DROPLETS_K, atol=1.5)
    np.testing.assert_allclose(found.diameter_um, size, rtol=0.06)
    assert np.all(found.low_K <= DROPLETS_K + 1.5) and np.all(found.high_K >= DROPLETS_K - 1.5)
    known, _ = one_filter(bands[0], diameter_um=9.0, wall_temperature_K=WALLS_K)
    np.testing.assert_allclose(known[[1, 2, 4]], DROPLETS_K, atol=0.1)
    assert abs(known[5] - DROPLETS_K) > 2.0  # droplets of 10 um taken for 9 um


def test_light_scattered_forward_is_not_scattered() -> None:
    """Mie: droplets of 9 um scatter most of it within some degrees, so that they look blacker."""
    forward, _ = _bands(np.array([1.0]), np.array([9.0]))
    even = replace(forward, isotropic=True)
    assert forward.albedos([9.0])[0] < 0.6 * even.albedos([9.0])[0]
    # Without absorption nothing changes: all is scattered, however it is.
    assert replace(forward, k=0.0).albedos([9.0])[0] == pytest.approx(1.0, abs=1e-12)


def test_errors_by_brute_force() -> None:
    """T_app of both filters drawn 3000 times. The stated error takes the slope over one step in
    size, 10 %, for that over all that noise moves: good to a quarter."""
    first, second = _bands(np.array([1.0]), np.array([9.0]))
    stated = two_filters((first, second), wall_temperature_K=WALLS_K).standard_error_K[0]
    random = np.random.default_rng(4)
    drawn = []
    for band in (first, second):
        kelvin = band.maps.apparent_temperature_K + 0.05 * random.standard_normal(3000)
        seen = np.repeat(band.maps.emissivity, 3000)
        drawn.append(replace(band, maps=_maps(seen, kelvin.astype(np.float32), 0.05)))
    found = two_filters((drawn[0], drawn[1]), wall_temperature_K=WALLS_K)
    assert 0.05 < stated < 2.0
    assert np.nanstd(found.temperature_K) == pytest.approx(stated, rel=0.25)
    held = (found.low_K <= DROPLETS_K) & (found.high_K >= DROPLETS_K)
    assert np.mean(held) > 0.9


def test_walls_as_warm_as_the_spray_say_nothing_of_the_size() -> None:
    """There both filters agree at every size, and the temperature is bounded well."""
    first, second = _bands(np.array([1.0]), np.array([9.0]))
    maps = _maps(first.maps.emissivity, np.array([WALLS_K], np.float32), 0.05)
    same = replace(first, maps=maps), replace(second, maps=maps)
    found = two_filters(same, wall_temperature_K=WALLS_K)
    assert abs(found.low_K[0] - WALLS_K) < 1.0 and abs(found.high_K[0] - WALLS_K) < 1.0
