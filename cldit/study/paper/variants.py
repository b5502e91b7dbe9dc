"""Studies of a reference and its variants: sizes, index, vapour, evaporation, fuel temperature."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from cldit.arrays import Mask
from cldit.optics.liquid import liquid
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import edges_um, scene_filter
from cldit.run import Run, reevaluated
from cldit.scene import Scene
from cldit.scene.spray import LagrangianSpray
from cldit.scene.vessel import PAPER_LEAF_M
from cldit.show.figures.maps import frame_of
from cldit.show.report.optics_summary import FIG4, PAPER
from cldit.study.figures import changes_sheet, maps_sheet
from cldit.study.lab import CAPTION_WALLS_K, GASES_K, Lab, gdi_in, in_gas
from cldit.study.measures import (
    Change,
    both_phases,
    droplets_K,
    mean_K,
    named,
    root,
    spray_of,
    tips,
    vapour_only,
    visible,
)
from cldit.study.page import Row
from cldit.study.paper.maps import all_round
from cldit.study.paper.results import Results

_WALLS = {"walls.temperature_K": CAPTION_WALLS_K}
_CHANCE = "other random numbers"
_NO_BREAK = "\N{NO-BREAK SPACE}"  # of a value and its unit


def change_rows(reference: Run, cases: Mapping[str, Run]) -> list[Row]:
    """Rows of T_app of each case minus that of the reference, over all of it and by place."""
    places: dict[str, Mask | None] = {
        "all": None,
        "both phases": both_phases(reference),
        "vapour only": vapour_only(reference),
    }
    rows: list[Row] = []
    for name, case in cases.items():
        change = Change.of(case, reference)
        row: dict[str, float | str] = {"case": name, "RMS / K": change.rms()}
        row["99th percentile / K"] = change.largest()
        row |= {f"mean, {place} / K": change.mean(mask) for place, mask in places.items()}
        row["below the nozzle / K"] = root_change_K(case, reference)
        row["tips / K"] = tips_change_K(case, reference)
        rows.append(row)
    return rows


def change_sheets(
    reference: Run, cases: Mapping[str, Run], *, reference_name: str, limit_K: float
) -> dict[str, Figure]:
    """Differences of the cases from the reference, up to `limit_K`, and the maps of all."""
    images = {name: Change.of(case, reference).image for name, case in cases.items()}
    title = f"T_app minus that of {reference_name}"
    all_runs = {reference_name: reference, **cases}
    return {
        "changes": changes_sheet(images, frame_of(reference.scene), title=title, limit_K=limit_K),
        "maps": maps_sheet(all_runs, title="apparent temperature"),
    }


def root_change_K(case: Run, reference: Run) -> float:
    """Difference of the mean T_app below the nozzle, of each spray's own pixels."""
    return mean_K(case, root(case)) - mean_K(reference, root(reference))


def tips_change_K(case: Run, reference: Run) -> float:
    """Difference of the mean T_app at the tips, of each spray's own pixels."""
    return mean_K(case, tips(case)) - mean_K(reference, tips(reference))


def sizes(lab: Lab) -> Results:
    """The paper's four distributions, and the first with other random numbers."""
    runs: dict[str, Run] = {}
    for row in FIG4:
        values = {**_WALLS, "spray.droplets": row.sizes.model_dump()}
        runs[named(row.sizes)] = lab.run(lab.gdi(f"sizes-{len(runs)}" if runs else "gdi", values))
    reference_name, reference = next(iter(runs.items()))
    cases = {name: run for name, run in runs.items() if name != reference_name}
    chance = lab.run(lab.gdi("sizes-seed", {**_WALLS, "spray.seed": lab.seed + 1}))
    off = sorted(Change.of(run, reference).rms() for run in cases.values())
    chance_K = Change.of(chance, reference).rms()
    liquid_mg = [run.info.spray["liquid_mass_kg"] * 1e6 for run in runs.values()]
    all_cases = {**cases, _CHANCE: chance}
    return Results(
        values={
            "least_mg": min(liquid_mg),
            "most_mg": max(liquid_mg),
            "least_K": off[0],
            "most_K": off[-1],
            "chance_K": chance_K,
            "chance_share": chance_K / off[-1],
            "mean_K": max((Change.of(run, reference).mean() for run in cases.values()), key=abs),
            "tips_K": tips_change_K(list(cases.values())[1], reference),
        },
        table=change_rows(reference, all_cases),
        sheets=change_sheets(reference, all_cases, reference_name=reference_name, limit_K=20.0),
    )


