"""Geometry of the grid of rays and its choice for an injector."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import EIGHT_PLUMES, FlowBox, LagrangianSpray, Plume
from cldit.spray.cone.nozzle import plume_axis
from cldit.spray.droplet.fluids import fuel_table
from cldit.spray.flow.injector import inject
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
