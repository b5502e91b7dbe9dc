"""Studies of a reference and its variants: sizes, index, vapour, evaporation, fuel temperature."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cldit.arrays import Mask
from cldit.optics.liquid import liquid
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run, reevaluated
from cldit.scene.sizes import Monodisperse
from cldit.show.figures.maps import frame_of
from cldit.show.page import Figure
from cldit.show.report.optics_summary import FIG4
from cldit.study.figures import changes_sheet, maps_sheet
from cldit.study.lab import CAPTION_WALLS_K, Lab
from cldit.study.measures import Change, Phases, droplets_K, mean_K, root, spray_of, tips, visible
from cldit.study.page import Row
from cldit.study.paper.found import Found, sentences
from cldit.study.paper.maps import all_round

_WALLS = {"walls.temperature_K": CAPTION_WALLS_K}
_CHANCE = "other random numbers"
_NO_BREAK = "\N{NO-BREAK SPACE}"  # of a value and its unit


def change_rows(reference: Run, cases: Mapping[str, Run]) -> list[Row]:
    """Rows of T_app of each case minus that of the reference, over all of it and by place."""
    phases = Phases.of(reference)
    places: dict[str, Mask | None] = {
        "all": None,
        "both phases": phases.mixed,
        "vapour only": phases.vapour_only,
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


def change_figures(
    study: str, reference: Run, cases: Mapping[str, Run], *, reference_name: str, limit_K: float
) -> dict[str, Figure]:
    """Differences of the cases from the reference, up to `limit_K`, and the maps of all."""
    about = sentences()[study]["about"]
    images = {name: Change.of(case, reference).image for name, case in cases.items()}
    title = f"T_app minus that of {reference_name}"
    frame, all_runs = frame_of(reference.scene), {reference_name: reference, **cases}
    return {
        "changes": Figure.of(
            changes_sheet(images, frame, title=title, limit_K=limit_K),
            f"Difference of apparent temperature to {reference_name}, {about}.",
        ),
        "maps": Figure.of(
            maps_sheet(all_runs, title="apparent temperature"), f"The maps themselves, {about}."
        ),
    }


def root_change_K(case: Run, reference: Run) -> float:
    """Difference of the mean T_app below the nozzle, of each spray's own pixels."""
    return mean_K(case, root(case)) - mean_K(reference, root(reference))


def tips_change_K(case: Run, reference: Run) -> float:
    """Difference of the mean T_app at the tips, of each spray's own pixels."""
    return mean_K(case, tips(case)) - mean_K(reference, tips(reference))


def sizes(lab: Lab) -> Found:
    """The paper's four distributions, and the first with other random numbers."""
    runs: dict[str, Run] = {}
    for row in FIG4:
        values = row.sizes.model_dump()
        if isinstance(row.sizes, Monodisperse):
            name = f"all {row.sizes.diameter_um:g} µm"
        else:
            name = f"m {row.sizes.m_um:g} µm, n {row.sizes.n:.3g}, p {row.sizes.p:g}"
        title = "gdi" if not runs else f"sizes-{len(runs)}"
        runs[name] = lab.run(lab.gdi(title, {**_WALLS, "spray.droplets": values}))
    named, reference = next(iter(runs.items()))
    cases = {name: run for name, run in runs.items() if name != named}
    chance = lab.run(lab.gdi("sizes-seed", {**_WALLS, "spray.seed": lab.seed + 1}))
    off = sorted(Change.of(run, reference).rms() for run in cases.values())
    chance_K = Change.of(chance, reference).rms()
    liquid_mg = [run.info.spray["liquid_mass_kg"] * 1e6 for run in runs.values()]
    all_cases = {**cases, _CHANCE: chance}
    return Found(
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
        figures=change_figures("sizes", reference, all_cases, reference_name=named, limit_K=20.0),
    )


_N, _K = 1.338, 0.0341  # paper
_FILTER_UM = (3.3, 3.5)
_LIQUID_K = 370.0


