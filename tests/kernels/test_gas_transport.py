"""Eddies, transport and mixing of the gas, kernel by kernel, against the NumPy twin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.spray.flow.gas import MIXING_LENGTH, GasFlow

from .gas_twin import JUNK, Twin, assert_close, drawn, gas_of, get, grid_of, launch, put

STEP_S = 1e-5


def some_flux(flow: GasFlow, *, largest: float) -> Floats:
    """Mass fluxes of at most this share of a cell in a step; walls have none."""
    twin = Twin(flow.grid)
    mass = 3.0 * flow.grid.volume_m3
    smaller = [np.minimum(mass, twin.at(mass, a, -1)) * twin.opened(a) for a in range(3)]
    flux = drawn(flow, 3) * largest / STEP_S * np.stack(smaller)
    return np.asarray(flux.astype(flow.fields.real).astype(float))


def test_eddies(gas_flow: GasFlow) -> None:
    twin = Twin(gas_flow.grid)
    velocity, density = drawn(gas_flow, 3), drawn(gas_flow, low=1.0, high=5.0)
    put(gas_flow, "velocity", velocity)
    put(gas_flow, "density", density)
    launch(gas_flow, "eddies", "eddies")
    thin = (gas_flow.far_density_kg_m3 / density) ** 1.5
    wanted = (MIXING_LENGTH * gas_flow.grid.middle[2]) ** 2 * twin.strain_rate(velocity) * thin
    # The outer faces of a cell cancel: its area over its volume is some 10 times the gradient's.
    assert_close(gas_flow.read("eddy"), wanted, gas_flow.fields.real, roundings=300)
    assert_close(gas_flow.read("exchange"), wanted * density, gas_flow.fields.real, roundings=300)


@pytest.mark.parametrize("largest", [0.1, 3.0])
def test_a_step_of_transport(gas_flow: GasFlow, largest: float) -> None:
    """Explicit part of the fluxes, and the state after it; short and long steps."""
    twin, real = Twin(gas_flow.grid), gas_flow.fields.real
    mass = np.asarray((3.0 * gas_flow.grid.volume_m3).astype(real).astype(float))
    flux, exchange = some_flux(gas_flow, largest=largest), drawn(gas_flow, low=1e-4, high=3e-2)
    for name, values in (("flux", flux), ("mass", mass), ("exchange", exchange)):
        put(gas_flow, name, values, junk=0.0 if name == "flux" else JUNK)
    limits = {"limit": 0.7, "limit_along": 0.5, "step": STEP_S}
    launch(gas_flow, "transport", "shares", **limits)
    a, b, c = (twin.passed_on(flux, axis) * STEP_S for axis in range(3))
    along = np.minimum(1.0, 0.5 * mass / np.maximum(c, 1e-300))
    across = np.maximum(0.7 * mass - along * c, 0.0) / np.maximum(a + b, 1e-300)
    share = np.stack([np.minimum(1.0, across), along])
    assert_close(get(gas_flow, "share", 2), share, real)
    assert (share.min() < 0.5) == (largest > 1)
    put(gas_flow, "share", share)

    launch(gas_flow, "transport", "divide", mixing=1.4, most_diffused=0.125, step=STEP_S)
    least = [np.minimum(share[0], twin.at(share[0], a, -1)) for a in (0, 1)]
    least.append(np.minimum(share[1], twin.at(share[1], 2, -1)))
    explicit = flux * np.stack(least)
    mean = 0.5 * (exchange + twin.at(exchange, 2, -1))
    mixing = 1.4 * mean * twin.conductance(2)
    most = 0.125 * np.minimum(mass, twin.at(mass, 2, -1)) / STEP_S
    diffusion = np.stack([np.minimum(mixing, most), mixing - np.minimum(mixing, most)])
    assert (mixing > most).any() and (mixing < most).any()
    assert_close(get(gas_flow, "explicit_flux", 3), explicit, real)
    size = float(np.abs(flux).max())
    rest = get(gas_flow, "rest", 3)
    assert np.abs(rest - (flux - explicit)).max() < 64 * np.finfo(real).eps * size
    assert_close(get(gas_flow, "diffusion", 2), diffusion, real)

    values = drawn(gas_flow, 2)
    for name, planes in (
        ("explicit_flux", explicit),
        ("diffusion", diffusion),
        ("values", values),
    ):
        put(gas_flow, name, planes, junk=JUNK if name == "values" else 0.0)
    for bounded in (0, 1):
        launch(gas_flow, "transport", "face_fluxes", kinds=2, bounded=bounded, step=STEP_S)
        fluxes = np.concatenate(
            [
                twin.carried(each, explicit, mass, diffusion[0], STEP_S, bool(bounded))
                for each in values
            ]
        )
        assert_close(get(gas_flow, "fluxes", 6), fluxes, real)
    put(gas_flow, "fluxes", fluxes, junk=0.0)
    after = mass - STEP_S * twin.outflow(explicit)
    assert (after > 0.2 * mass).all()  # no cell passes on more than 0.7 of its mass
    launch(gas_flow, "transport", "settle_mass", step=STEP_S)
    assert_close(gas_flow.read("after"), after, real)
    put(gas_flow, "after", after)
    launch(gas_flow, "transport", "settle", kinds=2, step=STEP_S)
    outs = np.stack([twin.outflow(fluxes[3 * n : 3 * n + 3]) for n in range(2)])
    wanted = (values * mass - STEP_S * outs) / after
    assert_close(get(gas_flow, "values", 2), wanted, real)
    # Bounded transport makes no new extrema of a step within its CFL number.
    assert np.abs(wanted).max() <= 1.0


@pytest.mark.parametrize("axis", [1, 0, 2])
@pytest.mark.parametrize("factor", [0.0, 1.4])
def test_mixing(gas_flow: GasFlow, axis: int, factor: float) -> None:
    """Against dense matrices, with fluxes alone and with eddies."""
    if axis == 0 and gas_flow.grid.shape[0] == 1:
        pytest.skip("one cell of azimuth has no neighbour")
    twin, real = Twin(gas_flow.grid), gas_flow.fields.real
    mass, exchange = 3.0 * gas_flow.grid.volume_m3, drawn(gas_flow, low=1e-3, high=3e-1)
    flux, values = some_flux(gas_flow, largest=0.3), drawn(gas_flow, 2)
    diffusion = factor * drawn(gas_flow, 2, low=0.0, high=1.0) * twin.opened(2) * mass / STEP_S
    for name, planes in (
        ("mass", mass), ("exchange", exchange), ("rest", flux), ("values", values),
        ("diffusion", diffusion),
    ):  # fmt: skip
        put(gas_flow, name, planes)
    known = gas_flow.arguments
    common: dict[str, Any] = {"mass": known["mass"], "flux": known["rest"]}
    if axis == 2:
        even = STEP_S * diffusion[1]
        gas_flow.mixing.along(known["values"], 2, diffusions=known["diffusion"], **common)(
            step=STEP_S
        )
    else:
        even = 0.5 * factor * STEP_S * twin.conductance(axis)
        even = even * (exchange + twin.at(exchange, axis, -1))
        across = gas_flow.mixing.launches(
            known["values"], 2, exchange=(known["exchange"],) * 2, factor=factor, **common
        )
        across[1 - axis](step=STEP_S)
    wanted, after = twin.mixed(values, mass, STEP_S * flux[axis], even, axis)
    # Systems of 13 cells, diagonally dominant but for the divergence: errors stay within some 10.
    assert_close(get(gas_flow, "values", 2), wanted, real, roundings=400)
    assert_close(gas_flow.read("mass"), after, real)


@pytest.mark.parametrize("polars", [1, 2])
def test_lines_of_one_and_two_cells(gas_device: Device, polars: int) -> None:
    """The shortest lines, of the polar angle, and rings of two cells."""
    grid = replace(
        grid_of("ring"),
        polar=np.linspace(1.0, 2.0, polars + 1),
        azimuth=np.linspace(-np.pi, np.pi, 3),
    )
    flow, twin = gas_of(grid, gas_device), Twin(grid)
    mass, exchange = 3.0 * grid.volume_m3, drawn(flow, low=1e-3, high=3e-1)
    values, still = drawn(flow, 1), np.zeros((3, *grid.shape))
    for name, planes in (("mass", mass), ("exchange", exchange), ("values", values)):
        put(flow, name, planes)
    put(flow, "rest", still, junk=0.0)
    known = flow.arguments
    for each in flow.mixing.launches(
        known["values"], 1, mass=known["mass"], flux=known["rest"],
        exchange=(known["exchange"],) * 2, factor=1.0,
    ):  # fmt: skip
        each(step=STEP_S)
    wanted = values
    for axis in (1, 0):
        even = 0.5 * STEP_S * twin.conductance(axis) * (exchange + twin.at(exchange, axis, -1))
        wanted = twin.mixed(wanted, mass, still[axis], even, axis)[0]
    assert_close(get(flow, "values", 1), wanted, flow.fields.real, roundings=400)
