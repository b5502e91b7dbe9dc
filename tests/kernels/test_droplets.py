"""Kernels of the droplets: property fits against the tables, physics against the NumPy twin."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.gpu.program import Define, build
from cldit.spray.droplet.advance import (
    DropletStates,
    DropletSurroundings,
    advance,
    follow_droplets,
)
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.curves import curves
from cldit.spray.droplet.fits import LARGEST_ERROR, LARGEST_LN_ERROR, gas_fits, liquid_fits
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table, property_table
from cldit.spray.droplet.models import MODELS, inert
from cldit.spray.droplet.rates import Drop
from cldit.spray.droplet.substances import GASES

from . import droplet_twin as twin

ULP = float(np.finfo(np.float32).eps)

FUELS = (
    "n-heptane", "iso-octane", "n-dodecane", "n-decane", "ethanol", "methanol", "toluene", "water",
    "methane",
)  # fmt: skip


@pytest.fixture(scope="module", params=[np.float32, np.float64])
def real(request: pytest.FixtureRequest, device: Device) -> type[np.floating]:
    if request.param is np.float64 and not device.info.float64:
        pytest.skip("the device has no double precision")
    return cast(type[np.floating], request.param)


@pytest.fixture(scope="module")
def heptane(tables: Path) -> Fuel:
    return fuel_table("n-heptane", cache=tables)


@pytest.fixture(scope="module")
def nitrogen(tables: Path) -> Gas:
    return gas_table("nitrogen", cache=tables)


# --- properties -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FUELS)
def test_liquid_properties_are_those_of_the_table(apply: Any, tables: Path, name: str) -> None:
    """Error of the fit, and that of single precision: at the hot end (1 - T/Tc) = 0.02 has an error
    of 3 ULP, and a slope up to 100 of ln psat by T/Tc has one of 100 ULP."""
    fuel = fuel_table(name, cache=tables)
    known = property_table(fuel, gas_table("nitrogen", cache=tables))
    kelvin = np.linspace(fuel.liquid.low_K, fuel.liquid.high_K, 997).astype(np.float32)
    padded = np.zeros(len(kelvin))
    padded[: len(known)] = known
    wanted = fuel.liquid.at(
        kelvin, "ln_psat", "density", "cp", "latent", "conductivity", "enthalpy"
    )
    rounding = 300 * ULP
    members = ("saturation_pressure", "density", "cp", "latent", "conductivity", "enthalpy")
    rows = apply(
        "spray/droplet_properties.h",
        [f"liquid_at(b_, a).{member}" for member in members],
        [kelvin, padded],
        defines="#define SIMD_WIDTH 1",
    ).astype(float)
    for member, got, values in zip(members, rows, wanted, strict=True):
        if member == "saturation_pressure":
            assert np.abs(np.log(got) - values).max() < LARGEST_LN_ERROR + rounding
        elif member == "enthalpy":
            assert np.abs(got - values).max() < (LARGEST_ERROR + rounding) * np.ptp(values)
        else:
            assert np.abs(got / values - 1).max() < LARGEST_ERROR + rounding, member


@pytest.mark.parametrize("name", [*FUELS, *GASES])
def test_gas_properties_are_those_of_the_table(apply: Any, tables: Path, name: str) -> None:
    fuel = fuel_table("n-heptane" if name in GASES else name, cache=tables)
    gas = gas_table(name if name in GASES else "nitrogen", cache=tables)
    known = property_table(fuel, gas)
    source = gas.vapour if name in GASES else fuel.vapour
    kelvin = np.linspace(source.low_K, source.high_K, 997).astype(np.float32)
    padded = np.zeros(len(kelvin))
    padded[: len(known)] = known
    function = "carrier_at" if name in GASES else "vapour_at"
    members = ("cp", "conductivity", "viscosity")
    rows = apply(
        "spray/droplet_properties.h",
        [f"{function}(b_, a).{member}" for member in members],
        [kelvin, padded],
        defines="#define SIMD_WIDTH 1",
    )
    for member, got in zip(members, rows, strict=True):
        wanted = source.value(member, kelvin)
        # The sum of the coefficients' sizes is up to 30 of the value: 30 ULP.
        assert np.abs(got / wanted - 1).max() < LARGEST_ERROR + 30 * ULP, member


def test_a_property_that_no_polynomial_follows_is_refused() -> None:
    kelvin = np.linspace(200.0, 500.0, 301)
    jump = np.where(kelvin < 350, 1.0, 1.1)
    names = ("ln_psat", "density", "cp", "latent", "conductivity", "enthalpy", "viscosity")
    smooth = dict.fromkeys(names, kelvin)
    with pytest.raises(SprayError, match=r"odd, liquid latent: .* error of 0.0.*; allowed: 0.003"):
        liquid_fits("odd", curves(kelvin, {**smooth, "latent": jump}), critical_K=510.0)
    with pytest.raises(SprayError, match="odd, gas viscosity: "):
        gas_fits("odd", curves(kelvin, {**smooth, "viscosity": jump}))


# --- film and rates -------------------------------------------------------------------------------


def drops(
    fuel: Fuel, count: int = 203, *, superheated: bool = False, most_vapour: float = 0.6
) -> Drop:
    """Droplets in all states: not a whole number of work-items; up to 0.9 of the boiling pressure,
    or to the hottest of the table."""
    rng = np.random.default_rng(5)
    pressure = np.exp(rng.uniform(np.log(0.1e6), np.log(2e6), count))
    drop = Drop(
        diameter_m=np.exp(rng.uniform(np.log(0.1e-6), np.log(100e-6), count)),
        temperature_K=rng.uniform(
            260.0, fuel.liquid.high_K if superheated else fuel.boiling_K(0.9 * pressure), count
        ),
        gas_temperature_K=rng.uniform(280.0, 900.0, count),
        pressure_Pa=pressure,
        vapour=rng.choice([0.0, 0.2, 0.5, most_vapour], count),
        slip_m_s=rng.uniform(0.0, 150.0, count) * rng.integers(0, 2, count),
    )
    # As they are on the device, so that rounding of the arguments is no difference.
    names = [each.name for each in fields(drop)]
    return replace(drop, **{name: getattr(drop, name).astype(np.float32) for name in names})


def states(fuel: Fuel, real: type[np.floating]) -> Drop:
    """Superheated droplets in double precision only: in single precision, 1 - Y at the surface has
    few digits close to boiling. Vapour alone is beyond its limit, 0.99 of the moles."""
    return drops(fuel, superheated=real is np.float64, most_vapour=0.9995)


def exact(fuel: Fuel, gas: Gas, drop: Drop) -> twin.Case:
    names = [each.name for each in fields(drop)]
    wide = {name: getattr(drop, name).astype(float) for name in names}
    return twin.Case(fuel, gas, replace(drop, **wide))


def tolerance(real: type[np.floating]) -> float:
    """Of the saturation pressure: ln psat = 12 is rounded to 6 ULP, and T by 1 ULP makes 15 ULP;
    polynomials have sums of coefficients of 10. Together below 30 units."""
    return 30 * float(np.finfo(real).eps)


def test_film(device: Device, heptane: Fuel, nitrogen: Gas, real: type[np.floating]) -> None:
    kernels = DropletKernels.of(device, heptane, nitrogen, inert, real=real)
    drop, limit = states(heptane, real), tolerance(real)
    for share in (1 / 3, 0.5):
        got = twin.film_on_device(drop, kernels, share=share)
        wanted = twin.film(exact(heptane, nitrogen, drop), share)
        for each in fields(twin.Film):
            error = np.abs(getattr(got, each.name) - getattr(wanted, each.name))
            scale = np.abs(getattr(wanted, each.name))
            if each.name == "transfer":  # (Ys - Yfar)/(1 - Ys), of Ys with an error of `limit`
                scale = (1 + np.abs(wanted.transfer)) / (1 - wanted.surface)
            assert np.all(error <= 4 * limit * scale), each.name  # of both, and of their quotients


@pytest.mark.parametrize("name", MODELS)
def test_rates(
    device: Device, heptane: Fuel, nitrogen: Gas, name: str, real: type[np.floating]
) -> None:
    """Of the mass: errors as of the transfer number (1 + B, which is up to 36). Of the heat: as of
    its two parts. The surface temperature of the finite conductivity's iteration has an error of
    2e-4 K (1e-9 K); ln(1 + B) changes by up to 5 per K (1000 where droplets are superheated)."""
    kernels = DropletKernels.of(device, heptane, nitrogen, MODELS[name], real=real)
    drop = states(heptane, real)
    mass, heat = kernels.run("rates", drop.columns(), 2)[0]
    rates = twin.RATES[name](exact(heptane, nitrogen, drop))
    film = twin.film(exact(heptane, nitrogen, drop))
    limit = tolerance(real) * 40
    if name == "frolov-type":
        limit += 1e-6 if real is np.float64 else 1e-3
    unit = np.pi * drop.diameter_m * film.diffusion_kg_m_s * 2 * (1 + film.reynolds**0.5)
    assert np.all(np.abs(mass - rates[0]) <= limit * np.maximum(np.abs(rates[0]), unit))
    latent = heptane.liquid.value("latent", drop.temperature_K)
    parts = np.abs(rates[0]) * latent + np.abs(rates[1]) + unit * latent
    assert np.all(np.abs(heat - rates[1]) <= limit * parts)


def test_exchange_coefficients(apply: Any, heptane: Fuel, nitrogen: Gas) -> None:
    """By the film's twin. The drag's power has an error of 15 ULP, and 0.687 of that of Re."""
    drop = drops(heptane, 203)
    case = exact(heptane, nitrogen, drop)
    film, size = twin.film(case), np.pi * case.drop.diameter_m
    mass = np.pi / 6 * case.drop.diameter_m**3 * case.known.liquid(case.drop.temperature_K)[1]
    padded = np.zeros(203)
    table = property_table(heptane, nitrogen)
    padded[: len(table)] = table
    stir = 0.6 * np.sqrt(film.reynolds)
    expected = {
        "drag": 3 * size * film.viscosity_Pa_s * (1 + 0.15 * film.reynolds**0.687),
        "heat": size * film.conductivity_W_m_K / film.cp_J_kg_K
        * (2 + stir * np.cbrt(film.prandtl)),
        "mass": size * film.diffusion_kg_m_s * (2 + stir * np.cbrt(film.schmidt))
        * np.log1p(film.transfer) / film.transfer / (1 - film.surface),
        "surface": film.surface,
    }  # fmt: skip
    gas = (drop.gas_temperature_K, drop.pressure_Pa, drop.vapour)
    rows = apply(
        "spray/droplet_film.h",
        [f"all.{name}" for name in expected],
        [*gas, mass, drop.temperature_K, drop.slip_m_s, padded],
        defines="#define SIMD_WIDTH 1",
        setup="FarGas gas = {a, b, c}; Exchange all = exchange_of(g_, gas, d, e, f);",
    )
    for got, (name, values) in zip(rows, expected.items(), strict=True):
        limit = 2 * tolerance(np.float32) * (1 / (1 - film.surface) if name == "mass" else 1.0)
        assert np.all(np.abs(got / values - 1) < limit), name


# --- steps ----------------------------------------------------------------------------------------


def crowd(fuel: Fuel, drop: Drop) -> dict[str, list[Any]]:
    """Arguments of the steps: the droplets in a wind along two axes."""
    count = len(drop.diameter_m)
    wind = [np.linspace(-20.0, 20.0, count), np.full(count, 3.0), np.zeros(count)]
    mass = fuel.mass_kg(drop.diameter_m, drop.temperature_K)
    return {
        "gas": [drop.gas_temperature_K, drop.pressure_Pa, drop.vapour, *wind],
        "droplets": [mass, drop.temperature_K, wind[0] + drop.slip_m_s, wind[1], wind[2]],
    }


STEP: dict[str, Any] = {"duration": 5.5e-6, "tolerance": 1e-2, "drag": 1}


@pytest.mark.parametrize(
    "name", [pytest.param(m, marks=[pytest.mark.slow] * (m != "spalding")) for m in MODELS]
)
def test_steps_in_single_precision(device: Device, heptane: Fuel, nitrogen: Gas, name: str) -> None:
    """Against double precision. With as many steps, only rounding differs: that of the rates (see
    `test_rates`, 1.4e-4) over up to seven steps in which a droplet loses most, and that of the
    100 K that it warms at most. Others have other steps, whose errors are within the
    tolerance: of three steps in temperature, which has 100 K as its unit."""
    if not device.info.float64:
        pytest.skip("the device has no double precision")
    columns = crowd(heptane, drops(heptane, 2003))
    (out, after), (wide, exactly) = (
        DropletKernels.of(device, heptane, nitrogen, MODELS[name], real=each).run(
            "advance_droplets", columns, 5, **STEP
        )
        for each in (np.float32, np.float64)
    )
    assert np.all(out[4] > 0) and np.all(wide[4] > 0)
    mass, left, start = after["droplets"][0], exactly["droplets"][0], columns["droplets"][0]
    same = out[4] == wide[4]
    assert np.mean(same) > 0.8
    differences = np.abs(mass - left) / np.maximum(start, left)  # some grow
    assert differences[same].max() < 1e-3 and differences.max() < STEP["tolerance"]
    stays = (mass > 1e-3 * start) & (left > 1e-3 * start)
    kelvin = np.abs(after["droplets"][1] - exactly["droplets"][1])
    assert kelvin[stays & same].max() < 0.045 and kelvin[stays].max() < 300 * STEP["tolerance"]
    assert np.array_equal(left == 0, mass == 0) and 200 < np.sum(left == 0) < 1000
    gone = np.abs(out[3] - wide[3])[left == 0]
    assert np.quantile(gone, 0.99) < STEP["tolerance"] * STEP["duration"]
    assert gone.max() < 10 * STEP["tolerance"] * STEP["duration"]  # after ten steps of its own


def test_lanes_are_independent(device: Device, heptane: Fuel, nitrogen: Gas) -> None:
    """Each droplet alone has the state that it has among others, bit for bit."""
    kernels = DropletKernels.of(device, heptane, nitrogen, MODELS["spalding"], real=np.float32)
    columns = crowd(heptane, drops(heptane, 13))
    out, after = kernels.run("advance_droplets", columns, 5, **STEP)
    for number in range(13):
        alone = {name: [each[number : number + 1] for each in columns[name]] for name in columns}
        own, state = kernels.run("advance_droplets", alone, 5, **STEP)
        assert np.array_equal(own[:, 0], out[:, number])
        assert np.array_equal(state["droplets"][:, 0], after["droplets"][:, number])


def test_a_work_item_of_one_droplet_is_one_of_eight(
    device: Device, heptane: Fuel, nitrogen: Gas
) -> None:
    """The GPU's form on any device; compilers contract other sums to fused ones."""
    model = MODELS["abramzon-sirignano"]
    eight = DropletKernels.of(device, heptane, nitrogen, model, real=np.float32)
    program = build(device, "spray/droplets.cl", {"EVAPORATION": model.function, "SIMD_WIDTH": 1})
    one = replace(eight, program=program, width=1)
    columns = crowd(heptane, drops(heptane, 200))
    (out, after), (other, state) = (
        kernels.run("advance_droplets", columns, 5, **STEP) for kernels in (eight, one)
    )
    mass = np.abs(after["droplets"][0] - state["droplets"][0]) / columns["droplets"][0]
    assert mass[out[4] == other[4]].max() < 1e-3 and mass.max() < STEP["tolerance"]


