"""Fig. 15: fuel of 370 K against fuel of 330 K, 0.3 ms after the start."""

from __future__ import annotations

import numpy as np

from cldit.run import Run, reevaluated
from cldit.study.compare import change_pictures, root_change_K, tips_change_K
from cldit.study.grid import changed
from cldit.study.lab import CAPTION_WALLS_K, Lab
from cldit.study.measures import droplets_K, mean_K, positions_m, visible
from cldit.study.page import Page, Row
from cldit.study.paper.walls import all_round
from cldit.study.pictures import Crop
from cldit.study.verdict import Verdict

_OTHER_WALLS_K = (300.0, 0.0)
_CROP = Crop(-25.0, 25.0, -38.0, 5.0)


def study(lab: Lab) -> Page:
    """Two sprays that differ in the injector's temperature alone."""
    early = {"spray.time_s": 0.3e-3, "walls.temperature_K": CAPTION_WALLS_K}
    warm = lab.run(lab.gdi("fuel-370", {**early, "spray.fuel_temperature_K": 370.0}))
    cold = lab.run(lab.gdi("fuel-330", {**early, "spray.fuel_temperature_K": 330.0}))
    # Each trace serves all walls; those that follow the background are its light, not theirs.
    others = {
        f"walls {wall_K:g} K": [
            reevaluated(run, changed(run.scene, {"walls.temperature_K": wall_K}))
            for run in (warm, cold)
        ]
        for wall_K in _OTHER_WALLS_K
    }
    others["background all round"] = [all_round(run) for run in (warm, cold)]
    _, z = positions_m(warm)
    rows: list[Row] = []
    for top in np.arange(1e-3, 25e-3, 4e-3):
        layer = (z < -top) & (z >= -top - 4e-3)
        means = mean_K(warm, layer & visible(warm)), mean_K(cold, layer & visible(cold))
        row: dict[str, float | str] = {
            "below the nozzle": f"{1e3 * top:.0f} to {1e3 * top + 4:.0f} mm",
            "T_app, fuel 370 K / K": means[0],
            "T_app, fuel 330 K / K": means[1],
            "difference / K": means[0] - means[1],
        }
        for name, pair in others.items():
            first, second = (mean_K(run, layer & visible(run)) for run in pair)
            row[f"difference, {name} / K"] = first - second
        rows.append(row)
    below = root_change_K(warm, cold)
    droplets = [droplets_K(lab.spray(run.scene), within_m=10e-3) for run in (warm, cold)]
    return Page(
        name="fuel-temperature",
        title="Fuel temperature",
        figure="Fig. 15",
        text=_text(rows, droplets, below, others),
        pictures=change_pictures(
            cold,
            {"370 K": warm},
            reference_name="330 K",
            about="0.3 ms, 0.6 MPa, 570 K, walls 450 K",
            limit_K=40.0,
            crop=_CROP,
        ),
        table=rows,
        verdicts=(
            Verdict(
                claim="The difference is about 30 K below the nozzle",
                value=below,
                unit="K",
                low=20.0,
                high=40.0,
                why=f"the droplets themselves, {droplets[0]:.0f} and {droplets[1]:.0f} K in the "
                "first 10 mm, differ by "
                f"{droplets[0] - droplets[1]:.0f} K; the rest of what is seen is vapour and "
                "scattered light of the walls, which is alike in both: before walls of 0 K the "
                f"same sprays differ by {root_change_K(*others['walls 0 K']):.0f} K",
            ),
            Verdict(
                claim="The same before walls of 300 K: the paper's chamber was effectively colder "
                "than its walls, since three windows let in the light of a laboratory of 295 K",
                value=root_change_K(*others["walls 300 K"]),
                unit="K",
                low=20.0,
                high=40.0,
                why="droplets near the nozzle are seen with the vapour around them",
            ),
            Verdict(
                claim="It fades downstream (mean at the tips over mean below the nozzle)",
                value=tips_change_K(warm, cold) / below,
                high=0.5,
            ),
        ),
    )


def _text(
    rows: list[Row], droplets: list[float], below: float, others: dict[str, list[Run]]
) -> str:
    before = "; ".join(f"{root_change_K(*pair):.0f} K with {name}" for name, pair in others.items())
    known = [row for row in rows if np.isfinite(float(row["difference / K"]))]
    return (
        "The injector at 370 K against 330 K, all else equal. Droplets in the first 10 mm are "
        f"{droplets[0]:.0f} and {droplets[1]:.0f} K warm; T_app below the nozzle differs by "
        f"{below:.0f} K, since part of the light is scattered from walls that do not change, and "
        f"by {float(known[-1]['difference / K']):.1f} K {known[-1]['below the nozzle']} below it: "
        "fuel warms to the temperature at which its evaporation takes all the heat that the gas "
        "brings, the same in both. The same two traces before other walls differ below the nozzle "
        f"by {before}."
    )
