"""Studies of maps: methane, conditions, scattering order, walls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from cldit.arrays import Mask
from cldit.constants import AVOGADRO_PER_MOL
from cldit.io.files import make_folder, read_text, write_text
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.vapour import vapour_band
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.run import Run, reevaluated
from cldit.scene.spray import LagrangianSpray
from cldit.show.figures.curves import profile_figure
from cldit.show.figures.maps import frame_of
from cldit.show.figures.panels import ImageFrame
from cldit.study.figures import changes_sheet, maps_sheet
from cldit.study.lab import GASES_K, Lab, OPEN_s, gdi_in, in_gas, open_for
from cldit.study.measures import (
    Change,
    droplets_K,
    mean_emissivity,
    mean_K,
    rim,
    root,
    spray_of,
    tips,
    vapour_only,
    visible,
)
from cldit.study.page import Row
from cldit.study.paper.results import Results

_NAN = float("nan")
_JET_TIMES_MS = (0.5, 0.7, 0.9)  # after the injector's energisation; the paper names 0.9
_OPENING_MS = 0.3  # assumed, from energisation to the first fuel, as of solenoid injectors
_FAR_M = 0.08  # "more than 80 mm downstream from the injector the emissivity is very low"


def methane(lab: Lab) -> Results:
    """The shipped scene at three times, and a vertical cut through the last map."""
    runs: dict[str, Run] = {}
    rows: list[dict[str, float | str]] = []
    for time_ms in _JET_TIMES_MS:
        seconds = (time_ms - _OPENING_MS) * 1e-3
        values = {"spray.time_s": seconds, "name": f"methane-{time_ms:g}ms"}
        run = runs[f"{time_ms:g} ms"] = lab.run(lab.shipped("methane-jet", values))
        cut = run.profile(angle_deg=0.0)
        seen = (cut.emissivity > VISIBLE_EMISSIVITY) & np.isfinite(cut.apparent_temperature_K)
        warm, depth = cut.apparent_temperature_K[seen], cut.distance_m[seen]
        rows.append(
            {
                "time": f"{time_ms:g} ms",
                "largest emissivity": float(np.nanmax(run.maps.emissivity)),
                "T_app at the nozzle / K": float(warm[0]) if len(warm) else _NAN,
                "T_app furthest downstream / K": float(warm[-1]) if len(warm) else _NAN,
                "seen down to / mm": float(depth[-1]) * 1e3 if len(depth) else _NAN,
            }
        )
    latest = rows[-1]
    assert isinstance(run.scene.spray, LagrangianSpray)
    gas_K = run.scene.spray.ambient.temperature_K
    emissivity = run.maps.emissivity[spray_of(run).z_m < -_FAR_M]
    largest = max(float(row["largest emissivity"]) for row in rows)
    return Results(
        values={
            "largest": largest,
            "beyond_80_mm": float(np.nanmax(emissivity)) if emissivity.size else _NAN,
            "opening_ms": _OPENING_MS,
            "last": latest["time"],
            "nozzle_K": latest["T_app at the nozzle / K"],
            "far_K": latest["T_app furthest downstream / K"],
            "far_mm": latest["seen down to / mm"],
            "core_K": float(latest["T_app at the nozzle / K"]) - gas_K,
            "warming": float(spearmanr(depth, warm).statistic) if len(depth) > 2 else _NAN,
        },
        table=rows,
        sheets={
            "maps": maps_sheet(runs, title="methane into 0.4 MPa, 520 K"),
            "cut": profile_figure(cut, title=f"vertical cut below the nozzle, {latest['time']}"),
        },
    )


_COLD = {
    "spray.time_s": 0.3e-3,
    **in_gas(0.15)[1],
    "background.temperatures_K": [320.0, 345.0, 370.0, 395.0, 420.0],
    "camera.sensor.integration_time_s": 25e-6,
    "plan": {"shots": 19, "references": 19},
    "optics.preset": "spectral",
    "optics.compare_paper": False,
}
_OPEN_UM = (2.0, 5.0)


def open_vapour(folder: Path) -> Path:
    """A table of n-heptane's vapour from 2 to 5 um: the shipped C-H band, and nothing beside it.

    Its overtones near 2.3 um, some hundredths of the band's area, are omitted.
    """
    band = vapour_band("n-heptane")
    low, high = band.wavenumber_per_cm
    lowest, highest = (1e4 / wavelength_um for wavelength_um in _OPEN_UM[::-1])
    number = np.arange(lowest, highest + 0.1, 5.0)
    inside = (number >= low) & (number <= high)
    table = []
    for row_K in (200.0, *(float(row) for row in band.rows_K)):
        values = np.zeros(len(number))
        values[inside] = band.absorption_m2_mol(number[inside], row_K) * 1e4 / AVOGADRO_PER_MOL
        head = f"{'n-heptane':>20}{number[0]:10.3f}{number[-1]:10.3f}{len(number):7d}{row_K:7.1f}"
        cells = [f"{value:10.3E}" for value in values]
        rows = ["".join(cells[at : at + 10]) for at in range(0, len(cells), 10)]
        table += [f"{head}{760.0:6.1f}{values.max():10.3E}".ljust(100), *rows]
    path = folder / "tables" / "n-heptane-2-5um.xsc"
    make_folder(path.parent)
    content = "\n".join(table) + "\n"
    if not path.is_file() or read_text(path) != content:
        write_text(path, content)
    return path


def _condition_row(case: str, run: Run) -> Row:
    errors = run.maps.apparent_temperature_standard_error_K[visible(run)]
    return {
        "case": case,
        "walls / K": run.scene.walls.temperature_K,
        "reach / mm": spray_of(run).reach_m * 1e3,
        "T_app below the nozzle / K": mean_K(run, root(run)),
        "T_app at the tips / K": mean_K(run, tips(run)),
        "largest emissivity": float(np.nanmax(run.maps.emissivity)),
        "median standard error / K": float(np.nanmedian(errors)) if errors.size else _NAN,
    }


def conditions(lab: Lab) -> Results:
    """Five conditions at one wavelength; the coldest through the filter and without it."""
    at: dict[float, Run] = {}
    runs: dict[str, Run] = {}
    for MPa in GASES_K:
        gas, values = in_gas(MPa)
        at[MPa] = runs[gas] = lab.run(lab.gdi(gdi_in(MPa), values))
    open_values = {
        **_COLD,
        "optics.filter_um": list(_OPEN_UM),
        "optics.vapour": str(open_vapour(lab.runs.cache)),
    }
    filtered = lab.run(lab.gdi("cold-filter", _COLD))
    unfiltered = lab.run(lab.gdi("cold-open", open_values))
    wide = {"filter 3.3 to 3.5 µm": filtered, "no filter, 2 to 5 µm": unfiltered}
    rows = [_condition_row(name, run) for name, run in {**runs, **wide}.items()]
    contrast = [mean_K(run, root(run)) - mean_K(run, tips(run)) for run in wide.values()]
    deviations_K = [abs(mean_K(run, visible(run)) - 300.0) for run in wide.values()]
    noise = [float(row["median standard error / K"]) for row in rows[-2:]]
    gas_K, halo = GASES_K[0.6][0], rim(at[0.6])
    seen_K = at[0.6].maps.apparent_temperature_K[halo]
    return Results(
        values={
            "filter_K": deviations_K[0],
            "open_K": deviations_K[1],
            "filter_noise_K": noise[0],
            "open_noise_K": noise[1],
            "noise_ratio": noise[0] / noise[1],
            "nearer_K": deviations_K[0] - deviations_K[1],
            "contrast_change_K": contrast[0] - contrast[1],
            "reach_ratio": spray_of(at[0.9]).reach_m / spray_of(at[0.15]).reach_m,
            "largest_step": max(
                spray_of(at[higher_MPa]).reach_m / spray_of(at[lower_MPa]).reach_m
                for lower_MPa, higher_MPa in pairwise(at)
            ),
            "rim_change_K": mean_K(at[0.6], halo) - gas_K,
            "dry_change_K": mean_K(at[0.6], vapour_only(at[0.6])) - gas_K,
            "near": 100.0 * float(np.mean(np.abs(seen_K - gas_K) < 20.0)) if seen_K.size else _NAN,
        },
        table=rows,
        sheets={
            "maps": maps_sheet(runs, title="DIT over pressure and temperature", columns=2),
            "filter": maps_sheet(wide, title="0.15 MPa, 300 K, 0.3 ms"),
        },
    )


_TIMES_MS = (0.3, 0.95, 1.5)  # the paper's times: Figs. 6, 9 and 5
_ORDERS = (0, 1, 2, 3)  # paper, Fig. 9: differences from the third
# The paper does not give the duration: open to the end, and the ECN's Spray G, closed at 0.78 ms.
_DURATIONS_MS = (1e3 * OPEN_s, 0.78)
# Droplets that scatter straight ahead only absorb.
_AHEAD = {"transport.phase": 0.999}


def _beyond(run: Run) -> Mask:
    """The visible spray below its root."""
    spray = spray_of(run)
    return np.asarray(spray.visible & (spray.z_m < spray.z_m[spray.root].min(initial=0.0)))


def _within_1_K(change: Change) -> float:
    """Percentage of the pixels of `change` that change by 1 K at most."""
    return 100 * float(np.mean(np.abs(change.within()) <= 1.0))


def order(lab: Lab) -> Results:
    """One spray at each time, and a shorter injection; traces of each order and of all orders."""
    cases = [(_DURATIONS_MS[0], time_ms) for time_ms in _TIMES_MS] + [(_DURATIONS_MS[1], 0.95)]
    unlimited: dict[tuple[float, float], Run] = {}
    runs: dict[tuple[float, float, int], Run] = {}
    none: dict[float, Run] = {}
    for case in cases:
        open_ms, time_ms = case
        values: dict[str, Any] = {"spray.time_s": time_ms * 1e-3, **open_for(open_ms * 1e-3)}
        # The spray of 0.95 ms is that of the other studies, and named after it.
        name = "gdi" if time_ms == 0.95 else f"gdi-{time_ms:g}ms"
        name += "" if open_ms == _DURATIONS_MS[0] else f"-open-{open_ms:g}ms"
        unlimited[case] = lab.run(lab.gdi(f"{name}-all-orders", values))
        for number in _ORDERS:
            scene = lab.gdi(f"{name}-order-{number}", {**values, "transport.order": number})
            runs[*case, number] = lab.run(scene)
        if time_ms == 0.95:
            none[open_ms] = lab.run(lab.gdi(f"{name}-absorb-only", {**values, **_AHEAD}))
    changes = {key: Change.of(run, unlimited[key[:2]]) for key, run in runs.items()}
    by_duration: dict[str, float | str] = {}
    for key, open_ms in zip(("", "short_"), _DURATIONS_MS, strict=True):
        case = open_ms, 0.95
        of_case = {number: runs[*case, number] for number in _ORDERS}
        readings = _readings(of_case, none[open_ms], unlimited[case])
        by_duration |= {f"{key}{name}": value for name, value in readings.items()}
    case = _DURATIONS_MS[0], 0.95
    nozzle, downstream = root(unlimited[case]), _beyond(unlimited[case])
    zero = changes[*case, 0]
    return Results(
        values={
            **by_duration,
            "orders": ", ".join(str(number) for number in _ORDERS),
            "left": ", ".join(f"{changes[*case, number].rms():.2g}" for number in _ORDERS),
            "early_ratio": changes[_DURATIONS_MS[0], 0.3, 0].rms() / zero.rms(),
            "near_ratio": zero.rms(nozzle) / zero.rms(),
            "none_K": zero.mean(),
            "none_near_K": zero.mean(nozzle),
            "none_away_K": zero.mean(downstream),
        },
        table=[_order_row(key, change, unlimited[key[:2]]) for key, change in changes.items()],
        sheets=_order_sheets(
            changes,
            {ms: Change.of(run, unlimited[ms, 0.95]) for ms, run in none.items()},
            frame_of(unlimited[case].scene),
        ),
    )


def _order_row(key: tuple[float, float, int], change: Change, all_orders: Run) -> Row:
    return {
        "open for / ms": key[0],
        "time / ms": key[1],
        "order": f"{key[2]}",
        "RMS / K": change.rms(),
        "99th percentile / K": change.largest(),
        "mean / K": change.mean(),
        "RMS below the nozzle / K": change.rms(root(all_orders)),
        "RMS beyond / K": change.rms(_beyond(all_orders)),
        "within 1 K / %": _within_1_K(change),
    }


def _readings(by_order: Mapping[int, Run], none: Run, all_orders: Run) -> dict[str, float | str]:
    """Changes of T_app by the paper's steps between orders."""
    nozzle, downstream = root(all_orders), _beyond(all_orders)
    third = Change.of(by_order[1], by_order[3])
    values: dict[str, float | str] = {}
    single, only = Change.of(by_order[0], by_order[1]), Change.of(none, by_order[1])
    for word, change in (("first", single), ("third", third), ("only", only)):
        values[f"{word}_rms_K"] = change.rms()
        values[f"{word}_largest_K"] = change.largest()
        values[f"{word}_why"] = (
            f"it is {change.rms(nozzle):.3g} K 1 to 8 mm below the nozzle, and "
            f"{change.rms(downstream):.2g} K beyond (RMS)"
        )
    return values | {"third_within": _within_1_K(third), "third_beyond_K": third.rms(downstream)}


