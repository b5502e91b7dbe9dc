"""What several rays a pixel cost, and what they bring.

Pictures are those of the middle of the field, a sixteenth of it, with pixels as large as the
scene's. All settings see the same solution (same seed): the difference is that of the pixels. The
truth has 256 rays a pixel: 64 in each quarter of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cldit.bench.case import Case, Cost, Say, changed, clocked
from cldit.bench.report import Part, Table, number
from cldit.gpu.program import Define
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.show.figures.sheet import figure_of
from cldit.transport.cells import OpticalCells
from cldit.transport.image import FormalSolution
from cldit.transport.result import weights_of
from cldit.transport.view import View

Floats = NDArray[np.float64]

PART = 4  # of the field, each way
EVEN = (1, 4, 16, 64)
ADAPTIVE_K = (
    3.0,
    1.0,
    0.3,
    0.1,
)  # transport.accuracy_K: bends of the picture that stay as they are
_EDGE = 0.02  # step of the background's weight to a neighbour, of a pixel that lies at an edge


@dataclass(frozen=True)
class Row:
    """rays: a pixel, or of `adaptive` the accuracy asked for. core_s: of a picture. rms_K,
    largest_K: of T_app over pixels of emissivity above 0.05; edge_K: over those at edges;
    edge_background: RMS of the weight at edges. several: share of the pixels with more than one."""

    rays: str
    core_s: float
    rms_K: float
    edge_K: float
    largest_K: float
    edge_background: float
    several: float


def _quarters(weights: Weights) -> Weights:
    """Means over 2 x 2 pixels."""
    return weights.map(
        lambda image: (
            image.reshape(image.shape[0] // 2, 2, -1, 2)
            .mean(axis=(1, 3), dtype=np.float64)
            .astype(np.float32)
        )
    )


def at_edges(background: Floats) -> NDArray[np.bool_]:
    """Pixels (H, W) whose weight of the background steps to a neighbour's."""
    edge = np.zeros(background.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(background, axis=axis)) > _EDGE
        for beside in (slice(None, -1), slice(1, None)):
            where = [slice(None), slice(None)]
            where[axis] = beside
            edge[tuple(where)] |= step
    return edge


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


@dataclass(frozen=True)
class _Painted:
    """A picture of the one solution, what it took, and its pixels of more than one ray."""

    weights: Weights
    cost: Cost
    several: int

    @classmethod
    def of(cls, case: Case, towards: NDArray[np.floating] | None, *, accuracy_K: float) -> _Painted:
        """towards (C, N): what the scattering cells send to the camera."""
        cells = OpticalCells.of(case.tree, patches=tuple(p.name for p in case.scene.patches))
        view, settings = View.of(case.scene, cells), case.settings()
        defines: dict[str, Define] = {
            **cells.needs.defines,
            **view.defines,
            "CUTOFF": float(settings.cutoff),
        }
        formal_solution = FormalSolution.of(
            cells, view, case.scene, case.device, defines, accuracy_K=accuracy_K
        )
        defect = np.zeros(len(cells.address))
        formal_solution.images([towards], defect)  # builds
        (images, _, several), cost = clocked(
            case.device, lambda: formal_solution.images([towards], defect)
        )
        return cls(weights_of(images[0], cells), cost, several)


