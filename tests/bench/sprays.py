"""Computed spray against correlations and measurements; nothing is tuned. Half an hour.

python -m tests.bench sprays --out build/sprays.md    # docs/verification-spray.md is its summary
python -m tests.bench sprays --only half --spacing-mm 2
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cldit.gpu.device import open_device
from cldit.io.files import append_text, write_text
from cldit.run import default_cache
from cldit.show.page import Block, Page, Section, Table, markdown_of
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import fuel_table, gas_table
from cldit.spray.droplet.models import MODELS
from cldit.spray.flow.mixture import gas_mixture
from cldit.spray.flow.simulate import simulate_spray
from tests.bench.spray_g import spray_g
from tests.bench.spray_history import Bench
from tests.unit.spray.flow.free_jet import free_jet
from tests.unit.spray.flow.gas_jet import JET, gas_jet
from tests.unit.spray.flow.references import (
    CONDITIONS,
    Found,
    alone,
    at,
    mean_liquid_K,
    saturation,
)
from tests.verify.droplet_verification import wet_bulb


def page(
    cache: Path,
    *,
    spacing_m: float = 1e-3,
    only: Collection[str] = (),
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[str]:
    """Markdown of the head and of each of `SECTIONS`, or `only` of some sections."""
    bench = Bench(cache, spacing_m, say)
    if not only:
        cells = f"Cells of the gas are {1e3 * spacing_m:g} mm wide 25 mm from the hole."
        yield Page("Verification of the computed spray: all numbers", [_TOP, cells]).markdown()
    for name, section in SECTIONS.items():
        if not only or name in only:
            yield f"\n{markdown_of([section(bench)])}\n"


_TOP = (
    "Nothing is tuned to any of these figures. 10 mg of n-heptane of 370 K, 20 MPa, eight holes of "
    "165 µm at 33°, 0.78 ms, at 0.95 ms after the start of injection, unless another is named."
)


def _conditions(bench: Bench) -> Section:
    box, cache = bench.box(), bench.cache
    found = [bench.run(f"{p:g} MPa, {t} K", at(p, t, box=box)) for p, t in CONDITIONS]
    lone = [bench.run(f"{p:g} MPa, {t} K, alone", alone(at(p, t, box=box))) for p, t in CONDITIONS]
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    kernels = DropletKernels.of(open_device(), fuel, gas, MODELS["abramzon-sirignano"])
    rows = []
    for each, single in zip(found, lone, strict=True):
        ambient, notes = each.spec.ambient, each.spray.notes
        pressure, gas_K = ambient.pressure_Pa, ambient.temperature_K
        t_sat, _ = saturation(fuel, gas, fuel_K=370.0, gas_K=gas_K, pressure_Pa=pressure)
        bulb, _ = wet_bulb(kernels, gas_K=gas_K, pressure_Pa=pressure)
        vapour, by_itself = (
            notes["vapour_penetration_m"],
            single.spray.notes["vapour_penetration_m"],
        )
        rows.append(
            [
                f"{pressure / 1e6:g} MPa, {gas_K:.0f} K",
                f"{1e3 * notes['liquid_penetration_m']:.1f}",
                f"{1e3 * notes['thin_liquid_penetration_m']:.1f}",
                f"{1e3 * vapour:.1f} ({vapour / each.naber_siebers_m:.2f})",
                f"{1e3 * by_itself:.1f} ({by_itself / single.naber_siebers_m:.2f})",
                f"{1e3 * each.naber_siebers_m:.1f}",
                f"{np.degrees(each.half_angle_rad):.1f}",
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
        "thin, mm",
        "vapour, mm (ratio)",
        "one plume alone, mm (ratio)",
        "Naber-Siebers, mm",
        "half angle, °",
        "evaporated, %",
        "D32, µm",
        "coldest gas, K",
        "saturation, K",
        "droplets, K",
        "wet bulb, K",
        "CPU, s",
    ]
    return Section(
        "Pressure and temperature of the gas",
        [
            "Liquid: the farthest distance along the injector's axis with 2e-3 mm³ of liquid on "
            "a mm² that is looked at across it, the Engine Combustion Network's definition; "
            "thin: with 0.2e-3. Vapour: along the plumes, to a mass fraction of 0.001, mean of "
            "the plumes; in brackets over Naber and Siebers (SAE 960034) for the same flow, "
            "speed and cone (11° to each side), full flow from the start of injection on. "
            "Theirs is one plume in gas at rest, so one is computed by itself, too. Saturation "
            "is the temperature that fuel and gas have where the gas mixed in just evaporates "
            "all fuel; wet bulb that of a droplet in the undisturbed gas.",
            Table(heading, rows),
        ],
    )


def _late(bench: Bench) -> Section:
    rows = []
    for p, t in CONDITIONS:
        spec = at(p, t, box=bench.box(2), time_s=1.5e-3)
        each = bench.run(f"{p:g} MPa, {t} K, 1.5 ms", spec)
        ambient, notes = each.spec.ambient, each.spray.notes
        rows.append(
            [
                f"{ambient.pressure_Pa / 1e6:g} MPa, {ambient.temperature_K:.0f} K",
                *(
                    f"{1e3 * notes[name]:.1f}"
                    for name in (
                        "liquid_penetration_m",
                        "thin_liquid_penetration_m",
                        "vapour_penetration_m",
                    )
                ),
                f"{1e6 * notes['liquid_mass_kg']:.2f}",
            ]
        )
    heading = ["gas, at 1.5 ms", "liquid, mm", "thin, mm", "vapour, mm", "liquid, mg"]
    return Section(
        "Later",
        [
            "1.5 ms after the start of injection, when droplets are looked at by visible light; on "
            f"a grid of {2e3 * bench.spacing_m:g} mm. 0.0: nowhere as much.",
            Table(heading, rows),
        ],
    )


def _eddies(bench: Bench) -> Section:
    cache, spacing_m = bench.cache, bench.spacing_m
    fuel, gas = fuel_table("n-heptane", cache=cache), gas_table("nitrogen", cache=cache)
    mixture = gas_mixture(fuel, gas, reference_K=573.0)
    rows = [
        ["measured", "", "0.085", "0.28", "7.4"],
    ]
    for label, spacing, rate in (
        ("nitrogen", 2 * spacing_m, 0.0),
        ("nitrogen", spacing_m, 0.0),
        ("nitrogen and 1.6 g/s of cold vapour", spacing_m, 1.6e-3),
    ):
        jet = free_jet(mixture, open_device(), spacing_m=spacing, fuel_kg_s=rate)
        columns = (jet.density, jet.half_width, jet.entrainment, jet.decay)
        texts = [", ".join(f"{value:.3g}" for value in column) for column in columns]
        rows.append([f"{label}, {1e3 * spacing:g} mm", *texts])
    heading = [
        "jet of 0.3 N, at 20, 25, 30 mm",
        "density on the axis / around",
        "half width / x",
        "mass flux / (sqrt(rho F) x)",
        "U x / sqrt(F/rho)",
    ]
    return Section(
        "A jet of gas alone",
        [
            "Without droplets, after 1.5 ms, along the injector's axis. Measured: half width "
            "and speed on the axis as in Abani and Reitz (K = 0.457), mass flux by Ricou and "
            "Spalding (1961), who found it to be the same whatever the jet's own density is. A "
            "Gaussian profile of this half width and speed carries pi 0.085² 7.4 / ln 2 = "
            "0.242: the rest of 0.28 is in tails of measured profiles, which Prandtl's mixing "
            "length does not have.",
            Table(heading, rows),
        ],
    )


def _parcels(bench: Bench) -> Section:
    changes: dict[str, dict[str, Any]] = {
        f"{1e3 * bench.spacing_m:g} mm, 1e4 droplets a parcel": {},
        "5e3 droplets a parcel": {"droplets_per_parcel": 5e3},
        "2.5e3 droplets a parcel": {"droplets_per_parcel": 2.5e3},
        "another seed": {"seed": 2},
        "a third seed": {"seed": 3},
        f"{2e3 * bench.spacing_m:g} mm": {"box": bench.box(2)},
    }
    found = [
        (name, bench.run(name, at(0.6, 573, **{"box": bench.box(), **change})))
        for name, change in changes.items()
    ]
    return Section("Grid and parcels", [_compared(found)])


def _half(bench: Bench) -> Section:
    content: list[Block] = [
        "One plume alone has an eighth of the droplets a parcel, so as many parcels as eight have."
    ]
    eight = at(0.6, 573)
    few = eight.droplets_per_parcel / len(eight.plumes)
    single = alone(eight).model_copy(update={"droplets_per_parcel": few})
    for label, spec in (("one plume alone", single), ("eight plumes", eight)):
        found = []
        for part in (1.0, 0.5):
            name = f"{label}, {1e3 * part * bench.spacing_m:g} mm"
            box = spec.box.model_copy(update={"spacing_m": part * bench.spacing_m})
            found.append((name, bench.run(name, spec.model_copy(update={"box": box}))))
        content.append(_compared(found))
    return Section("Half the spacing", content)


def _compared(found: Sequence[tuple[str, Found]]) -> Table:
    """Compares each with the first."""
    first = found[0][1]
    base = first.spray.notes
    rows = []
    for name, each in found:
        notes = each.spray.notes
        cells = []
        for key in ("liquid_penetration_m", "thin_liquid_penetration_m", "vapour_penetration_m"):
            change = 100 * (notes[key] / base[key] - 1)
            cells.append(f"{1e3 * notes[key]:.1f} ({change:+.1f} %)")
        early = [
            np.interp(0.5e-3, one.history.time_s, one.history.liquid_m) for one in (each, first)
        ]
        cells.append(f"{1e3 * early[0]:.1f} ({100 * (early[0] / early[1] - 1):+.1f} %)")
        cells.append(f"{100 * notes['vapour_mass_kg'] / notes['injected_mass_kg']:.1f}")
        rows.append([name, *cells, f"{each.seconds:.0f}"])
    heading = [
        "0.6 MPa, 573 K",
        "liquid, mm",
        "thin, mm",
        "vapour, mm",
        "liquid at 0.5 ms, mm",
        "evaporated, %",
        "CPU, s",
    ]
    return Table(heading, rows)


def _methane(bench: Bench) -> Section:
    device, fuel = open_device(), fuel_table("methane", cache=bench.cache)
    rows = [["measured", "3.0", "0.108, 0.111", "9.52", "7.4", "0.28"]]
    for part in (2.0, 1.0):
        spec = JET.model_copy(update={"box": bench.box(part)})
        found = gas_jet(simulate_spray(spec, device, cache=bench.cache), fuel)
        columns = (found.tip[[0, 2, 4]], found.half_width, found.axis, found.decay)
        texts = [
            ", ".join(f"{value:.3g}" for value in one) for one in (*columns, found.entrainment)
        ]
        rows.append([f"{1e3 * part * bench.spacing_m:g} mm", *texts])
    heading = [
        "at 0.1, 0.3, 0.5 ms; 15, 20, 25 mm",
        "tip / ((F/rho)^(1/4) sqrt(t))",
        "half width of Y / x",
        "Y x / r_e",
        "U x / sqrt(F/rho)",
        "mass flux / (sqrt(rho F) x)",
    ]
    return Section(
        "A jet of methane",
        [
            "From 15 into 0.4 MPa of nitrogen at 520 K through 0.4 mm, thrust F = 1.67 N. Tip: "
            "P. G. Hill and P. Ouellette, J. Fluids Eng. 121, 93 (1999), under-expanded methane "
            "among their jets. Half width of the mass fraction Y, and Y on the axis over r_e / "
            "x (r_e: radius of the notional nozzle times the root of its density over that "
            "around): C. D. Richards and W. M. Pitts, and 0.111 of an under-expanded jet, both "
            "by A. J. Ruggles and I. W. Ekoto, Int. J. Hydrogen Energy 37, 17549 (2012), who "
            "find r_e of this notional nozzle (Yüceil and Ötügen) 9 % small, which makes 10.5 "
            "of 9.52. The mean flow carries all of the fuel, where eddies carry a part along a "
            "real jet: with Gaussian profiles of half widths 0.085 and 0.108, and 7.4, it must "
            "have 11.8.",
            Table(heading, rows),
        ],
    )


SECTIONS: dict[str, Callable[[Bench], Section]] = {
    "conditions": _conditions,
    "later": _late,
    "spray-g": spray_g,
    "parcels": _parcels,
    "half": _half,
    "jet": _eddies,
    "methane": _methane,
}


def main() -> None:
    """Writes each section as it is done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Markdown file; printed if omitted")
    parser.add_argument("--spacing-mm", type=float, default=1.0)
    parser.add_argument("--only", action="append", default=[], choices=list(SECTIONS))
    given = parser.parse_args()
    pieces = page(default_cache(), spacing_m=1e-3 * given.spacing_mm, only=given.only, say=print)
    if given.out is not None:
        write_text(given.out, "")
    for piece in pieces:
        if given.out is None:
            print(piece, end="")
        else:
            append_text(given.out, piece)
