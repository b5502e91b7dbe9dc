"""Droplets at the injector, and the grid of rays that is chosen for it."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.sizes import NukiyamaTanasawa
from cldit.scene.spray import EIGHT_PLUMES, FlowBox, LagrangianSpray, Plume
from cldit.spray.cone.nozzle import plume_axis
from cldit.spray.droplet.fluids import Fuel, fuel_table
from cldit.spray.flow.injector import Injection, inject
from cldit.spray.flow.ray_choice import ray_grid, symmetry
from cldit.spray.flow.rays import RayGrid
from cldit.spray.sizes import mean_diameter_m


@functools.cache
def heptane() -> Fuel:
    return fuel_table("n-heptane", cache=None)


def mass(injection: Injection) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.asarray(injection.droplets * heptane().mass_kg(injection.diameter_m, [370.0]))


def test_mass_shares_and_sizes() -> None:
    plumes = (
        Plume(inclination_deg=10, azimuth_deg=0, mass_fraction=3),
        Plume(inclination_deg=40, azimuth_deg=180, mass_fraction=1),
    )
    sizes = NukiyamaTanasawa()
    spec = LagrangianSpray(
        injected_mass_kg=2e-6, plumes=plumes, droplets_per_parcel=1e3, droplets=sizes
    )
    found = inject(spec, heptane())
    assert mass(found).sum() == pytest.approx(2e-6, rel=1e-12)
    assert mass(found)[found.hole == 0].sum() == pytest.approx(1.5e-6, rel=1e-12)
    # One parcel from each of 2 000 equal parts of the mass: D32 to well below a percent.
    sauter = np.sum(found.droplets * found.diameter_m**3) / np.sum(
        found.droplets * found.diameter_m**2
    )
    assert sauter == pytest.approx(mean_diameter_m(sizes, 3, 2), rel=2e-3)
    # All are of one mass, that of `droplets_per_parcel` droplets of mean mass.
    typical = heptane().mass_kg(mean_diameter_m(sizes, 3, 0), 370.0)
    np.testing.assert_allclose(mass(found), 1e3 * typical, rtol=1e-3)
    # Bernoulli: 0.9 sqrt(2 dp / rho).
    density = float(heptane().liquid.value("density", 370.0))
    assert found.speed_m_s == pytest.approx(0.9 * np.sqrt(2 * 19.4e6 / density), rel=1e-12)


def test_directions_stay_in_their_cones() -> None:
    plume = Plume(inclination_deg=90 - 1e-9 - 1, azimuth_deg=30, cone_angle_deg=20)
    found = inject(LagrangianSpray(injected_mass_kg=1e-6, plumes=(plume,)), heptane())
    along = found.velocity_m_s @ found.axes[0] / found.speed_m_s
    angle = np.degrees(np.arccos(np.clip(along, -1, 1)))
    assert angle.max() <= 10.0
    assert angle.max() > 6.0
    # Symmetric about the axis: the mean of 800 directions of 4 degrees is within 0.5 degrees.
    middle = found.velocity_m_s.mean(axis=0)
    cosine = middle @ found.axes[0] / np.linalg.norm(middle)
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.5


def test_the_rate_is_followed() -> None:
    table = ((0.0, 1.0), (1e-4, 1.0), (1.0001e-4, 0.0), (3e-4, 0.0), (3.0001e-4, 2.0), (4e-4, 2.0))
    spec = LagrangianSpray(injected_mass_kg=1e-6, rate=table, droplets_per_parcel=1e3)
    found = inject(spec, heptane())
    early = found.time_s < 2e-4
    assert mass(found)[early].sum() == pytest.approx(1e-6 / 3, rel=0.02)
    assert not np.any((found.time_s > 1.01e-4) & (found.time_s < 2.99e-4))
    assert np.all(np.diff(found.time_s) >= 0)
    assert found.end_s == pytest.approx(4e-4)


def test_same_seed_same_parcels_and_another_seed_others() -> None:
    spec = LagrangianSpray(injected_mass_kg=1e-6)
    one, two = inject(spec, heptane()), inject(spec, heptane())
    other = inject(spec.model_copy(update={"seed": 2}), heptane())
    np.testing.assert_array_equal(one.position_m, two.position_m)
    np.testing.assert_array_equal(one.diameter_m, two.diameter_m)
    assert not np.array_equal(one.diameter_m, other.diameter_m)


def test_impossible_injections() -> None:
    with pytest.raises(SprayError, match=r"injection_pressure_Pa.*not above"):
        inject(LagrangianSpray(injection_pressure_Pa=5e5), heptane())
    with pytest.raises(SprayError, match=r"injected_mass_kg.*at most"):
        inject(LagrangianSpray(injected_mass_kg=1e-3), heptane())
    with pytest.raises(SprayError, match=r"droplets_per_parcel.*at least"):
        inject(LagrangianSpray(droplets_per_parcel=1.0), heptane())


def test_no_fuel_is_no_parcel() -> None:
    assert len(inject(LagrangianSpray(injected_mass_kg=0.0), heptane()).time_s) == 0


def test_parcels_that_follow_each_other_fill_the_cone_evenly() -> None:
    """Of any 64 in a row that leave a hole a quarter is in each quarter of the cone, within 3 (by
    chance it would be within 10), and half are inside the median radius."""
    spec = LagrangianSpray(injected_mass_kg=1e-6, droplets_per_parcel=1e3)
    found = inject(spec, heptane())
    axis = found.axes[2]
    unit = found.velocity_m_s[found.hole == 2] / found.speed_m_s
    aside = unit - (unit @ axis)[:, None] * axis
    first = np.cross(axis, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    angle = np.arctan2(aside @ np.cross(axis, first), aside @ first)
    radius = np.linalg.norm(aside, axis=1)
    for start in range(0, len(radius) - 64, 64):
        part = slice(start, start + 64)
        quarters = np.histogram(angle[part], bins=4, range=(-np.pi, np.pi))[0]
        assert np.abs(quarters - 16).max() <= 3
        assert abs(np.count_nonzero(radius[part] < np.median(radius)) - 32) <= 3


ONE = (Plume(inclination_deg=33.0, azimuth_deg=20.0),)
THREE = (
    Plume(inclination_deg=16.0, azimuth_deg=20.0),
    Plume(inclination_deg=40.0, azimuth_deg=150.0, mass_fraction=2.0),
    Plume(inclination_deg=30.0, azimuth_deg=260.0),
)
KINDS = {"round": ONE, "equal": EIGHT_PLUMES, "any": THREE}


def grid(name: str, spacing_m: float = 4e-3) -> RayGrid:
    spec = LagrangianSpray(
        injected_mass_kg=1e-6, plumes=KINDS[name], box=FlowBox(spacing_m=spacing_m)
    )
    return ray_grid(spec, inject(spec, fuel_table("n-heptane", cache=None)), gas_kg_mol=0.0280134)


def test_the_kind_of_an_injector() -> None:
    assert [symmetry(plumes) for plumes in KINDS.values()] == [0, 8, 1]
    assert symmetry((EIGHT_PLUMES[0], EIGHT_PLUMES[4])) == 2
    assert symmetry((EIGHT_PLUMES[0], EIGHT_PLUMES[3])) == 1
    thick = EIGHT_PLUMES[0].model_copy(update={"mass_fraction": 1.1})
    assert symmetry((thick, *EIGHT_PLUMES[1:])) == 1


@pytest.mark.parametrize("name", KINDS)
def test_the_cells_are_closed_and_fill_the_space(name: str) -> None:
    made = grid(name)
    a, p, r = made.areas
    strip, square = made.strip_m2, made.radius_m**2
    sides = a[1:] - a[:-1] + p[:, 1:] - p[:, :-1]
    total = sides[:, :, None] * strip[:, None] + r[:, :, None] * np.diff(square)[:, None]
    assert np.abs(total).max() < 1e-12 * square[-1]
    turn = 2 * np.pi / made.copies if made.symmetry != 1 else np.ptp(made.azimuth)
    wanted = turn * (np.cos(made.polar[0]) - np.cos(made.polar[-1]))
    wanted *= (made.radius_m[-1] ** 3 - made.radius_m[0] ** 3) / 3
    assert made.volume_m3.sum() == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_every_plume_is_on_rays_of_fine_cells(name: str) -> None:
    made = grid(name, 1e-3)
    for plume in KINDS[name]:
        local = made.directions @ plume_axis(plume)
        if made.symmetry == 1 or plume is KINDS[name][0]:
            assert np.arccos(local.max()) < 0.04  # a cell


def test_plumes_all_over_are_in_a_full_circle_and_refused_with_one_on_the_axis() -> None:
    """Inclined plumes leave the injector's axis free as a pole; with one on it, a pole across
    would need 9 degrees without plumes, and these have 9 between them."""
    plumes = tuple(
        Plume(inclination_deg=85.0, azimuth_deg=each, mass_fraction=1 + each)
        for each in np.linspace(0.0, 355.0, 40)
    )
    fuel = fuel_table("n-heptane", cache=None)
    spec = LagrangianSpray(injected_mass_kg=1e-6, plumes=plumes, box=FlowBox(spacing_m=4e-3))
    assert ray_grid(spec, inject(spec, fuel), gas_kg_mol=0.0280134).ring
    middle = Plume(inclination_deg=0.0, azimuth_deg=0.0)
    spec = spec.model_copy(update={"plumes": (*plumes, middle)})
    with pytest.raises(SprayError, match=r"spray.plumes.*smaller inclinations"):
        ray_grid(spec, inject(spec, fuel), gas_kg_mol=0.0280134)
