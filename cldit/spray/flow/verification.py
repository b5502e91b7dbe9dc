"""The computed spray against what is known of sprays, as a page of tables; nothing is tuned."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.scene.spray import Ambient, FlowBox, LagrangianSpray
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.droplet.verification import wet_bulb
from cldit.spray.flow.injector import inject
from cldit.spray.flow.measures import History
from cldit.spray.flow.simulate import simulate_spray
from cldit.spray.jet import Jet
from cldit.spray.result import Spray
from cldit.spray.sizes import mean_diameter_m

CONDITIONS = (  # MPa, K
    (0.15, 300),
    (0.15, 620),
    (0.3, 500),
    (0.6, 300),
    (0.6, 400),
    (0.6, 573),
    (0.9, 300),
    (0.9, 620),
)
BASE = LagrangianSpray(injection_duration_s=0.78e-3)  # 10 mg, eight holes, at 0.95 ms
SPRAY_G = BASE.model_copy(  # ECN: iso-octane, 363 K, 20 MPa, into 573 K at 3.5 kg/m3
    update={
        "fuel": "iso-octane",
        "fuel_temperature_K": 363.0,
        "ambient": Ambient(pressure_Pa=0.6e6, temperature_K=573.0),
        "time_s": 1.0e-3,
    }
)


@dataclass(frozen=True)
class Found:
    """A spray, how it came there, the processor time it took, and the jet of one of its plumes by
    Naber and Siebers, for the same flow, speed and cone."""

    spec: LagrangianSpray
    spray: Spray
    history: History
    axis_m_s: float
    seconds: float
    jet: Jet

    @property
    def naber_siebers_m(self) -> float:
        """The jet has its full flow from the start; here it begins in the middle of the ramp."""
        return self.jet.tip_m(self.spec.time_s - self.spec.rate.ramp_s / 2)


def find(spec: LagrangianSpray, *, cache: Path | None) -> Found:
    fuel = fuel_table(spec.fuel, cache=cache)
    gas = gas_table(spec.gas, cache=cache)
    start = time.process_time()
    spray, history, flow = simulate_spray(spec, cache=cache)
    seconds = time.process_time() - start
    middle = [count // 2 for count in flow.box.shape[:2]]
    level = int((-15e-3 - flow.box.origin_m[2]) / flow.box.spacing_m)
    around = (slice(middle[0] - 1, middle[0] + 1), slice(middle[1] - 1, middle[1] + 1), level)
    return Found(
        spec, spray, history, float(-flow.velocity[2][around].mean()), seconds, jet(spec, fuel, gas)
    )


def jet(spec: LagrangianSpray, fuel: Fuel, gas: Gas) -> Jet:
    """Of the first plume, by Naber and Siebers."""
    injection = inject(spec, fuel)
    hole, ambient = injection.holes[0], spec.ambient
    density = ambient.pressure_Pa * gas.molar_mass_kg_mol / (8.314462618 * ambient.temperature_K)
    return Jet(
        rate_kg_s=np.pi / 4 * hole.diameter_m**2 * injection.density_kg_m3 * injection.speed_m_s,
        speed_m_s=injection.speed_m_s,
        half_angle_rad=float(np.radians(spec.plumes[0].cone_angle_deg / 2)),
        fuel_kg_m3=injection.density_kg_m3,
        gas_kg_m3=density,
    )


def saturation(
    fuel: Fuel, gas: Gas, *, fuel_K: float, gas_K: float, pressure_Pa: float
) -> tuple[float, float]:
    """Adiabatic saturation: temperature, and fuel-to-gas mass ratio, at which the gas mixed in just
    evaporates all of the fuel. No colder gas can hold all of it as vapour."""
    heavy = fuel.molar_mass_kg_mol / gas.molar_mass_kg_mol
    low = fuel.liquid.low_K
    high = min(gas_K, float(fuel.boiling_K(pressure_Pa)) * (1 - 1e-9))
    ratio = 0.0
    for _ in range(60):
        t = 0.5 * (low + high)
        mole = float(fuel.saturation_Pa(t)) / pressure_Pa
        ratio = heavy * mole / (1 - mole)
        taken = float(
            fuel.liquid.one("enthalpy", t)
            + fuel.liquid.one("latent", t)
            - fuel.liquid.one("enthalpy", fuel_K)
        )
        had = float(gas.vapour.one("enthalpy", gas_K) - gas.vapour.one("enthalpy", t))
        low, high = (t, high) if ratio * taken < had else (low, t)
    return low, ratio


def page(
    cache: Path, *, spacing_m: float = 2e-3, say: Callable[[str], None] = lambda text: None
) -> str:
    """The tables, as Markdown, on a grid of that spacing; once on one of half of it."""

    def run(label: str, spec: LagrangianSpray) -> Found:
        found = find(spec, cache=cache)
        say(f"{label}: {found.seconds:.0f} s of processor time")
        return found

    box, finer = FlowBox(spacing_m=spacing_m), FlowBox(spacing_m=spacing_m / 2)
    conditions = [run(f"{p:g} MPa, {t} K", at(p, t, box=box)) for p, t in CONDITIONS]
    ecn = run("Spray G", SPRAY_G.model_copy(update={"box": box}))
    changes: dict[str, dict[str, Any]] = {
        f"{1e3 * spacing_m:g} mm, 1e4 droplets a parcel": {"box": box},
        "5e3 droplets a parcel": {"box": box, "droplets_per_parcel": 5e3},
        "another seed": {"box": box, "seed": 2},
        f"{500 * spacing_m:g} mm": {"box": finer},
    }
    variants = [(name, run(name, at(0.6, 573, **change))) for name, change in changes.items()]
    top = [*_TOP, f"The gas is on a grid of {1e3 * spacing_m:g} mm.", ""]
    return "\n".join(
        [*top, *_conditions(conditions, cache), *_ecn(ecn, cache), *_convergence(variants)]
    )


def at(pressure_MPa: float, gas_K: float, **changes: Any) -> LagrangianSpray:
    ambient = Ambient(pressure_Pa=pressure_MPa * 1e6, temperature_K=float(gas_K))
    return BASE.model_copy(update={"ambient": ambient, **changes})


_TOP = (
    "# Verification of the computed spray",
    "",
    "Written by `cldit bench spray --out docs/verification-spray.md`. Nothing is tuned to any of",
    "these figures. 10 mg of n-heptane of 370 K, 20 MPa, eight holes of 165 µm at 33°, 0.78 ms,",
    "looked at 0.95 ms after the start of injection, unless said otherwise.",
    "",
)


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [list(heading), ["---"] * len(heading), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def mean_liquid_K(spray: Spray) -> float:
    """By mass; NaN without liquid."""
    if (parcels := spray.parcels) is None:
        return float("nan")
    mass = parcels.droplets * parcels.density_kg_m3 * parcels.diameter_m**3
    return float(np.sum(mass * parcels.temperature_K) / mass.sum())


def _conditions(found: Sequence[Found], cache: Path) -> list[str]:
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    rows = []
    for each in found:
        ambient, notes = each.spec.ambient, each.spray.notes
        pressure, gas_K = ambient.pressure_Pa, ambient.temperature_K
        t_sat, _ = saturation(fuel, gas, fuel_K=370.0, gas_K=gas_K, pressure_Pa=pressure)
        bulb, _ = wet_bulb(
            fuel, gas, MODELS["abramzon-sirignano"], gas_K=gas_K, pressure_Pa=pressure
        )
        vapour, model = notes["vapour_penetration_m"], each.naber_siebers_m
        rows.append(
            [
                f"{pressure / 1e6:g} MPa, {gas_K:.0f} K",
                f"{1e3 * notes['liquid_penetration_m']:.1f}",
                f"{1e3 * vapour:.1f}",
                f"{1e3 * model:.1f}",
                f"{vapour / model:.2f}",
                f"{100 * notes['vapour_mass_kg'] / notes['injected_mass_kg']:.0f}",
                f"{1e6 * notes['sauter_mean_diameter_m']:.1f}",
                f"{notes['coldest_K']:.0f}",
                f"{t_sat:.0f}",
                f"{mean_liquid_K(each.spray):.0f}",
                f"{bulb:.0f}",
                f"{each.seconds:.0f}",
            ]
        )
    heading = [
        "gas",
        "liquid, mm",
        "vapour, mm",
        "Naber-Siebers, mm",
        "ratio",
        "evaporated, %",
        "D32, µm",
        "coldest gas, K",
        "saturation, K",
        "droplets, K",
        "wet bulb, K",
        "CPU, s",
    ]
    return [
        "## Pressure and temperature of the gas",
        "",
        "Penetration along the plumes: of the liquid, beyond which 3 % of the fuel is liquid; of",
        "the vapour, to a mass fraction of 0.001, mean of the plumes. Naber and Siebers (SAE",
        "960034) for the same flow, speed and cone. Saturation is the temperature that fuel and",
        "gas have where the gas mixed in just evaporates all fuel; wet bulb that of a droplet in",
        "the undisturbed gas.",
        "",
        *_table(heading, rows),
        "",
    ]


def _ecn(found: Found, cache: Path) -> list[str]:
    notes = found.spray.notes
    fuel, gas = fuel_table("iso-octane", cache=cache), gas_table("nitrogen", cache=cache)
    t_sat, _ = saturation(fuel, gas, fuel_K=363.0, gas_K=573.0, pressure_Pa=0.6e6)
    injected = 1e6 * mean_diameter_m(found.spec.droplets, 3, 2)
    rows = [
        ["largest liquid penetration, axial", f"{1e3 * found.history.axial_m.max():.1f} mm", "30"],
        [
            "vapour, along the plumes, 1.0 ms",
            f"{1e3 * notes['vapour_penetration_m']:.1f} mm",
            f"{1e3 * found.naber_siebers_m:.1f} (Naber-Siebers)",
        ],
        [
            "D32 of what passed z = 15 mm",
            f"{1e6 * notes['sauter_mean_diameter_at_15_mm_m']:.1f} µm",
            f"10 to 12; {injected:.1f} injected",
        ],
        ["gas on the axis at 15 mm, away from the injector", f"{found.axis_m_s:+.1f} m/s", "+1.4"],
        ["coldest gas", f"{notes['coldest_K']:.0f} K", f"{t_sat:.0f} K (saturation)"],
    ]
    return [
        "## Conditions of the ECN's Spray G",
        "",
        "Iso-octane of 363 K, 20 MPa, 10 mg in 0.78 ms into nitrogen of 573 K and 0.6 MPa.",
        "",
        *_table(["", "found", "expected"], rows),
        "",
    ]


def _convergence(found: Sequence[tuple[str, Found]]) -> list[str]:
    base = found[0][1].spray.notes
    rows = []
    for name, each in found:
        notes = each.spray.notes
        cells = []
        for key in ("liquid_penetration_m", "vapour_penetration_m"):
            change = 100 * (notes[key] / base[key] - 1)
            cells.append(f"{1e3 * notes[key]:.1f} ({change:+.1f} %)")
        cells.append(f"{100 * notes['vapour_mass_kg'] / notes['injected_mass_kg']:.1f}")
        rows.append([name, *cells, f"{each.seconds:.0f}"])
    heading = ["0.6 MPa, 573 K", "liquid, mm", "vapour, mm", "evaporated, %", "CPU, s"]
    return ["## Grid and parcels", "", *_table(heading, rows), ""]