def _order_sheets(
    changes: Mapping[tuple[float, float, int], Change],
    none: Mapping[float, Change],
    frame: ImageFrame,
) -> dict[str, Figure]:
    long_ms, short_ms = _DURATIONS_MS
    shown = {
        f"order {number}, {time_ms:g} ms": changes[long_ms, time_ms, number].image
        for number in _ORDERS[:3]
        for time_ms in _TIMES_MS
    }
    short = {
        f"order {number}, open for {short_ms:g} ms": changes[short_ms, 0.95, number].image
        for number in _ORDERS[:2]
    }
    short |= {f"no scattering, open for {ms:g} ms": none[ms].image for ms in _DURATIONS_MS}
    titles = (
        "T_app with few orders minus T_app with all",
        "0.95 ms: T_app minus that with all orders",
    )
    return {
        "changes": changes_sheet(shown, frame, title=titles[0], limit_K=10.0),
        "readings": changes_sheet(short, frame, title=titles[1], limit_K=10.0, columns=2),
    }


# None, the laboratory's, the droplets' wet bulb (paper), 115 K below the gas (paper), the gas's.
_WALLS_K = (0.0, 300.0, 380.0, 455.0, 570.0)


def all_round(run: Run) -> Run:
    """The same trace with the background on all of the enclosure: walls count as background."""

    def joined(weights: Weights) -> Weights:
        background = sum(weights.patches.values(), weights.background + weights.wall)
        return replace(weights, background=background, wall=np.zeros_like(background), patches={})

    parts = tuple(joined(weights) for weights in run.spectral)
    return reevaluated(replace(run, spectral=parts, reference=joined(run.reference)), run.scene)