def pairs() -> dict[str, tuple[float, float, float]]:
    """Wavelength / um, n and k of four places of n-heptane's band."""
    wavelength = np.linspace(*_FILTER_UM, 801)
    n, k = liquid("n-heptane").index(wavelength, _LIQUID_K)
    like = np.abs(k / _K - 1.0) < 0.1
    places = {
        "lowest k": int(np.argmin(k)),
        "k as the paper's, n furthest": int(np.argmax(np.where(like, np.abs(n - _N), -1.0))),
        "k twice the paper's": int(np.argmin(np.abs(k - 2 * _K))),
        "highest k": int(np.argmax(k)),
    }
    return {
        name: (float(wavelength[at]), float(n[at]), float(k[at])) for name, at in places.items()
    }


def index(lab: Lab) -> Found:
    """One spray with five refractive indices at one wavelength."""
    reference = lab.run(lab.gdi("gdi", _WALLS))
    indices = pairs()
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
    nozzle, dry = root(reference), Phases.of(reference).vapour_only
    below = {name: Change.of(run, reference).mean(nozzle) for name, run in runs.items()}
    rows: list[Row] = [
        {**row, "wavelength / um": um, "n": n, "k": k}
        for row, (um, n, k) in zip(change_rows(reference, runs), indices.values(), strict=True)
    ]
    extremes = max(abs(below["lowest k"]), abs(below["highest k"]))
    return Found(
        values={
            "changes": "; ".join(f"{name} {off_K:+.1f} K" for name, off_K in below.items()),
            "low_k_K": below["lowest k"],
            "high_k_K": below["highest k"],
            "n_over_k": abs(below["k as the paper's, n furthest"]) / extremes,
            "dry_K": Change.of(runs["highest k"], reference).rms(dry),
        },
        table=rows,
        figures=change_figures(
            "index", reference, shown, reference_name=f"n {_N}, k {_K}", limit_K=20.0
        ),
    )


_PAPER_m2_mol = 50.0  # 5e5 cm2/mol


def vapour(lab: Lab) -> Found:
    """One spray with three absorption cross sections of its vapour.

    Each part of B(T_app) = sum w_j B_j / sum w_j that vapour emits grows by its absorption at most,
    and nothing else grows: that bounds the effect of ten per cent more.
    """
    reference = lab.run(lab.gdi("gdi", _WALLS))
    cases = {}
    for share in (-10, 10):
        values = {**_WALLS, "optics.vapour_m2_mol": _PAPER_m2_mol * (1 + share / 100)}
        cases[f"{share:+d} %"] = lab.run(lab.gdi(f"vapour{share:+d}", values))
    phases = Phases.of(reference)
    decrease, increase = (Change.of(run, reference) for run in cases.values())
    seen_K, band = mean_K(reference, phases.mixed), scene_filter(reference.scene)
    light = float(band_radiance(seen_K, filter_um=band))
    needed = float(band_radiance(seen_K + 10.0, filter_um=band)) / light - 1.0
    return Found(
        values={
            "seen_K": seen_K,
            "needed": 100 * needed,
            "largest_K": float(temperature_of_radiance(1.1 * light, filter_um=band)) - seen_K,
            "less_K": decrease.rms(phases.mixed),
            "more_K": increase.rms(phases.mixed),
            "less_mean_K": decrease.mean(phases.mixed),
            "more_mean_K": increase.mean(phases.mixed),
            "product_K2": increase.mean(phases.mixed) * decrease.mean(phases.mixed),
            "less_dry_K": decrease.rms(phases.vapour_only),
            "more_dry_K": increase.rms(phases.vapour_only),
            "dry_K": max(change.rms(phases.vapour_only) for change in (increase, decrease)),
        },
        table=change_rows(reference, cases),
        figures=change_figures(
            "vapour", reference, cases, reference_name="5·10⁵ cm²/mol", limit_K=10.0
        ),
    )


OTHERS = ("spalding", "dukowicz", "frolov-type")
REFERENCE = "abramzon-sirignano"
# MPa, K of the gas, K of the walls: those of the gas where it is cold, 115 K below it elsewhere
_GASES = ((0.15, 300.0, 300.0), (0.6, 570.0, 455.0), (0.9, 620.0, 505.0))


