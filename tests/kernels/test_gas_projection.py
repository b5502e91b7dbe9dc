"""Mass fluxes of the gas, and their correction to the outflow of each cell, against the twin."""

from __future__ import annotations

import numpy as np

from cldit.spray.flow.gas import GasFlow

from .gas_twin import Twin, assert_close, drawn, get, launch, put

STEP_S = 1e-5


def test_mass_fluxes_and_imbalance(gas_flow: GasFlow) -> None:
    twin, real, volume = Twin(gas_flow.grid), gas_flow.fields.real, gas_flow.grid.volume_m3
    velocity, density = drawn(gas_flow, 3), drawn(gas_flow, low=1.0, high=5.0)
    kept, amiss = drawn(gas_flow), 0.9 * drawn(gas_flow)
    for name, planes in (
        ("velocity", velocity), ("mass", density * volume), ("density", density),
        ("kept", kept), ("amiss", amiss),
    ):  # fmt: skip
        put(gas_flow, name, planes)
    launch(gas_flow, "projection", "mass_fluxes")
    flux = twin.mass_fluxes(velocity * density)
    assert_close(get(gas_flow, "flux", 3), flux, real)
    put(gas_flow, "flux", flux, junk=0.0)
    launch(gas_flow, "projection", "imbalance", step=STEP_S)
    expansion = np.clip(kept * STEP_S / density + amiss, -0.5, 0.5)
    assert 0.1 < np.mean(np.abs(expansion) == 0.5) < 0.9
    wanted = twin.outflow(flux) - expansion * density / STEP_S * volume
    assert_close(gas_flow.read("potential"), wanted, real)
    put(gas_flow, "potential", wanted)
    gas_flow._add_up(gas_flow.arguments["potential"], 2, 1.0)()
    launch(gas_flow, "projection", "balance", whole=float(volume.sum()))
    even = wanted.sum() / volume.sum() * volume - wanted
    assert_close(gas_flow.read("potential"), even, real)


def test_the_potential_gives_the_wanted_outflow(gas_flow: GasFlow) -> None:
    """Its gradient's outflow is minus the amiss one, to rounding of the products of matrices; and
    fluxes and forces are those of the twin."""
    twin, real, volume = Twin(gas_flow.grid), gas_flow.fields.real, gas_flow.grid.volume_m3
    amiss = drawn(gas_flow) * volume
    amiss -= amiss.sum() / volume.sum() * volume
    put(gas_flow, "potential", amiss, junk=0.0)
    for each in gas_flow._solve.launches(gas_flow.arguments["potential"]):
        each()
    potential = gas_flow.read("potential")
    out = twin.outflow(twin.gradient_fluxes(potential))
    # Conditions: the operator's largest coefficient times the potential's own size, rounded.
    size = max(float(np.abs(twin.gradient_fluxes(potential)).max()), float(np.abs(amiss).max()))
    steep = max(float(twin.conductance(a).max()) for a in range(3)) * float(np.ptp(potential))
    assert np.abs(out - amiss).max() < 100 * np.finfo(real).eps * max(size, steep)
    put(gas_flow, "potential", potential)
    put(gas_flow, "flux", 0 * drawn(gas_flow, 3), junk=0.0)
    launch(gas_flow, "projection", "correct")
    gradient = twin.gradient_fluxes(potential)
    rounding = 8 * np.finfo(real).eps * steep
    assert np.abs(get(gas_flow, "flux", 3) - gradient).max() < rounding
    force = twin.force(potential)
    level = float(np.abs(potential).max()) * float(np.abs(twin.face(0, 0)).max() + 1e-3)
    assert np.abs(gas_flow.read("force") - force).max() < 64 * np.finfo(real).eps * level
