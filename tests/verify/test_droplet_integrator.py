"""The droplet integrator: exact solutions, an independent stiff solver, conservation, abuse."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Protocol

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.spray.cone.mixing import heptane_state
from cldit.spray.droplet.advance import Advance, DropletStates, DropletSurroundings, advance
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table, property_table
from cldit.spray.droplet.models import MODELS, Model, inert
from cldit.spray.droplet.rates import Drop
from tests.kernels.droplet_twin import Properties
from tests.kernels.droplet_twin import film_on_device as film
from tests.verify.droplet_convergence import CASES, error_of, integrated, reference
from tests.verify.droplet_published import LIVES
from tests.verify.droplet_verification import wet_bulb


@cache
def n_heptane() -> Fuel:
    """Made at its first use: CoolProp takes more than a second to import."""
    return fuel_table("n-heptane", cache=None)


@cache
def nitrogen() -> Gas:
    return gas_table("nitrogen", cache=None)


def density(kelvin: ArrayLike) -> Floats:
    """Of the liquid, by the polynomial on the device, 1e-6 from the table."""
    fits = Properties(property_table(n_heptane(), nitrogen()))
    return np.asarray(fits.liquid(np.asarray(kelvin, dtype=float))[1])


def droplets(
    *, diameter_m: ArrayLike = 9e-6, liquid_K: ArrayLike = 370.0, velocity_m_s: ArrayLike = 0.0
) -> DropletStates:
    """Moving along the only axis."""
    d, t, u = np.broadcast_arrays(*np.atleast_1d(diameter_m, liquid_K, velocity_m_s))
    return DropletStates(np.pi / 6 * d**3 * density(t), t.astype(float), u.astype(float)[:, None])


def around(
    count: int = 1, *, gas_K: float = 573.0, pressure_Pa: float = 0.6e6, vapour: float = 0.0
) -> DropletSurroundings:
    """Gas at rest."""
    many = np.ones(count)
    return DropletSurroundings(
        gas_K * many, pressure_Pa * many, vapour * many, np.zeros((count, 1))
    )


FIRST = MODELS["abramzon-sirignano"]
Makes = Callable[[Model], DropletKernels]


class Follow(Protocol):
    def __call__(
        self,
        start: DropletStates,
        gas: DropletSurroundings,
        duration_s: float,
        *,
        model: Model = ...,
        tolerance: float = ...,
    ) -> Advance: ...


@pytest.fixture(scope="module")
def kernels(device: Device) -> Makes:
    """Kernels of a model, made once."""
    return cache(lambda model: DropletKernels.of(device, n_heptane(), nitrogen(), model))


@pytest.fixture
def follow(kernels: Makes) -> Follow:
    def call(
        start: DropletStates,
        gas: DropletSurroundings,
        duration_s: float,
        *,
        model: Model = FIRST,
        tolerance: float = 1e-3,
    ) -> Advance:
        return advance(start, gas, duration_s, kernels(model), tolerance=tolerance)

    return call


def written(mass_kg_s: str, heat_W: str) -> Model:
    """Model of two expressions in OpenCL C."""
    source = """#include "spray/evaporation.h"
    INLINE Rates written(__global const real *fuel, FarGas gas, Drop drop, Film film)
    {
        const Rates rates = {%s, %s};
        return rates;
    }"""
    return Model("written", source % (mass_kg_s, heat_W))


def even(constant_kg_m_s: float) -> Model:
    """Evaporates in proportion to the diameter, at constant temperature: the d2 law."""
    return written(f"R({constant_kg_m_s!r}) * drop.diameter", "(lane_t)R(0)")


# --- exact solutions, to rounding unless another reason is given ----------------------------------


def test_d2_law_in_one_step_and_in_many(follow: Follow) -> None:
    """K = 4 c/(pi rho), life d0^2/K: exact for any step."""
    c = 1e-4
    start = droplets(diameter_m=[5e-6, 9e-6, 30e-6])
    k = 4 * c / (np.pi * float(density(370.0)))
    first = np.array([5e-6, 9e-6, 30e-6])
    found = follow(start, around(3), 1.0, model=even(c))
    assert found.gone_s == pytest.approx(first**2 / k, rel=1e-12)
    state = start
    step = first[1] ** 2 / k / 10
    for number in range(1, 8):
        state = follow(state, around(3), step, model=even(c)).droplets
        d2 = np.cbrt(6 / np.pi * state.mass_kg / density(state.temperature_K)) ** 2
        wanted = np.maximum(first**2 - k * step * number, 0)
        assert d2 == pytest.approx(wanted, rel=1e-10, abs=1e-24)


def test_thermal_relaxation(follow: Follow) -> None:
    """tau = rho cp d^2/(12 lam) at Nu = 2; over 0.1 K cp changes by 2e-4 of itself."""
    lam = 0.03
    model = written(
        "(lane_t)R(0)",
        f"R({2 * np.pi * lam!r}) * drop.diameter * (gas.temperature - drop.temperature)",
    )
    density, cp = (float(v) for v in n_heptane().liquid.at(370.0, "density", "cp"))
    tau = density * cp * 81e-12 / (12 * lam)
    for times in (0.1, 1.0, 5.0):
        found = follow(droplets(), around(gas_K=370.1), times * tau, model=model)
        wanted = 370.1 - 0.1 * np.exp(-times)
        assert found.droplets.temperature_K[0] == pytest.approx(wanted, abs=0.1 * 2e-4)


def viscosity(kernels: Makes) -> float:
    """Of the film that the integrator sees in gas at the liquid's temperature and 1 kPa vapour."""
    at = Drop(*(np.array([v]) for v in (9e-6, 250.0, 250.0, 1e5, 0.0, 0.0)))
    state = film(at, kernels(inert))
    return float(state.viscosity_Pa_s[0])


