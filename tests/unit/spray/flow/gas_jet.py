"""A jet of gas from a hole, in the numbers in which jets are measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.scene.spray import Ambient, FlowBox, LagrangianSpray, Plume
from cldit.spray.droplet.fluids import Fuel
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.gas_jets import inject_gas
from cldit.spray.flow.measures import History
from cldit.spray.result import Spray

# A hole of 0.4 mm from 15 into 0.4 MPa, as in the scene methane-jet.
JET = LagrangianSpray(
    fuel="methane",
    fuel_temperature_K=370.0,
    injection_pressure_Pa=15e6,
    injected_mass_kg=3e-6,
    injection_duration_s=1.5e-3,
    hole_diameter_m=0.4e-3,
    time_s=0.5e-3,
    ambient=Ambient(pressure_Pa=0.4e6, temperature_K=520.0),
    droplets=None,
    plumes=(Plume(inclination_deg=0.0, azimuth_deg=0.0),),
    box=FlowBox(spacing_m=2e-3),
)
_TIMES_S = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3)
_RAMP_S = 25e-6  # by which the trapezoid of the rate is later than full flow at once


@dataclass(frozen=True)
class GasJet:
    """tip: over (thrust / rho)^(1/4) t^(1/2) at 0.1 to 0.5 ms. At 15, 20 and 25 mm: half width of
    the mass fraction over x; axis: mass fraction times x over r_e, the radius of the notional
    nozzle times the root of the density ratio; thrust and fuel of a section over those of the hole;
    decay and entrainment as in `free_jet`."""

    tip: Floats
    half_width: Floats
    axis: Floats
    thrust: Floats
    fuel: Floats
    decay: Floats
    entrainment: Floats


def gas_jet(result: tuple[Spray, History, GasFlow], fuel: Fuel) -> GasJet:
    """Measures of the result of `JET`, or of it on other cells."""
    _, history, flow = result
    injection, _ = inject_gas(JET, fuel)
    diameter, around = injection.jet_diameter_m[0], flow.far_density_kg_m3
    rate = np.pi / 4 * diameter**2 * injection.density_kg_m3 * injection.speed_m_s
    thrust = rate * injection.speed_m_s
    weighted = diameter / 2 * float(np.sqrt(injection.density_kg_m3 / around))
    times = np.array(_TIMES_S)
    reach = np.interp(times, history.time_s, history.vapour_m)
    tip = reach / ((thrust / around) ** 0.25 * np.sqrt(times - _RAMP_S))
    grid, share = flow.grid, flow.read("share")[0]
    speed = flow.read("velocity")[2, 0]
    flux = flow.fields.read(flow.arguments["flux"], 2)[0]
    polar, (low, high) = grid.middle[1], grid.middle[1][:2] ** 2
    rows = []
    for x in (15e-3, 20e-3, 25e-3):
        i = int(np.argmin(np.abs(grid.radius_m - x)))
        distance = float(grid.radius_m[i])
        here, fast = (0.5 * (each[:, i - 1] + each[:, i]) for each in (share, speed))
        # On the axis by the parabola through the first two rays.
        top, first = (each[0] + (each[0] - each[1]) * low / (high - low) for each in (here, fast))
        half = np.interp(-0.5 * top, -here, np.tan(polar))
        within = (flux[:, i] > 0) & (np.tan(polar) < 0.4)
        through = flux[:, i] * grid.copies
        rows.append(
            (
                half,
                top * distance / weighted,
                np.sum(through * fast) / thrust,
                np.sum(through * here) / rate,
                first * distance / np.sqrt(thrust / around),
                through[within].sum() / (np.sqrt(around * thrust) * distance),
            )
        )
    return GasJet(tip, *np.array(rows).T)
