"""The evaporation models beside published measurements, as a page of tables. Nothing is tuned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.bench.droplet import published
from cldit.bench.droplet.published import Suspended
from cldit.spray.droplet.curves import Floats
from cldit.spray.droplet.evaporation import MODELS, Drop, Model
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.droplet.follow import Life, follow

_EVEN = (0.25, 0.8)  # of d0^2: where K is read off, in the measurements as in the models
CONDITIONS = ((0.15, 300), (0.15, 573), (0.15, 620), (0.3, 500), (0.6, 573), (0.9, 300), (0.9, 620))


def wet_bulb(fuel: Fuel, gas: Gas, model: Model, *, gas_K: float, pressure_Pa: float) -> Floats:
    """The state at rest in which no heat enters the liquid.

    Args:
        fuel, gas: property tables.
        model: of evaporation.
        gas_K, pressure_Pa: of the gas.

    Returns:
        (2,) temperature [K], and d(d^2)/dt [mm2/s].
    """
    d = 10e-6
    drop = Drop(
        fuel=fuel,
        gas=gas,
        diameter_m=np.array([d]),
        temperature_K=np.array([gas_K]),
        gas_temperature_K=np.array([gas_K]),
        pressure_Pa=np.array([pressure_Pa]),
        vapour=np.zeros(1),
        slip_m_s=np.zeros(1),
    )
    low, high = fuel.liquid.low_K, min(gas_K, float(fuel.boiling_K(pressure_Pa)))
    for _ in range(50):  # down to rounding
        middle = 0.5 * (low + high)
        at = replace(drop, temperature_K=np.array([middle]))
        low, high = (middle, high) if model(at).heat_W[0] > 0 else (low, middle)
    rate = model(replace(drop, temperature_K=np.array([low]))).mass_kg_s[0]
    density = float(fuel.liquid.one("density", low))
    return np.array([low, 1e6 * 4 * rate / (np.pi * density * d)])


def steady_K_mm2_s(life: Life) -> float:
    """Slope of d^2 over its even part."""
    square = (life.diameter_m / life.diameter_m[0]) ** 2
    part = (square >= _EVEN[0]) & (square <= _EVEN[1])
    slope = np.polyfit(life.time_s[part], life.diameter_m[part] ** 2 * 1e6, 1)[0]
    return float(-slope)


def microgravity_K_mm2_s(
    model: str, *, gas_temperature_K: float, pressure_Pa: float, diameter_m: float, cache: Path
) -> float:
    """Rate d(d^2)/dt [mm2/s] of n-heptane at 298 K, put into nitrogen at rest.

    Args:
        model: a key of `MODELS`.
        gas_temperature_K, pressure_Pa: of the nitrogen.
        diameter_m: of the droplet.
        cache: folder of property tables.
    """
    life = follow(
        fuel="n-heptane",
        diameter_m=diameter_m,
        temperature_K=published.NOMURA_LIQUID_K,
        gas_temperature_K=gas_temperature_K,
        pressure_Pa=pressure_Pa,
        model=model,
        points=41,
        cache=cache,
    )
    return steady_K_mm2_s(life)


def nomura_K_mm2_s(case: published.Microgravity) -> float:
    """Slope of the measured points."""
    return float(-np.polyfit(case.time_s_mm2, case.diameter2, 1)[0])


def suspended_mm2(case: Suspended, model: str, *, cache: Path) -> Floats:
    """d^2 at the times of the measurement, in air at 101325 Pa.

    Args:
        case: measurement.
        model: a key of `MODELS`.
        cache: folder of property tables.

    Returns:
        (N,) mm2.
    """
    life = follow(
        fuel="n-heptane",
        gas="air",
        diameter_m=case.diameter_m,
        temperature_K=case.temperature_K,
        gas_temperature_K=case.gas_temperature_K,
        pressure_Pa=101325.0,
        velocity_m_s=case.velocity_m_s,
        model=model,
        held=True,
        points=41,
        cache=cache,
    )
    return np.asarray(np.interp(case.time_s, life.time_s, life.diameter_m**2 * 1e6, right=0.0))


def page(cache: Path) -> str:
    """The tables, as Markdown."""
    names = list(MODELS)
    return "\n".join(
        [
            *_TOP,
            "## Evaporation constant K at rest, mm²/s",
            "",
            "Slope of d² between 80 % and 25 % of its first value. The experiments disagree by a",
            "factor of two: Nomura's droplets (0.7 mm) also received heat through their fibre and",
            "by radiation; Verwey and Birouk extrapolate droplets of 14 µm to a fibre of no",
            "thickness. Film theory (the first two columns) lies between them.",
            "",
            *_table(["gas, K", "measured", *names], _K_rows(cache)),
            "",
            "## Suspended droplets in air, d² in mm²",
            "",
            *_table(["case, time", "measured", *names], _suspended_rows(cache)),
            "",
            "## Wet bulb, K / steady K, mm²/s, of n-heptane in nitrogen",
            "",
            *_table(["gas", *names], _wet_bulb_rows(cache)),
            "",
            "## Lifetime in µs of a droplet of 9 µm, injected at 370 K",
            "",
            *_table(["gas", *names], _lifetime_rows(cache)),
            "",
        ]
    )


_TOP = (
    "# Verification of the droplet models",
    "",
    "Written by `cldit droplet --verification docs/verification-droplets.md`. No constant of a",
    "model is fitted to any of these figures.",
    "",
    "Sources: Nomura et al., Symp. (Int.) Combust. 26, 1267 (1996), as digitised for PeleLMeX;",
    "Verwey and Birouk (2023), by their fit K = 3.6552e-4 T - 0.1078; the validation cases",
    "kolaitis_heptane_1 and _2 of the Fire Dynamics Simulator.",
    "",
)


def _table(heading: list[str], rows: list[list[str]]) -> list[str]:
    lines = [heading, ["---"] * len(heading), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def _K_rows(cache: Path) -> list[list[str]]:
    cases = [
        (f"{case.gas_temperature_K:.0f}, 0.7 mm (Nomura)", nomura_K_mm2_s(case), case, 0.7e-3)
        for case in published.NOMURA
    ]
    rows = []
    for label, measured, case, diameter in cases:
        found = [
            microgravity_K_mm2_s(
                name,
                gas_temperature_K=case.gas_temperature_K,
                pressure_Pa=published.NOMURA_Pa,
                diameter_m=diameter,
                cache=cache,
            )
            for name in MODELS
        ]
        rows.append([label, f"{measured:.3f}", *(f"{value:.3f}" for value in found)])
    for gas_K in published.VERWEY_BIROUK_K:
        found = [
            microgravity_K_mm2_s(
                name,
                gas_temperature_K=gas_K,
                pressure_Pa=101325.0,
                diameter_m=14e-6,
                cache=cache,
            )
            for name in MODELS
        ]
        measured = published.verwey_birouk_mm2_s(gas_K)
        cells = [f"{value:.3f}" for value in (measured, *found)]
        rows.append([f"{gas_K:.0f}, 14 µm (Verwey)", *cells])
    return rows


def _suspended_rows(cache: Path) -> list[list[str]]:
    rows = []
    for case in published.SUSPENDED:
        found = [suspended_mm2(case, name, cache=cache) for name in MODELS]
        for number, (time, measured) in enumerate(
            zip(case.time_s, case.diameter2_mm2, strict=True)
        ):
            cells = [f"{column[number]:.2f}" for column in found]
            rows.append([f"{case.source}, {time:.0f} s", f"{measured:.2f}", *cells])
    return rows


def _wet_bulb_rows(cache: Path) -> list[list[str]]:
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    rows = []
    for pressure, gas_K in CONDITIONS:
        found = [
            wet_bulb(fuel, gas, model, gas_K=gas_K, pressure_Pa=pressure * 1e6)
            for model in MODELS.values()
        ]
        cells = [f"{warm:.1f} / {k:.3f}" for warm, k in found]
        rows.append([f"{pressure:g} MPa, {gas_K} K", *cells])
    return rows


def _lifetime_rows(cache: Path) -> list[list[str]]:
    rows = []
    for pressure, gas_K in CONDITIONS:
        lives = [
            follow(
                fuel="n-heptane",
                diameter_m=9e-6,
                temperature_K=370.0,
                gas_temperature_K=gas_K,
                pressure_Pa=pressure * 1e6,
                model=name,
                points=2,
                cache=cache,
            )
            for name in MODELS
        ]
        cells = [f"{1e6 * life.time_s[-1]:.0f}" for life in lives]
        rows.append([f"{pressure:g} MPa, {gas_K} K", *cells])
    return rows