def test_stokes_relaxation_and_path(follow: Follow, kernels: Makes) -> None:
    """u = u0 exp(-t/tau), way u0 tau (1 - exp(-t/tau)). At Re = 7e-7 Schiller and Naumann's
    correction is 0.15 Re^0.687 = 1e-5."""
    tau = float(density(250.0)) * 81e-12 / (18 * viscosity(kernels))
    start = droplets(liquid_K=250.0, velocity_m_s=1e-6)
    gas = around(gas_K=250.0, pressure_Pa=1e5)
    for times in (0.01, 1.0, 4.0):
        found = follow(start, gas, times * tau, model=inert)
        left = np.exp(-times)
        assert found.droplets.velocity_m_s[0, 0] == pytest.approx(1e-6 * left, rel=1e-4)
        assert found.path_m[0, 0] == pytest.approx(1e-6 * tau * (1 - left), rel=1e-4)


def test_stokes_drag_on_a_shrinking_droplet(follow: Follow, kernels: Makes) -> None:
    """With the d2 law the slip falls as s^(1/(k tau)), s = 1 - k t; both in closed form."""
    tau = float(density(250.0)) * 81e-12 / (18 * viscosity(kernels))
    k = 0.7 / tau
    c = k * 81e-12 * np.pi * float(density(250.0)) / 4
    start = droplets(liquid_K=250.0, velocity_m_s=1e-6)
    gas = around(gas_K=250.0, pressure_Pa=1e5)
    for part in (0.1, 0.5, 0.99):
        found = follow(start, gas, part / k, model=even(c))
        wanted = 1e-6 * (1 - part) ** (1 / 0.7)
        assert found.droplets.velocity_m_s[0, 0] == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("speed", [1.0, 30.0, 150.0])
