"""Fig. 2: a methane jet, vapour alone, at three times."""

from __future__ import annotations

import numpy as np
from scipy.stats import spearmanr

from cldit.run import Run
from cldit.show.report.html import Picture
from cldit.study.lab import Lab
from cldit.study.measures import mean_K, positions_m, visible
from cldit.study.page import Page, Row
from cldit.study.pictures import Crop, maps_figure
from cldit.study.verdict import Verdict

_TIMES_MS = (0.3, 0.6, 0.9)
_AXIS_M = 2e-3
_CROP = Crop(-40.0, 40.0, -95.0, 6.0)


def _along_axis(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Depth / m and T_app / K in steps of 4 mm on the jet's axis."""
    x, z = positions_m(run)
    on_axis = visible(run) & (np.abs(x) < _AXIS_M)
    depth = np.arange(0.0, 0.12, 4e-3)
    found = [mean_K(run, on_axis & (z < -top) & (z >= -top - 4e-3)) for top in depth]
    known = np.isfinite(found)
    return depth[known] + 2e-3, np.array(found)[known]


def study(lab: Lab) -> Page:
    """The shipped scene at three times."""
    runs = {
        f"{time_ms:g} ms": lab.run(
            lab.shipped(
                "methane-jet", {"spray.time_s": time_ms * 1e-3, "name": f"methane-{time_ms:g}ms"}
            )
        )
        for time_ms in _TIMES_MS
    }
    last = runs["0.9 ms"]
    gas_K = 520.0
    depth, warm = _along_axis(last)
    rows: list[Row] = []
    for name, run in runs.items():
        along, found = _along_axis(run)
        rows.append(
            {
                "time": name,
                "largest emissivity": float(np.nanmax(run.maps.emissivity)),
                "T_app at the nozzle / K": float(found[0]) if len(found) else float("nan"),
                "T_app furthest downstream / K": float(found[-1]) if len(found) else float("nan"),
                "seen down to / mm": float(along[-1]) * 1e3 if len(along) else float("nan"),
            }
        )
    return Page(
        name="methane",
        title="Methane jet",
        figure="Fig. 2",
        text=_text(rows),
        pictures={
            "maps": Picture(
                maps_figure(runs, title="methane into 0.4 MPa, 520 K", crop=_CROP),
                "Apparent temperature (hue) and emissivity (saturation, full at the scale's end) "
                "of a methane jet, without droplets.",
            )
        },
        table=rows,
        verdicts=(
            Verdict(
                claim="The emissivity does not exceed 0.3",
                value=max(float(np.nanmax(run.maps.emissivity)) for run in runs.values()),
                high=0.3,
                why="the column of methane of this model jet is larger than the paper's, or its "
                "nozzle: the holes' sizes are assumed",
            ),
            Verdict(
                claim="The core is cold: T_app at the nozzle against the gas's 520 K (0.9 ms)",
                value=(float(warm[0]) if len(warm) else float("nan")) - gas_K,
                unit="K",
                high=-50.0,
            ),
            Verdict(
                claim="It warms downstream (rank correlation of T_app with depth, 0.9 ms)",
                value=float(spearmanr(depth, warm).statistic) if len(depth) > 2 else float("nan"),
                low=0.8,
            ),
        ),
    )


def _text(rows: list[Row]) -> str:
    last = rows[-1]
    return (
        "Methane expands from 15 MPa and mixes with hot nitrogen. Its lines leave much of the "
        "filter open, which cldit takes as a k-distribution: the emissivity reaches "
        f"{max(float(row['largest emissivity']) for row in rows):.2f} however long the column. "
        "Nothing scatters, and T_app is a temperature of the jet itself: on its axis after "
        f"{last['time']} {last['T_app at the nozzle / K']:.0f} K where it leaves the nozzle and "
        f"{last['T_app furthest downstream / K']:.0f} K {last['seen down to / mm']:.0f} mm below "
        "it. The row of Mach discs and the drift in the vessel's cross flow are not resolved."
    )