def test_impossible_droplets_are_reported(device: Device, heptane: Fuel, nitrogen: Gas) -> None:
    kernels = DropletKernels.of(device, heptane, nitrogen, MODELS["spalding"], real=np.float32)
    columns = crowd(heptane, drops(heptane, 9))
    columns["gas"][0] = np.where(np.arange(9) == 4, np.nan, columns["gas"][0])
    rounds = kernels.run("advance_droplets", columns, 5, **STEP)[0][4]
    assert rounds[4] == -1 and np.all(np.delete(rounds, 4) > 0)


@pytest.mark.parametrize("width", [8, 1])
def test_a_history_is_its_steps(device: Device, heptane: Fuel, nitrogen: Gas, width: int) -> None:
    """Of droplets through other gas in each step, of which some vanish, as step by step."""
    model = MODELS["abramzon-sirignano"]
    defines: dict[str, Define] = {"EVAPORATION": model.function, "SIMD_WIDTH": width}
    program = build(device, "spray/droplets.cl", defines, preamble=model.source)
    eight = DropletKernels.of(device, heptane, nitrogen, model, real=np.float32)
    kernels = replace(eight, program=program, width=width)
    mass, temperature, speed, *_ = crowd(heptane, drops(heptane, 13))["droplets"]
    states = DropletStates(mass, temperature, speed[:, None])
    durations = np.array([1e-5, 4e-5, 3e-4])
    shape = (len(durations), len(mass))
    gas = DropletSurroundings(
        np.linspace(500.0, 900.0, mass.size * 3).reshape(shape),
        np.full(shape, 6e5),
        np.linspace(0.3, 0.0, mass.size * 3).reshape(shape),
        np.linspace(0.0, 80.0, mass.size * 3).reshape(shape),
    )
    found = follow_droplets(states, gas, durations, kernels, tolerance=1e-2)
    for step, duration in enumerate(durations):
        around = DropletSurroundings(
            gas.temperature_K[step],
            gas.pressure_Pa[step],
            gas.vapour[step],
            gas.velocity_m_s[step][:, None],
        )
        states = advance(states, around, float(duration), kernels, tolerance=1e-2).droplets
        np.testing.assert_array_equal(found[0][step], states.mass_kg)
        np.testing.assert_array_equal(found[1][step], states.velocity_m_s[:, 0])
    assert 0 < np.count_nonzero(found[0][-1]) < len(mass)