def pairs(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """Wavelength / um, n and k of four places of n-heptane's band."""
    assert isinstance(scene.spray, LagrangianSpray)
    wavelength = np.linspace(*edges_um(scene_filter(scene)), 801)
    n, k = liquid("n-heptane").index(wavelength, scene.spray.fuel_temperature_K)
    like = np.abs(k / PAPER.k - 1.0) < 0.1
    places = {
        "lowest k": int(np.argmin(k)),
        "k as the paper's, n furthest": int(np.argmax(np.where(like, np.abs(n - PAPER.n), -1.0))),
        "k twice the paper's": int(np.argmin(np.abs(k - 2 * PAPER.k))),
        "highest k": int(np.argmax(k)),
    }
    return {
        name: (float(wavelength[at]), float(n[at]), float(k[at])) for name, at in places.items()
    }


def index(lab: Lab) -> Results:
    """One spray with five refractive indices at one wavelength."""
    reference = lab.run(lab.gdi("gdi", _WALLS))
    indices = pairs(reference.scene)
    runs = {
        name: lab.run(
            lab.gdi(
                f"index-{number}",
                {**_WALLS, "optics.n": float(f"{n:.4g}"), "optics.k": float(f"{k:.3g}")},
            )
        )
        for number, (name, (_, n, k)) in enumerate(indices.items(), start=1)
    }
    shown = {f"n {n:.3f}, k {k:.3f}": runs[name] for name, (_, n, k) in indices.items()}
    nozzle, dry = root(reference), vapour_only(reference)
    below = {name: Change.of(run, reference).mean(nozzle) for name, run in runs.items()}
    rows: list[Row] = [
        {**row, "wavelength / um": um, "n": n, "k": k}
        for row, (um, n, k) in zip(change_rows(reference, runs), indices.values(), strict=True)
    ]
    extremes = max(abs(below["lowest k"]), abs(below["highest k"]))
    return Results(
        values={
            "changes": "; ".join(f"{name} {off_K:+.1f} K" for name, off_K in below.items()),
            "low_k_K": below["lowest k"],
            "high_k_K": below["highest k"],
            "n_over_k": abs(below["k as the paper's, n furthest"]) / extremes,
            "dry_K": Change.of(runs["highest k"], reference).rms(dry),
        },
        table=rows,
        sheets=change_sheets(
            reference, shown, reference_name=f"n {PAPER.n}, k {PAPER.k}", limit_K=30.0
        ),
    )


def vapour(lab: Lab) -> Results:
    """One spray with three absorption cross sections of its vapour.

    Each part of B(T_app) = sum w_j B_j / sum w_j that vapour emits grows by its absorption at most,
    and nothing else grows: that bounds the effect of ten per cent more.
    """
    reference = lab.run(lab.gdi("gdi", _WALLS))
    cases = {}
    for share in (-10, 10):
        values = {**_WALLS, "optics.vapour_m2_mol": PAPER.vapour_m2_mol * (1 + share / 100)}
        cases[f"{share:+d} %"] = lab.run(lab.gdi(f"vapour{share:+d}", values))
    mixed, dry = both_phases(reference), vapour_only(reference)
    decrease, increase = (Change.of(run, reference) for run in cases.values())
    seen_K, band = mean_K(reference, mixed), scene_filter(reference.scene)
    light = float(band_radiance(seen_K, filter_um=band))
    needed = float(band_radiance(seen_K + 10.0, filter_um=band)) / light - 1.0
    return Results(
        values={
            "seen_K": seen_K,
            "needed": 100 * needed,
            "largest_K": float(temperature_of_radiance(1.1 * light, filter_um=band)) - seen_K,
            "less_K": decrease.rms(mixed),
            "more_K": increase.rms(mixed),
            "less_mean_K": decrease.mean(mixed),
            "more_mean_K": increase.mean(mixed),
            "product_K2": increase.mean(mixed) * decrease.mean(mixed),
            "less_dry_K": decrease.rms(dry),
            "more_dry_K": increase.rms(dry),
            "dry_K": max(change.rms(dry) for change in (increase, decrease)),
        },
        table=change_rows(reference, cases),
        sheets=change_sheets(reference, cases, reference_name="5·10⁵ cm²/mol", limit_K=10.0),
    )


OTHERS = ("spalding", "dukowicz", "frolov-type")
REFERENCE = "abramzon-sirignano"
_PRESSURES_MPA = (0.15, 0.6, 0.9)  # paper, Fig. 14


def evaporation(lab: Lab) -> Results:
    """Four models in three gases; other random numbers in one of them, for comparison."""
    runs: dict[float, dict[str, Run]] = {}
    rows: list[Row] = []
    for MPa in _PRESSURES_MPA:
        gas, values = in_gas(MPa)
        name = gdi_in(MPa)
        reference = lab.run(lab.gdi(name, values))
        of_gas = runs[MPa] = {
            model: lab.run(lab.gdi(f"{name}-{model}", {**values, "spray.evaporation": model}))
            for model in OTHERS
        }
        if name == "gdi":  # the spray of the study of sizes
            of_gas[_CHANCE] = lab.run(lab.gdi("sizes-seed", {**values, "spray.seed": lab.seed + 1}))
        rows += [_model_row(model, gas, run, reference) for model, run in of_gas.items()]
        of_gas[REFERENCE] = reference
    changes = {
        (MPa, model): Change.of(run, of_gas[REFERENCE])
        for MPa, of_gas in runs.items()
        for model, run in of_gas.items()
    }
    shown = [(MPa, model) for MPa in _PRESSURES_MPA for model in OTHERS]
    gases = {MPa: f"{MPa:g}{_NO_BREAK}MPa, {GASES_K[MPa][0]:g}{_NO_BREAK}K" for MPa in runs}
    images = {
        f"{model}, {gases[MPa]}": changes[MPa, model].image
        for MPa, model in [*shown, (0.6, _CHANCE)]
    }
    frame = frame_of(runs[0.6][REFERENCE].scene)
    title = f"T_app minus that with {REFERENCE}"
    liquid_mg = [
        runs[0.6][model].info.spray["liquid_mass_kg"] * 1e6 for model in (REFERENCE, *OTHERS)
    ]

    def largest_K(MPa: float) -> float:
        return max(changes[MPa, model].rms() for model in OTHERS)

    def hot(model: str) -> tuple[Run, Run]:
        return runs[0.6][model], runs[0.6][REFERENCE]

    return Results(
        values={
            "least_mg": min(liquid_mg),
            "most_mg": max(liquid_mg),
            "cold_K": largest_K(0.15),
            "dukowicz_tips_K": tips_change_K(*hot("dukowicz")),
            "frolov_tips_K": tips_change_K(*hot("frolov-type")),
            "frolov_root_K": root_change_K(*hot("frolov-type")),
            "chance_share": changes[0.6, _CHANCE].rms() / largest_K(0.6),
            "mean_K": max((changes[case].mean() for case in shown), key=abs),
        },
        table=rows,
        sheets={"changes": changes_sheet(images, frame, title=title, limit_K=20.0)},
    )


def _model_row(model: str, gas: str, run: Run, reference: Run) -> Row:
    change = Change.of(run, reference)
    return {
        "model": model,
        "gas": gas,
        "RMS / K": change.rms(),
        "mean / K": change.mean(),
        "below the nozzle / K": root_change_K(run, reference),
        "tips / K": tips_change_K(run, reference),
        "liquid mass / mg": run.info.spray["liquid_mass_kg"] * 1e6,
        "with Abramzon-Sirignano / mg": reference.info.spray["liquid_mass_kg"] * 1e6,
    }


_OTHER_WALLS_K = (300.0, 0.0)  # a laboratory's light, and none
# A spray of 0.3 ms is small: finer gas than elsewhere, and the paper's octree also with `quick`.
_EARLY = {"spray.time_s": 0.3e-3, "spray.box.spacing_m": 0.5e-3, "domain.leaf_edge_m": PAPER_LEAF_M}


def fuel_temperature(lab: Lab) -> Results:
    """Two sprays that differ in the injector's temperature alone."""
    early = {**_WALLS, **_EARLY}
    warm = lab.run(lab.gdi("fuel-370", {**early, "spray.fuel_temperature_K": 370.0}))
    cold = lab.run(lab.gdi("fuel-330", {**early, "spray.fuel_temperature_K": 330.0}))
    # Each trace serves all walls.
    by_walls = {
        f"walls {wall_K:g} K": [
            reevaluated(run, run.scene.with_(**{"walls.temperature_K": wall_K}))
            for run in (warm, cold)
        ]
        for wall_K in _OTHER_WALLS_K
    }
    by_walls["background all round"] = [all_round(run) for run in (warm, cold)]
    z = spray_of(warm).z_m
    rows: list[dict[str, float | str]] = []
    for top in np.arange(1e-3, 25e-3, 4e-3):
        layer = (z < -top) & (z >= -top - 4e-3)
        means = [mean_K(run, layer & visible(run)) for run in (warm, cold)]
        row: dict[str, float | str] = {
            "below the nozzle": f"{1e3 * top:.0f} to {1e3 * top + 4:.0f} mm",
            "T_app, fuel 370 K / K": means[0],
            "T_app, fuel 330 K / K": means[1],
            "difference / K": means[0] - means[1],
        }
        for name, pair in by_walls.items():
            warm_K, cold_K = (mean_K(run, layer & visible(run)) for run in pair)
            row[f"difference, {name} / K"] = warm_K - cold_K
        rows.append(row)
    below = root_change_K(warm, cold)
    droplets = [droplets_K(lab.spray(run.scene), within_m=10e-3) for run in (warm, cold)]
    lowest = [row for row in rows if np.isfinite(float(row["difference / K"]))][-1]
    return Results(
        values={
            "warm_K": droplets[0],
            "cold_K": droplets[1],
            "apart_K": droplets[0] - droplets[1],
            "below_K": below,
            "below_0_K": root_change_K(*by_walls["walls 0 K"]),
            "below_300_K": root_change_K(*by_walls["walls 300 K"]),
            "fading": tips_change_K(warm, cold) / below,
            "fading_300": tips_change_K(*by_walls["walls 300 K"])
            / root_change_K(*by_walls["walls 300 K"]),
            "last_K": lowest["difference / K"],
            "last_place": lowest["below the nozzle"],
            "before": "; ".join(
                f"{root_change_K(*pair):.0f} K with {name}" for name, pair in by_walls.items()
            ),
        },
        table=rows,
        sheets=change_sheets(
            cold, {"fuel at 370 K": warm}, reference_name="fuel at 330 K", limit_K=40.0
        ),
    )
