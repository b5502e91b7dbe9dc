"""What is read off a computed spray, and the references it is compared with."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.flow.coupling import Cloud
from cldit.spray.flow.gas import Box, GasFlow
from cldit.spray.flow.measures import (
    Station,
    half_angle_rad,
    projected_reach_m,
    sauter_m,
    vapour_reach_m,
)
from cldit.spray.flow.mixture import gas_mixture
from cldit.spray.flow.verification import at, jet, saturation


@functools.cache
def fluids() -> tuple[Fuel, Gas]:
    return fuel_table("n-heptane", cache=None), gas_table("nitrogen", cache=None)


@pytest.mark.parametrize(
    ("pressure_MPa", "gas_K", "kelvin", "ratio"),
    [
        (0.15, 300, 286.5, 0.080),
        (0.15, 620, 340.0, 1.12),
        (0.6, 400, 340.5, 0.233),
        (0.6, 573, 369.0, 0.674),
        (0.9, 300, 296.0, 0.022),
        (0.9, 620, 385.0, 0.715),
    ],
)
def test_adiabatic_saturation(pressure_MPa: float, gas_K: int, kelvin: float, ratio: float) -> None:
    """Against values computed with other property fits (NSRDS): half a kelvin of rounding, and half
    a kelvin and 4 % for the fits' latent heats."""
    found_K, found = saturation(
        *fluids(), fuel_K=370.0, gas_K=float(gas_K), pressure_Pa=pressure_MPa * 1e6
    )
    assert found_K == pytest.approx(kelvin, abs=1.0)
    assert found == pytest.approx(ratio, rel=0.04)


def test_the_vapour_reaches_as_far_as_the_plumes_on_average() -> None:
    fuel, gas = fluids()
    box = Box(np.array([-5e-3, -5e-3, -20e-3]), 1e-3, (10, 10, 20))
    mixture = gas_mixture(fuel, gas, reference_K=570.0)
    flow = GasFlow(box, mixture, pressure_Pa=6e5, temperature_K=570.0)
    axes = np.array([[0.6, 0.0, -0.8], [-0.6, 0.0, -0.8], [0.0, 0.6, -0.8]])
    assert vapour_reach_m(flow, axes) == 0.0
    flow.fuel[8, 5, 15] = 2e-3 * flow.density[8, 5, 15]  # (3.5, 0.5, -4.5) mm
    flow.fuel[1, 5, 10] = 2e-3 * flow.density[1, 5, 10]  # (-3.5, 0.5, -9.5) mm
    flow.fuel[1, 5, 5] = 0.9e-3 * flow.density[1, 5, 5]  # farther, but too thin
    one, two = (np.linalg.norm([3.5, 0.5, z]) * 1e-3 for z in (4.5, 9.5))
    # The third plume has no vapour and does not count.
    assert vapour_reach_m(flow, axes) == pytest.approx((one + two) / 2, rel=1e-12)


def test_the_station_counts_what_passes_once() -> None:
    fuel, _ = fluids()

    def cloud(depth_mm: list[float], diameter_um: list[float]) -> Cloud:
        count = len(depth_mm)
        warm = np.full(count, 350.0)
        return Cloud(
            mass_kg=fuel.mass_kg(np.array(diameter_um) * 1e-6, warm),
            temperature_K=warm,
            droplets=np.arange(1.0, count + 1),
            hole=np.zeros(count, dtype=np.int64),
            position_m=np.stack([*np.zeros((2, count)), -1e-3 * np.array(depth_mm)], axis=1),
            velocity_m_s=np.zeros((count, 3)),
        )

    station = Station()
    assert np.isnan(station.sauter_m)
    one = cloud([14.0, 10.0, 16.0, 14.9], [5.0, 6.0, 7.0, 8.0])
    two = cloud([15.5, 12.0, 17.0, 15.0], [5.0, 6.0, 7.0, 8.0])
    station.watch(one, two, fuel)
    station.watch(two, two, fuel)
    wanted = sauter_m(np.array([1.0, 4.0]), np.array([5e-6, 8e-6]))
    assert station.sauter_m == pytest.approx(wanted, rel=1e-12)