def walls(lab: Lab) -> Results:
    """One trace with every wall temperature."""
    run = lab.run(lab.gdi("gdi"))
    cases = {"all round": all_round(run)}
    for wall_K in _WALLS_K:
        scene = run.scene.with_(**{"walls.temperature_K": wall_K})
        cases[f"walls {wall_K:g} K"] = reevaluated(run, scene)
    droplets = droplets_K(lab.spray(run.scene), within_m=10e-3)
    dry = vapour_only(run)
    below = {name: mean_K(case, root(case)) for name, case in cases.items()}
    vapour_K = {name: mean_K(case, dry) for name, case in cases.items()}
    emissivity = {name: mean_emissivity(case, root(case)) for name, case in cases.items()}
    round_K, cold_K, hot_K = (below[name] for name in ("all round", "walls 0 K", "walls 570 K"))
    band = run.quadrature.filter_um
    half = float(np.mean(band_radiance([400.0, 300.0], filter_um=band)))
    seen_K = float(temperature_of_radiance(half, filter_um=band))
    return Results(
        values={
            "emissivity_round": emissivity["all round"],
            "emissivity_cold": emissivity["walls 0 K"],
            "below_round_K": round_K,
            "below_cold_K": cold_K,
            "below_hot_K": hot_K,
            "around_cold_K": vapour_K["walls 0 K"],
            "around_hot_K": vapour_K["walls 570 K"],
            "around_change_K": abs(vapour_K["walls 570 K"] - vapour_K["walls 0 K"]),
            "nearest_K": abs(min((below_K - droplets for below_K in below.values()), key=abs)),
            "cold_off_K": abs(cold_K - droplets),
            "cold_change_K": cold_K - round_K,
            "hot_change_K": hot_K - round_K,
            "one_droplet": 100.0 * (1.0 - seen_K / 400.0),
        },
        table=[
            {
                "case": name,
                "T_app below the nozzle / K": below[name],
                "emissivity below the nozzle": emissivity[name],
                "T_app of vapour alone / K": vapour_K[name],
                "droplets below the nozzle / K": droplets,
            }
            for name in cases
        ],
        sheets={"maps": maps_sheet(cases, title="walls of different temperature, one trace")},
    )
