"""The grid of rays: its geometry, what it exchanges with parcels, and its potential."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import EIGHT_PLUMES, FlowBox, LagrangianSpray, Plume
from cldit.spray.droplet.fluids import fuel_table
from cldit.spray.flow import kernels
from cldit.spray.flow.exchange import folded, gather, places, scatter, unfolded
from cldit.spray.flow.injector import inject, plume_axis
from cldit.spray.flow.projection import Projection
from cldit.spray.flow.ray_choice import ray_grid, symmetry
from cldit.spray.flow.rays import RayGrid

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
    return ray_grid(spec, inject(spec, fuel_table("n-heptane", cache=None)))


def around(made: RayGrid, count: int = 400) -> np.ndarray:
    """Positions about the plumes, within the grid."""
    random = np.random.default_rng(3)
    down = random.standard_normal((count, 3)) * 0.3 - [0.0, 0.0, 1.0]
    down /= np.linalg.norm(down, axis=1)[:, None]
    return down * random.uniform(2e-3, 0.9 * made.radius_m[-1], count)[:, None]


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
        assert made.contains(20e-3 * plume_axis(plume)[None])[0]
        local = made.directions @ plume_axis(plume)
        if made.symmetry == 1 or plume is KINDS[name][0]:
            assert np.arccos(local.max()) < 0.04  # a cell


@pytest.mark.parametrize("name", KINDS)
def test_amounts_are_kept_and_linear_fields_read(name: str) -> None:
    made = grid(name)
    position = around(made)
    at = places(made, position)
    amounts = np.random.default_rng(1).standard_normal(len(position))
    field = scatter(made, at, amounts)
    share = made.copies / max(made.symmetry, 1)
    assert np.sum(field * made.volume_m3) * share == pytest.approx(amounts.sum(), rel=1e-12)
    np.testing.assert_allclose(gather(at, np.full(made.shape, 3.0)), 3.0, rtol=1e-12)
    # The field is linear in the radius between middles of equal distance, exact in each cell.
    radius = np.broadcast_to(made.middle[2], made.shape)
    found, wanted = gather(at, radius), np.linalg.norm(position, axis=1)
    width = np.interp(wanted, made.middle[2], np.diff(made.radius_m))
    inside = wanted < made.middle[2][-1]
    assert np.abs(found - wanted)[inside].max() < 0.15 * width.max()


@pytest.mark.parametrize("name", KINDS)
def test_vectors_turn_with_their_positions(name: str) -> None:
    made = grid(name)
    position = around(made)
    at = places(made, position)
    local = folded(made, at, position)
    polar = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    assert np.all((polar >= made.polar[0]) & (polar <= made.polar[-1]))
    if made.symmetry != 0:
        azimuth = np.arctan2(local[:, 1], local[:, 0])
        assert np.all((azimuth >= made.azimuth[0] - 1e-9) & (azimuth <= made.azimuth[-1] + 1e-9))
        np.testing.assert_allclose(unfolded(made, at, local), position, atol=1e-12)
    else:
        assert not local[:, 1].any()
        np.testing.assert_allclose(np.linalg.norm(local, axis=1), np.linalg.norm(position, axis=1))
        np.testing.assert_allclose(unfolded(made, at, local), position, atol=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_the_potential_gives_the_wanted_outflow(name: str) -> None:
    """To rounding of the solver's sums; and its forces add to what the walls take."""
    made, random = grid(name), np.random.default_rng(2)
    wanted = random.standard_normal(made.shape) * made.volume_m3
    wanted -= wanted.sum() / made.volume_m3.sum() * made.volume_m3
    flux, force = np.zeros((3, *made.shape)), np.empty((3, *made.shape))
    out = np.empty(made.shape)
    length = made.strip_m2 / made.middle[2]
    potential = Projection(made)(-wanted)
    square = made.radius_m**2
    kernels.correct(
        potential,
        made.areas,
        made.conductance,
        made.angle,
        made.strip_m2,
        length,
        square,
        flux,
        force,
    )
    kernels.outflow(flux[0], flux[1], flux[2], out)
    assert np.abs(out - wanted).max() < 1e-9 * np.abs(wanted).max()
    a, p, r = made.areas
    walls = np.einsum("ji,jc->c", potential[0] * made.strip_m2, a[0])
    walls -= np.einsum("ji,jc->c", potential[-1] * made.strip_m2, a[-1])
    walls += np.einsum("ki,kc->c", potential[:, 0] * made.strip_m2, p[:, 0])
    walls -= np.einsum("ki,kc->c", potential[:, -1] * made.strip_m2, p[:, -1])
    walls += np.einsum("kj,kjc->c", potential[:, :, 0] * square[0], r)
    walls -= np.einsum("kj,kjc->c", potential[:, :, -1] * square[-1], r)
    np.testing.assert_allclose(force.sum(axis=(1, 2, 3)), walls, atol=1e-9 * np.abs(force).sum())


def test_plumes_all_over_are_refused() -> None:
    plumes = tuple(
        Plume(inclination_deg=85.0, azimuth_deg=each, mass_fraction=1 + each)
        for each in np.linspace(0.0, 355.0, 40)
    )
    spec = LagrangianSpray(injected_mass_kg=1e-6, plumes=plumes)
    with pytest.raises(SprayError, match=r"spray.plumes.*smaller inclinations"):
        ray_grid(spec, inject(spec, fuel_table("n-heptane", cache=None)))