def bench_rays(case: Case, *, say: Say) -> tuple[list[Row], int]:
    """A row for each of `EVEN` and `ADAPTIVE_K` for `case`, and the number of edge pixels.

    `say` takes lines of progress.
    """
    (columns, rows), (width_m, height_m) = case.scene.camera.pixels, case.scene.camera.field_m
    few = (max(columns // PART, 1), max(rows // PART, 1))
    field_m = (width_m * few[0] / columns, height_m * few[1] / rows)

    def part(rays: int | str, *, finer: int = 1) -> Case:
        pixels = [finer * n for n in few]
        camera = {"pixels": pixels, "field_m": field_m, "rays_per_pixel": rays}
        return case.seen(changed(case.scene, camera=camera))

    plain = part(1)
    solution = plain.run(case.settings(audit=False))[0].solution
    towards = None if solution is None else solution.camera_source
    truth = _quarters(_Painted.of(part(64, finer=2), towards, accuracy_K=1.0).weights)
    truth_K = plain.temperature_K(truth)
    background = truth.background.astype(float)
    visible = (1 - background > VISIBLE_EMISSIVITY) & np.isfinite(truth_K)
    edge = at_edges(background)
    found = []
    settings: list[tuple[int | str, float]] = [(number, 1.0) for number in EVEN]
    settings += [("adaptive", accuracy_K) for accuracy_K in ADAPTIVE_K]
    for rays, accuracy_K in settings:
        painted = _Painted.of(part(rays), towards, accuracy_K=accuracy_K)
        name = str(rays) if rays in EVEN else f"adaptive, {accuracy_K:g} K"
        off = plain.temperature_K(painted.weights) - truth_K
        seen = visible & np.isfinite(off)
        found.append(
            Row(
                rays=name,
                core_s=painted.cost.core_s,
                rms_K=_rms(off[seen]),
                edge_K=_rms(off[seen & edge]),
                largest_K=float(np.max(np.abs(off[seen]), initial=0.0)),
                edge_background=_rms((painted.weights.background - background)[edge]),
                several=painted.several / (few[0] * few[1]),
            )
        )
        say(f"rays a pixel {name}: {found[-1].core_s:.3g} core-s, "
            f"{found[-1].edge_K:.3g} K at edges")  # fmt: skip
    return found, int((edge & visible).sum())


def rays(case: Case, *, say: Say) -> Part:
    """1, 4, 16, 64 and adaptive rays a pixel of `case`: error at edges against core seconds.

    `say` takes lines of progress.
    """
    found, edges = bench_rays(case, say=say)
    head = ("rays a pixel", "core-s, picture", "T_app RMS at edges, K", "over all, K", "largest, K",
            "w_bg RMS at edges", "pixels of several rays")  # fmt: skip
    lines = [
        (
            row.rays,
            number(row.core_s),
            f"{row.edge_K:.3f}",
            f"{row.rms_K:.3f}",
            f"{row.largest_K:.1f}",
            f"{row.edge_background:.1e}",
            f"{100 * row.several:.1f} %",
        )
        for row in found
    ]
    columns, rows = (n // PART for n in case.scene.camera.pixels)
    return Part(
        name="rays",
        title=f"Pixels as areas: {case.scene.name}",
        tables=(Table.of(head, lines),),
        data=[asdict(row) for row in found],
        text=(
            f"The middle {columns} x {rows} pixels, where spray fills most of the picture, against "
            "256 rays a pixel. Core seconds are those of one picture; a trace makes two. Edges: "
            f"pixels of emissivity above {VISIBLE_EMISSIVITY:g} whose weight of the background "
            f"differs from a neighbour's by more than {_EDGE:g}; there are {edges}.",
        ),
        figure=_figure(found),
        alternative="RMS error of the apparent temperature at edges against core seconds",
    )


def _figure(found: Sequence[Row]) -> Figure:
    figure = figure_of(5.4, 3.8)
    axes: Any = figure.subplots()
    kinds = {
        "even": [row for row in found if not row.rays.startswith("adaptive")],
        "adaptive": [row for row in found if row.rays.startswith("adaptive")],
    }
    for key, where, colour in (
        ("edge_K", "at edges", "tab:blue"),
        ("rms_K", "over all", "tab:orange"),
    ):
        for (kind, rows), style in zip(kinds.items(), ("o-", "*--"), strict=True):
            axes.loglog(
                [row.core_s for row in rows],
                [getattr(row, key) for row in rows],
                style,
                color=colour,
                label=f"{kind}, {where}",
            )
    for place, row in enumerate(found):
        adaptive = row.rays.startswith("adaptive")
        axes.annotate(
            row.rays.removeprefix("adaptive, "),
            (row.core_s, row.edge_K),
            xytext=(-22, -4 - 9 * (place % 2)) if adaptive else (4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    axes.set_xlabel("core seconds of the picture")
    axes.set_ylabel("RMS error of T_app / K")
    axes.set_title("Rays a pixel", fontsize=10)
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=7)
    return figure
