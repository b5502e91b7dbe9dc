"""Error against run time as table and picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from matplotlib.figure import Figure

from cldit.bench.error import Row, Truth
from cldit.bench.ratios import Ratio, ratios
from cldit.bench.report import Part, Table, number
from cldit.scene import Scene
from cldit.show.figures.sheet import figure_of

_STYLES = {
    "source": ("o", "tab:blue"),
    "source, no gather": ("D", "tab:cyan"),
    "path": ("s", "tab:orange"),
    "branching": ("^", "tab:red"),
}
# Where labels stand beside the points, in points: to the left where others stand on the right; on
# the other side of one that is close to the next.
_LABELS = {"source": (-5, -8), "source, no gather": (-6, 3), "path": (4, 4), "branching": (4, 4)}
_CLOSE = 1.4
_HEAD = (
    "method",
    "pixels traced",
    "core-s",
    "wall s",
    "core-s, whole picture",
    "T_app RMS, K",
    "largest, K",
    "w_bg RMS",
    "largest",
    "w_wall RMS",
    "largest",
    "stated, K",
)
_ORDER_HEAD = (
    "method, order",
    "pixels traced",
    "core-s, whole picture",
    "T_app RMS, K",
    "left however often, K",
    "RMS off all orders, K",
    "largest, K",
)


def error_part(scene: Scene, rows: Sequence[Row], truths: dict[str, Truth]) -> Part:
    """Tables and picture of every phase function that was measured.

    Args:
        scene: that was traced.
        rows: of all phase functions.
        truths: references by phase function.
    """
    found = ratios(rows)
    tables = []
    text = []
    for phase, truth in truths.items():
        lines = [_line(row) for row in rows if row.phase == phase and row.order is None]
        tables.append(Table.of((f"{phase}: {_HEAD[0]}", *_HEAD[1:]), lines))
        lines = [_order_line(row) for row in rows if row.phase == phase and row.order is not None]
        if lines:
            tables.append(Table.of((f"{phase}: {_ORDER_HEAD[0]}", *_ORDER_HEAD[1:]), lines))
        text.append(
            f"{phase}: the reference is `path` with {truth.samples} samples a pixel in two "
            f"independent halves, good to {truth.noise_K:.3f} K RMS; that noise is taken off the "
            f"RMS by the product of the differences from either half, and is in the largest. "
            f"{int(truth.visible.sum())} pixels before the background, of emissivity above 0.05, "
            "are compared."
        )
    text.append(
        "Where a part of the pixels was traced, the whole picture's core seconds are extrapolated: "
        "what a picture of one empty pixel costs, and the rest times pixels over pixels traced."
    )
    if any(row.order is not None for row in rows):
        text.append(
            "Runs of a fixed order are compared with `path` of that order, too. `branching` was "
            "run twice: what both have wrong alike is left however often it is repeated, and the "
            "rest falls as the root of the number of runs. So the seconds that it takes to an "
            "error follow; below what is left it never gets."
        )
    lines = [
        [
            ratio.what,
            "never" if ratio.times is None else number(ratio.times),
            "each its own" if ratio.error_K is None else number(ratio.error_K),
        ]
        for ratio in found
    ]
    tables.append(Table.of(("core seconds", "times", "at an RMS error of, K"), lines))
    return Part(
        name="error",
        title=f"Error against run time: {scene.name}",
        tables=tuple(tables),
        data={
            "rows": [asdict(row) for row in rows],
            "ratios": [asdict(ratio) for ratio in found],
            "noise_K": {phase: truth.noise_K for phase, truth in truths.items()},
        },
        text=tuple(text),
        figure=_figure(scene, rows, found),
        alternative="RMS error of the apparent temperature against core seconds",
    )


def _core_s(row: Row) -> str:
    return number(row.picture_core_s) + ("" if row.traced == 1 else " (extrapolated)")


def _order_line(row: Row) -> list[str]:
    return [
        row.label,
        f"{100 * row.traced:.3g} %",
        _core_s(row),
        number(row.of_order_K),
        number(row.left_K),
        f"{row.rms_K:.3f}",
        f"{row.max_K:.2f}",
    ]


def _line(row: Row) -> list[str]:
    return [
        row.label,
        f"{100 * row.traced:.3g} %",
        number(row.core_s),
        number(row.wall_s),
        _core_s(row),
        f"{row.rms_K:.3f}",
        f"{row.max_K:.2f}",
        f"{row.rms_background:.1e}",
        f"{row.max_background:.1e}",
        f"{row.rms_wall:.1e}",
        f"{row.max_wall:.1e}",
        "-" if row.stated_K is None else f"{row.stated_K:.3f}",
    ]


def _shown_K(row: Row) -> float:
    """Its error in the picture, whose axis is logarithmic."""
    return max(row.rms_K, 1e-3)


def _close(row: Row, later: Row) -> bool:
    """Whether labels of both would stand in each other's way."""
    ratios = (later.picture_core_s / row.picture_core_s, _shown_K(later) / _shown_K(row))
    return all(1 / _CLOSE < ratio < _CLOSE for ratio in ratios)


def _figure(scene: Scene, rows: Sequence[Row], found: Sequence[Ratio]) -> Figure:
    phases = list(dict.fromkeys(row.phase for row in rows))
    figure = figure_of(1.0 + 4.4 * len(phases), 4.6)
    axes: Any = figure.subplots(1, len(phases), sharey=True, squeeze=False)[0]
    for axis, phase in zip(axes, phases, strict=True):
        these = [row for row in rows if row.phase == phase]
        for method, (marker, colour) in _STYLES.items():
            for whole in (True, False):
                line = [
                    row for row in these if row.method == method and (row.order is None) == whole
                ]
                if not whole:  # the most accurate of each order
                    line = list({row.order: row for row in line}.values())
                if not line or (method == "source, no gather" and not whole):
                    continue
                filled = whole or method == "branching"
                axis.loglog(
                    [row.picture_core_s for row in line],
                    [_shown_K(row) for row in line],
                    marker=marker,
                    color=colour,
                    markerfacecolor=colour if filled else "white",
                    linestyle="-" if whole else ":",
                    label=method + ("" if whole else ", orders 0, 1, 2"),
                )
                for row, later in zip(line, [*line[1:], None], strict=True):
                    right, up = _LABELS[method]
                    if later is not None and _close(row, later):
                        right, up = -right, -up
                    axis.annotate(
                        row.label.rpartition(", ")[2] if whole else str(row.order),
                        (row.picture_core_s, _shown_K(row)),
                        textcoords="offset points",
                        xytext=(right, up),
                        ha="left" if right > 0 else "right",
                        fontsize=7,
                        color=colour,
                    )
        axis.set_title(f"{phase} scattering" if phase == "isotropic" else phase, fontsize=10)
        columns, height = scene.camera.pixels
        axis.set_xlabel(f"core seconds for {columns} x {height} pixels")
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=7.5)
        axis.margins(x=0.25, y=0.1)
    axes[0].set_ylabel("RMS error of the apparent temperature / K")
    figure.suptitle(f"{scene.name}: what accuracy costs", fontsize=11)
    return figure
