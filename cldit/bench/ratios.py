"""How many times the core seconds one method takes of those of another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cldit.bench.error import Row


@dataclass(frozen=True)
class Ratio:
    """times: to the same `error_K`, None where that is never reached; error_K: None, where each is
    run once and has its own."""

    what: str
    times: float | None
    error_K: float | None


def ratios(rows: Sequence[Row]) -> list[Ratio]:
    """`path` to the error of each `source`; `branching` to that of each `source` of its order.

    The error of `path` falls with the root of its samples, so its core seconds x error^2 is one
    number, the mean of that of its rows; the seconds to any error follow. Of `branching` that holds
    for what repetition takes away.
    """
    out = []
    for phase in dict.fromkeys(row.phase for row in rows):
        these = [row for row in rows if row.phase == phase]
        paths = [row for row in these if row.method == "path"]
        effort = float(np.mean([row.picture_core_s * row.rms_K**2 for row in paths] or [np.nan]))
        sources = [row for row in these if row.method.startswith("source")]
        for row in sources:
            if row.order is None:
                times = effort / max(row.rms_K, 1e-9) ** 2 / row.picture_core_s
                out.append(Ratio(f"path / {row.label}, {phase}", times, row.rms_K))
        for branching in these:
            if branching.method == "branching":
                for row in sources:
                    if row.order == branching.order:
                        out += _of_order(branching, row)
    return out


def _of_order(branching: Row, source: Row) -> list[Ratio]:
    what = f"branching / {source.label}"
    once = branching.picture_core_s / source.picture_core_s
    out = [Ratio(what, once, None)]
    if source.order:
        runs = _runs(branching, source.of_order_K)
        out.append(Ratio(what, None if runs is None else runs * once, source.of_order_K))
    return out


def _runs(row: Row, error_K: float | None) -> float | None:
    """How often to repeat a run whose error has a part that stays; None: no number is enough."""
    if error_K is None or row.of_order_K is None or row.left_K is None or error_K <= row.left_K:
        return None
    return (row.of_order_K**2 - row.left_K**2) / (error_K**2 - row.left_K**2)