def test_liquid_reaches_as_far_as_its_projected_volume() -> None:
    """Two cells' worth of liquid in one column of sight, by hand; the edge between two rows."""
    fuel, _ = fluids()
    box = Box(np.array([-5e-3, -5e-3, -20e-3]), 1e-3, (10, 10, 20))
    warm = np.full(3, 350.0)
    density = float(fuel.liquid.one("density", 350.0))
    # In the middles of cells, so that each parcel is in one: y differs, which is looked along; in x
    # all are in one plane, and from there the two upper ones add up too.
    position = 1e-3 * np.array([[0.5, -2.5, -9.5], [0.5, 1.5, -9.5], [0.5, 3.5, -12.5]])

    def cloud(volume_mm3: list[float]) -> Cloud:
        mass = np.full(3, 1e-13)
        return Cloud(
            mass_kg=mass,
            temperature_K=warm,
            droplets=np.array(volume_mm3) * 1e-9 * density / mass,
            hole=np.zeros(3, dtype=np.int64),
            position_m=position,
            velocity_m_s=np.zeros((3, 3)),
        )

    assert projected_reach_m(cloud([0.0, 0.0, 0.0]), box, fuel) == (0.0, 0.0)
    # 2.5e-3 mm3/mm2 along y: 0.2 of a cell below 9.5 mm is the edge of 2e-3, if it falls to 0
    # there; along x they are beside each other, 1.25e-3 each: no edge, 0.
    far, thin = projected_reach_m(cloud([1.25e-3, 1.25e-3, 0.0]), box, fuel)
    assert far == pytest.approx((9.7e-3 + 0.0) / 2, rel=1e-9)
    assert thin == pytest.approx(9.5e-3 + 1e-3 * ((2.3 / 2.5) + (1.05 / 1.25)) / 2, rel=1e-9)
    far, thin = projected_reach_m(cloud([1.25e-3, 1.25e-3, 0.4e-3]), box, fuel)
    assert far == pytest.approx(9.7e-3 / 2, rel=1e-9)
    assert thin == pytest.approx(13.0e-3, rel=1e-9)


def test_the_plumes_half_angle() -> None:
    """Two cones of 14 degrees filled with vapour; 4 %: their edges are steps of cells."""
    fuel, gas = fluids()
    box = Box(np.array([-30e-3, -10e-3, -50e-3]), 0.5e-3, (120, 40, 100))
    flow = GasFlow(
        box, gas_mixture(fuel, gas, reference_K=570.0), pressure_Pa=6e5, temperature_K=570.0
    )
    axes = np.array([[0.5, 0.0, -np.sqrt(0.75)], [-0.5, 0.0, -np.sqrt(0.75)]])
    assert np.isnan(half_angle_rad(flow, axes))
    index = np.moveaxis(np.indices(box.shape), 0, -1)
    centre = box.origin_m + (index + 0.5) * box.spacing_m
    along = np.max(centre @ axes.T, axis=-1)
    wide = np.sqrt(np.maximum(np.sum(centre**2, axis=-1) - along**2, 0.0))
    flow.fuel[(along < 40e-3) & (wide < along * np.tan(np.radians(14)))] = 1.0
    assert np.degrees(half_angle_rad(flow, axes)) == pytest.approx(14, rel=0.04)


def test_the_reference_jet_is_naber_and_siebers() -> None:
    """Penetration grows as sqrt(t) far away and with rho_gas^(-1/4) at equal momentum."""
    fuel, gas = fluids()
    thin, dense = (jet(at(p, 300), fuel, gas) for p in (0.15, 0.9))
    far = 1.0  # s: thousands of x+
    assert thin.tip_m(4 * far) == pytest.approx(2 * thin.tip_m(far), rel=2e-3)
    momentum = (thin.rate_kg_s * thin.speed_m_s) / (dense.rate_kg_s * dense.speed_m_s)
    expected = (6 * momentum) ** 0.25
    assert thin.tip_m(far) / dense.tip_m(far) == pytest.approx(expected, rel=2e-3)