def test_drag_beyond_stokes(follow: Follow, kernels: Makes, speed: float) -> None:
    """Against scipy; Re up to 1900, on both sides of 1000, where Cd jumps by 0.3 %."""
    start = droplets(diameter_m=20e-6, liquid_K=250.0, velocity_m_s=speed)
    gas = around(gas_K=250.0, pressure_Pa=0.6e6)
    mu, rho = viscosity(kernels), 0.6e6 / (8.314 * 250.0) * nitrogen().molar_mass_kg_mol
    tau = float(density(250.0)) * 400e-12 / (18 * mu)

    def slopes(_: float, u: np.ndarray) -> np.ndarray:
        re = rho * np.abs(u) * 20e-6 / mu
        factor = np.where(re < 1000, 1 + 0.15 * re**0.687, 0.44 / 24 * re)
        return np.asarray(-u / tau * factor)

    exact = solve_ivp(slopes, (0, tau / 4), [speed], rtol=1e-9, atol=1e-12).y[0, -1]
    found = follow(start, gas, tau / 4, model=inert).droplets.velocity_m_s[0, 0]
    # Vapour at the surface, 300 Pa of 0.6 MPa, changes mu by 1e-3.
    assert found == pytest.approx(float(exact), rel=3e-3)


def test_at_the_wet_bulb_the_temperature_stays(follow: Follow, kernels: Makes) -> None:
    """Isothermal identity: at rest neither rate depends on size, so no life of it warms a droplet.
    The wet bulb is found to 1e-9 K."""
    warm, _ = wet_bulb(kernels(FIRST), gas_K=573.0, pressure_Pa=0.6e6)
    start = droplets(liquid_K=warm)
    found = follow(start, around(), 4e-4)
    assert found.droplets.mass_kg[0] < 0.2 * start.mass_kg[0]
    assert found.droplets.temperature_K[0] == pytest.approx(warm, abs=1e-8)


# --- independent figures --------------------------------------------------------------------------

ORDER = ("abramzon-sirignano", "dukowicz", "dukowicz-log", "frolov-type")


@pytest.mark.parametrize("row", LIVES, ids=lambda row: f"{row[0] / 1e6:g}MPa-{row[1]:g}K")
def test_lifetimes(
    follow: Follow, row: tuple[float, float, tuple[int, ...], tuple[int, ...]]
) -> None:
    pressure, gas_K, lives, halves = row
    gas = around(gas_K=gas_K, pressure_Pa=pressure)
    start = droplets()
    for name, life, half in zip(ORDER, lives, halves, strict=True):
        model = MODELS[name]
        found = follow(start, gas, 1.0, model=model)
        assert found.gone_s[0] == pytest.approx(life * 1e-6, rel=0.01), name
        left = follow(start, gas, half * 1e-6, model=model).droplets.mass_kg / start.mass_kg
        # Printed to a microsecond, which is up to 2 % of half the mass.
        assert left[0] == pytest.approx(0.5, abs=0.012), name


# The models differ where it is stiff; the small droplet is the stiff one on another clock.
@pytest.mark.parametrize(
    ("number", "name"),
    [(1, m) for m in MODELS] + [(n, "abramzon-sirignano") for n in (0, 2, 3)],
)
def test_against_radau(kernels: Makes, name: str, number: int) -> None:
    """Errors add up over some ten steps and partly cancel: twice the tolerance of a step."""
    chosen = CASES[number]
    wanted = reference(chosen, kernels(MODELS[name]))
    for tolerance in (1e-2, 1e-3):
        found = integrated(
            chosen,
            kernels(MODELS[name]),
            half_s=wanted.life_s / 2,
            steps=1,
            tolerance=tolerance,
        )
        assert error_of(found, wanted) < 2 * tolerance