def evaporation(lab: Lab) -> Found:
    """Four models in three gases; other random numbers in one of them, for comparison."""
    changes: dict[tuple[float, str], Change] = {}
    pairs: dict[tuple[float, str], tuple[Run, Run]] = {}
    rows: list[Row] = []
    by_gas: list[str] = []
    for pressure_MPa, gas_K, walls_K in _GASES:
        values = {
            "spray.ambient": {"pressure_Pa": pressure_MPa * 1e6, "temperature_K": gas_K},
            "walls.temperature_K": walls_K,
        }
        gas = f"{pressure_MPa:g} MPa, {gas_K:g} K"
        name = "gdi" if pressure_MPa == 0.6 else f"gdi-{pressure_MPa:g}MPa-{gas_K:g}K"
        reference = lab.run(lab.gdi(name, values))
        runs = {
            model: lab.run(lab.gdi(f"{name}-{model}", {**values, "spray.evaporation": model}))
            for model in OTHERS
        }
        if pressure_MPa == 0.6:  # the spray of the study of sizes
            runs[_CHANCE] = lab.run(lab.gdi("sizes-seed", {**values, "spray.seed": lab.seed + 1}))
        for model, run in runs.items():
            change = changes[pressure_MPa, model] = Change.of(run, reference)
            pairs[pressure_MPa, model] = run, reference
            liquid_kg = run.info.spray["liquid_mass_kg"], reference.info.spray["liquid_mass_kg"]
            rows.append(
                {
                    "model": model,
                    "gas": gas,
                    "RMS / K": change.rms(),
                    "mean / K": change.mean(),
                    "below the nozzle / K": root_change_K(run, reference),
                    "tips / K": tips_change_K(run, reference),
                    "liquid mass / mg": liquid_kg[0] * 1e6,
                    "with Abramzon-Sirignano / mg": liquid_kg[1] * 1e6,
                }
            )
        masses = [run.info.spray["liquid_mass_kg"] * 1e6
                  for run in (reference, *(runs[model] for model in OTHERS))]  # fmt: skip
        means = [changes[pressure_MPa, model].mean() for model in OTHERS]
        by_gas.append(
            f"{min(masses):.2f} to {max(masses):.2f} mg of liquid and mean differences of T_app of "
            f"{min(means):+.1f} to {max(means):+.1f} K at {gas}"
        )
    shown = [(p, t, model) for p, t, _ in _GASES for model in OTHERS]
    named = {
        f"{model}, {p:g}{_NO_BREAK}MPa, {t:g}{_NO_BREAK}K": changes[p, model].image
        for p, t, model in [*shown, (0.6, 570.0, _CHANCE)]
    }
    frame = frame_of(reference.scene)
    title = f"T_app minus that with {REFERENCE}"
    hot_K = max(changes[0.6, model].rms() for model in OTHERS)
    return Found(
        values={
            "by_gas": "; ".join(by_gas),
            "cold_K": max(changes[0.15, model].rms() for model in OTHERS),
            "dukowicz_tips_K": tips_change_K(*pairs[0.6, "dukowicz"]),
            "frolov_tips_K": tips_change_K(*pairs[0.6, "frolov-type"]),
            "frolov_root_K": root_change_K(*pairs[0.6, "frolov-type"]),
            "chance_share": changes[0.6, _CHANCE].rms() / hot_K,
            "mean_K": max(
                (change.mean() for (_, model), change in changes.items() if model != _CHANCE),
                key=abs,
            ),
        },
        table=rows,
        sheets={"changes": changes_sheet(named, frame, title=title, limit_K=20.0)},
    )


_OTHER_WALLS_K = (300.0, 0.0)


def fuel_temperature(lab: Lab) -> Found:
    """Two sprays that differ in the injector's temperature alone."""
    early = {**_WALLS, "spray.time_s": 0.3e-3}
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
    return Found(
        values={
            "warm_K": droplets[0],
            "cold_K": droplets[1],
            "apart_K": droplets[0] - droplets[1],
            "below_K": below,
            "below_0_K": root_change_K(*by_walls["walls 0 K"]),
            "below_300_K": root_change_K(*by_walls["walls 300 K"]),
            "fading": tips_change_K(warm, cold) / below,
            "last_K": lowest["difference / K"],
            "last_place": lowest["below the nozzle"],
            "before": "; ".join(
                f"{root_change_K(*pair):.0f} K with {name}" for name, pair in by_walls.items()
            ),
        },
        table=rows,
        figures=change_figures(
            "fuel-temperature", cold, {"370 K": warm}, reference_name="330 K", limit_K=40.0
        ),
    )
