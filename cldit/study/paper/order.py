"""Fig. 9: T_app with 0, 1, 2, .. scattering orders against all of them, at three times."""

from __future__ import annotations

from typing import Any

import numpy as np

from cldit.run import Run
from cldit.show.report.html import Picture
from cldit.study.lab import Lab
from cldit.study.measures import Change, Mask, positions_m, root, visible
from cldit.study.page import Page, Row
from cldit.study.pictures import Crop, changes_figure, frame_of
from cldit.study.verdict import Verdict

_TIMES_MS = (0.3, 0.95, 1.5)
_ORDERS = (0, 1, 2, 3, 5)
_CROP = Crop(-40.0, 40.0, -60.0, 6.0)
_SHOWN_K = 10.0


def study(lab: Lab) -> Page:
    """One spray a time; one trace an order."""
    every: dict[float, Run] = {}
    runs: dict[tuple[float, int], Run] = {}
    for time_ms in _TIMES_MS:
        values: dict[str, Any] = {"spray.time_s": time_ms * 1e-3}
        # The spray of 0.95 ms is that of the other studies, and named after it.
        name = "gdi" if time_ms == 0.95 else f"gdi-{time_ms:g}ms"
        every[time_ms] = lab.run(lab.gdi(f"{name}-all-orders", values))
        for order in _ORDERS:
            scene = lab.gdi(f"{name}-order-{order}", {**values, "transport.order": order})
            runs[time_ms, order] = lab.run(scene)
    changes = {key: Change.of(run, every[key[0]]) for key, run in runs.items()}
    shown = {
        f"order {order}, {time_ms:g} ms": changes[time_ms, order].image
        for order in _ORDERS[:3]
        for time_ms in _TIMES_MS
    }
    rows: list[Row] = [
        {
            "time / ms": time_ms,
            "order": f"{order}",
            "RMS / K": change.rms(),
            "99th percentile / K": change.largest(),
            "mean / K": change.mean(),
            "RMS below the nozzle / K": change.rms(root(every[time_ms])),
            "RMS beyond 8 mm / K": change.rms(beyond(every[time_ms])),
            "within 1 K / %": 100 * within(change, 1.0),
        }
        for (time_ms, order), change in changes.items()
    ]
    first = Change.of(runs[0.95, 0], runs[0.95, 1])
    third = Change.of(runs[0.95, 1], runs[0.95, 3])
    near, away = root(every[0.95]), beyond(every[0.95])
    none = {time_ms: changes[time_ms, 0] for time_ms in _TIMES_MS}
    return Page(
        name="order",
        title="Scattering order",
        figure="Fig. 9",
        text=_text(rows),
        pictures={
            "changes": Picture(
                changes_figure(
                    shown,
                    frame_of(every[0.95]),
                    title="T_app with few orders minus T_app with all",
                    limit_K=_SHOWN_K,
                    crop=_CROP,
                ),
                "Up to an order, beyond which the walls are seen, minus all orders; 0.6 MPa, "
                "570 K, walls 455 K.",
            )
        },
        table=rows,
        verdicts=(
            Verdict(
                claim="0.95 ms: no scattering against single scattering below 5 K (RMS)",
                value=first.rms(),
                unit="K",
                high=5.0,
            ),
            Verdict(
                claim="The same in all pixels (99th percentile)",
                value=first.largest(),
                unit="K",
                high=5.0,
                why=_why(first, every[0.95]),
            ),
            Verdict(
                claim="0.95 ms: single against triple scattering below 1 K (RMS)",
                value=third.rms(),
                unit="K",
                high=1.0,
                why=_why(third, every[0.95]),
            ),
            Verdict(
                claim="The same in all pixels (99th percentile)",
                value=third.largest(),
                unit="K",
                high=1.0,
                why=_why(third, every[0.95]),
            ),
            Verdict(
                claim="Single against triple scattering below 1 K over most of the spray (part of "
                "its pixels)",
                value=100 * within(third, 1.0),
                unit="%",
                low=80.0,
            ),
            Verdict(
                claim="and beyond the first 8 mm below the nozzle (RMS)",
                value=third.rms(away),
                unit="K",
                high=1.0,
                why="single parcels of the plumes are still dense there",
            ),
            Verdict(
                claim="Orders matter most at early times (RMS of order 0 at 0.3 ms over 0.95 ms)",
                value=none[0.3].rms() / none[0.95].rms(),
                low=1.0,
            ),
            Verdict(
                claim="and close to the injector (RMS of order 0 there over that of all, 0.95 ms)",
                value=none[0.95].rms(near) / none[0.95].rms(),
                low=1.0,
            ),
            Verdict(
                claim="With walls 115 K below the gas the spray looks colder for higher orders "
                "(mean of order 0 minus all, 0.95 ms)",
                value=none[0.95].mean(),
                unit="K",
                low=0.0,
                why=f"it is {none[0.95].mean(near):+.1f} K 1 to 8 mm below the nozzle, where what "
                "is scattered more often comes from droplets colder than the walls, and "
                f"{none[0.95].mean(away):+.2f} K beyond, where it comes from warmer vapour",
            ),
        ),
    )


def beyond(run: Run) -> Mask:
    """The visible spray 8 mm and more below the injector's tip."""
    _, z = positions_m(run)
    return np.asarray(visible(run) & (z < -8e-3))


def within(change: Change, limit_K: float) -> float:
    """Part of the pixels of `change` that change by `limit_K` at most."""
    return float(np.mean(np.abs(change.within()) <= limit_K))


def _why(change: Change, run: Run) -> str:
    """Where it comes from."""
    near, far = change.rms(root(run)), change.rms(beyond(run))
    return f"it is {near:.3g} K 1 to 8 mm below the nozzle, and {far:.2g} K beyond (RMS)"


def _text(rows: list[Row]) -> str:
    def told(time_ms: float) -> str:
        found = {row["order"]: row for row in rows if row["time / ms"] == time_ms}
        steps = ", ".join(f"{float(found[str(order)]['RMS / K']):.2g}" for order in _ORDERS)
        root_K, far_K = (
            float(found["1"][f"RMS {place} / K"]) for place in ("below the nozzle", "beyond 8 mm")
        )
        return (
            f"{steps} K at {time_ms:g} ms (order 1: {root_K:.2g} K below the nozzle, {far_K:.2g} K "
            "beyond 8 mm)"
        )

    return (
        "The paper could afford one order and bounded the rest by three; here all orders are "
        "solved for, and every order is held against that. What is scattered more often than the "
        "order allows is taken to come from the walls. Orders "
        f"{', '.join(str(order) for order in _ORDERS)} leave, RMS over the spray, "
        f"{'; '.join(told(time_ms) for time_ms in _TIMES_MS)}. Below the nozzle the rate at which "
        "fuel is injected makes the plumes opaque by droplets alone: light is scattered until it "
        "is absorbed, and each order counts for the droplets' albedo of the one before."
    )