def test_second_order_in_the_step(kernels: Makes) -> None:
    """Halving it divides the error by 4, to the next order."""
    case, model = CASES[0], FIRST
    wanted = reference(case, kernels(model))
    errors = [
        error_of(
            integrated(
                case,
                kernels(model),
                half_s=wanted.life_s / 2,
                steps=steps,
                tolerance=np.inf,
            ),
            wanted,
        )
        for steps in (16, 32, 64)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


# --- conservation ---------------------------------------------------------------------------------


def crowd(count: int, seed: int) -> tuple[DropletStates, DropletSurroundings]:
    rng = np.random.default_rng(seed)
    diameter = np.exp(rng.uniform(np.log(0.1e-6), np.log(100e-6), count))
    warm = rng.uniform(260.0, 420.0, count)
    gas = DropletSurroundings(
        rng.uniform(280.0, 900.0, count),
        np.exp(rng.uniform(np.log(0.1e6), np.log(2.2e6), count)),
        rng.uniform(0.0, 0.6, count),
        rng.normal(0.0, 20.0, (count, 3)),
    )
    speed = rng.normal(0.0, 60.0, (count, 3))
    return DropletStates(n_heptane().mass_kg(diameter, warm), warm, speed), gas


@pytest.mark.parametrize("name", MODELS)
def test_a_crowd_in_pieces(follow: Follow, name: str) -> None:
    """What is released over pieces of time is what the liquid lost over all of it, to rounding."""
    start, gas = crowd(200, seed=7)
    state = start
    mass, heat, momentum = np.zeros(200), np.zeros(200), np.zeros((200, 3))
    for _ in range(5):
        found = follow(state, gas, 2e-5, model=MODELS[name])
        state = found.droplets
        mass, heat = mass + found.mass_kg, heat + found.enthalpy_J
        momentum = momentum + found.momentum_kg_m_s
        assert np.all(np.isfinite(state.temperature_K)) and np.all(state.mass_kg >= 0)
    assert start.mass_kg == pytest.approx(mass + state.mass_kg, rel=1e-13)
    enthalpy = n_heptane().liquid.value(
        "enthalpy", np.array([start.temperature_K, state.temperature_K])
    )
    first = start.mass_kg * enthalpy[0]
    scale = np.maximum(start.mass_kg, state.mass_kg) * 1e5  # some grow
    assert np.all(np.abs(first - heat - state.mass_kg * enthalpy[1]) < 1e-13 * scale)
    moving = start.mass_kg[:, None] * start.velocity_m_s
    error = moving - momentum - state.mass_kg[:, None] * state.velocity_m_s
    assert np.all(np.abs(error) < 1e-13 * scale[:, None] * 1e-3)
    gone = state.mass_kg == 0
    assert 20 < gone.sum() < 180
    assert mass[gone] == pytest.approx(start.mass_kg[gone], rel=1e-14)


def test_pieces_of_time_do_not_matter(follow: Follow) -> None:
    """Beyond the tolerance of the steps, that is."""
    start, gas = crowd(40, seed=3)
    whole = follow(start, gas, 1e-4, tolerance=1e-4)
    state = start
    for _ in range(10):
        state = follow(state, gas, 1e-5, tolerance=1e-4).droplets
    ratio = (state.mass_kg - whole.droplets.mass_kg) / start.mass_kg
    assert np.abs(ratio).max() < 2e-3
    left = whole.droplets.mass_kg > 1e-3 * start.mass_kg
    speed = np.abs(state.velocity_m_s - whole.droplets.velocity_m_s)[left]
    assert speed.max() < 0.3  # of 60 m/s


def test_closed_box_ends_saturated(follow: Follow) -> None:
    """As much fuel as gas: conserved to rounding, and at the end the adiabatic saturation of
    another program part with other fits (1 % in psat is 0.3 K; latent heats 2 % apart, 1.5 K)."""
    gas_kg, pressure = 1.0, 0.6e6
    start = droplets(diameter_m=3e-6)
    number = 1.0 * gas_kg / start.mass_kg[0]
    vapour_kg, state = 0.0, start
    enthalpy = gas_kg * float(nitrogen().vapour.value("enthalpy", 573.0))
    total = enthalpy + number * float(
        start.mass_kg[0] * n_heptane().liquid.value("enthalpy", 370.0)
    )
    warm = 573.0
    for _ in range(400):
        share = vapour_kg / (vapour_kg + gas_kg)
        box = around(gas_K=warm, pressure_Pa=pressure, vapour=share)
        found = follow(state, box, 1e-6)
        state = found.droplets
        vapour_kg += number * float(found.mass_kg[0])
        enthalpy += number * float(found.enthalpy_J[0])
        low, high = 250.0, 700.0
        for _ in range(50):
            warm = 0.5 * (low + high)
            heat = gas_kg * nitrogen().vapour.value("enthalpy", warm)
            heat = heat + vapour_kg * n_heptane().vapour.value("enthalpy", warm)
            low, high = (warm, high) if heat < enthalpy else (low, warm)
    liquid_kg = number * state.mass_kg[0]
    assert vapour_kg + liquid_kg == pytest.approx(1.0, rel=1e-12)
    kept = enthalpy + liquid_kg * n_heptane().liquid.value("enthalpy", state.temperature_K[0])
    assert float(kept) == pytest.approx(total, abs=1e-9 * abs(enthalpy))
    assert warm == pytest.approx(state.temperature_K[0], abs=0.5)
    wanted_K, evaporated = heptane_state(
        np.array([1.0]), fuel_K=370.0, gas_K=573.0, pressure_Pa=pressure
    )
    assert warm == pytest.approx(float(wanted_K[0]), abs=1.5)
    assert vapour_kg == pytest.approx(float(evaporated[0]), rel=0.03)


# --- abuse ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MODELS)
def test_superheated_droplets_cool_to_boiling(follow: Follow, name: str) -> None:
    boiling = float(n_heptane().boiling_K(0.15e6))
    warm = np.array([boiling + 1, 450.0, 520.0])
    found = follow(
        droplets(liquid_K=warm),
        around(3, gas_K=900.0, pressure_Pa=0.15e6),
        2e-5,
        model=MODELS[name],
    )
    left = found.droplets.mass_kg > 0
    # With finite conductivity only the surface boils; the inside halves its excess in R^2/alpha.
    limit = 0.5 * (warm + boiling) if name == "frolov-type" else np.full(3, boiling)
    assert np.all(found.droplets.temperature_K[left] < limit[left])


@pytest.mark.parametrize("name", MODELS)
def test_no_step_is_too_long_and_no_droplet_too_small(follow: Follow, name: str) -> None:
    start, gas = crowd(300, seed=11)
    dry = DropletSurroundings(gas.temperature_K, gas.pressure_Pa, np.zeros(300), gas.velocity_m_s)
    found = follow(start, dry, 1e5, model=MODELS[name])
    assert np.all(found.gone_s < 1e5) and np.all(found.droplets.mass_kg == 0)
    assert found.steps < 300
    assert found.droplets.velocity_m_s == pytest.approx(dry.velocity_m_s)  # at rest at the end


def test_nothing_to_do(follow: Follow) -> None:
    none = DropletStates(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    empty = DropletSurroundings(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    assert follow(none, empty, 1.0).mass_kg.size == 0
    start = droplets()
    still = follow(start, around(), 0.0)
    assert still.droplets.mass_kg[0] == start.mass_kg[0] and still.gone_s[0] == np.inf
    gone = DropletStates(np.zeros(1), start.temperature_K, start.velocity_m_s)
    assert follow(gone, around(), 1.0).gone_s[0] == 0.0


@pytest.mark.parametrize(
    ("start", "gas", "duration_s", "says"),
    [
        (
            DropletStates(np.array([-1e-12]), np.array([300.0]), np.zeros((1, 1))),
            around(),
            1,
            "mass_kg",
        ),
        (droplets(liquid_K=535.0), around(), 1, "temperature_K of a droplet is 535"),
        (droplets(), around(gas_K=float("nan")), 1, "temperature_K of the gas is nan"),
        (droplets(), around(pressure_Pa=2e7), 1, "pressure_Pa of the gas is 2e.07"),
        (droplets(), around(vapour=1.2), 1, "vapour, mass fraction in the gas, is 1.2"),
        (droplets(velocity_m_s=float("nan")), around(), 1, "velocity_m_s of the droplet"),
        (droplets(), around(), -1, "duration_s is -1"),
        (droplets(), around(), float("nan"), "duration_s is nan"),
    ],
)
def test_refused(
    follow: Follow, start: DropletStates, gas: DropletSurroundings, duration_s: float, says: str
) -> None:
    with pytest.raises(SprayError, match=says):
        follow(start, gas, duration_s)
