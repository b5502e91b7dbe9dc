"""Error against run time of `source` and `path`, single traces of one scene."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from cldit.arrays import Floats, Mask
from cldit.bench.case import BenchError, Cost, Say, changed
from cldit.bench.report import Part, number
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.show.figures.style import WIDTH_IN, figure_of, plain_ticks, styled
from cldit.show.page import Table
from cldit.transport.trace import TraceSettings
from tests.bench.case import Case, Lattice, one_pixel
from tests.bench.page import Given, write_measured

ACCURACIES_K = (1.0, 0.3, 0.1, 0.05)  # of `source`

SAMPLES = (128, 256, 512)  # of `path`, per pixel
PLAIN_K = 0.3  # accuracy of `source` without final gather
REFERENCE_SAMPLES = 512  # of both halves together
_REFERENCE_SEEDS = (7001, 7002)
_STYLES = {
    "source": ("o", "tab:blue"),
    "source, no gather": ("D", "tab:cyan"),
    "path": ("s", "tab:orange"),
}
_HEAD = ("core-s, whole image", "T_app RMS, K", "largest, K", "estimated, K")


@dataclass(frozen=True)
class Truth:
    """Converged `path` image in two independent halves.

    temperature_K: (H, W) T_app of each half. visible: (H, W) pixels that are compared. noise_K:
    RMS over pixels of the standard error of their mean.
    """

    temperature_K: tuple[Floats, Floats]
    visible: Mask
    noise_K: float
    samples: int

    @classmethod
    def of(cls, case: Case, *, samples: int, phase: Any, order: int | None = None) -> Truth:
        """Reference by path tracing; `samples` per pixel in both halves together."""
        half = path_settings(case, samples // 2, phase=phase, order=order)
        first, second = (case.run(replace(half, seed=seed))[0].weights for seed in _REFERENCE_SEEDS)
        temperature_K = case.temperature_K(first), case.temperature_K(second)
        emissivity = 1.0 - (first.background.astype(float) + second.background) / 2
        visible = (emissivity > VISIBLE_EMISSIVITY) & np.isfinite(
            temperature_K[0] + temperature_K[1]
        )
        if not visible.any():
            raise BenchError(
                f"scene {case.scene.name}: no pixel in front of the background has an emissivity "
                f"above {VISIBLE_EMISSIVITY:g}; there is nothing to compare"
            )
        noise = float(np.sqrt(np.mean((temperature_K[0] - temperature_K[1])[visible] ** 2))) / 2
        return cls(temperature_K, visible, noise, samples)

    def rms(self, temperature_K: Floats) -> float:
        """RMS error of T_app (H, W) over the visible pixels, without the noise of the truth.

        The halves a and b are independent, so their noise cancels in the mean of (x - a)(x - b).
        """
        a, b = self.temperature_K
        products = ((temperature_K - a) * (temperature_K - b))[self.visible]
        return float(np.sqrt(max(float(np.nanmean(products)), 0.0)))

    def largest(self, temperature_K: Floats) -> float:
        """Largest difference of T_app (H, W) from the truth, noise included."""
        a, b = self.temperature_K
        return float(np.nanmax(np.abs(temperature_K - (a + b) / 2)[self.visible]))


@dataclass(frozen=True)
class Row:
    """One method with one setting.

    traced: fraction of the pixels that were traced. picture_core_s: for all of them, linear in the
    pixels but for the part that does not depend on them. stated_K: error that the trace itself
    estimates, if it does.
    """

    method: str
    label: str
    phase: str
    traced: float
    core_s: float
    wall_s: float
    picture_core_s: float
    rms_K: float
    max_K: float
    stated_K: float | None = None


def path_settings(
    case: Case, samples: int, *, phase: Any, order: int | None = None, seed: int = 11
) -> TraceSettings:
    """Settings of path tracing with a fixed number of samples, whatever the error."""
    settings = case.settings(
        method="path", phase=phase, order=order, max_samples=max(samples, 128), seed=seed
    )
    return replace(settings, accuracy_K=0.0)


def _row(
    method: str,
    label: str,
    weights: Weights,
    cost: Cost,
    stated: Weights | None,
    *,
    part: Case,
    truth: Truth,
    phase: str,
    traced: float = 1.0,
    fixed_core_s: float = 0.0,
) -> Row:
    """Comparison of one trace with the truth.

    `weights` and their estimated error `stated` are of the compared pixels, the scene of `part`. If
    only these were traced, `traced` is their fraction and `fixed_core_s` the cost of a trace
    without an image.
    """
    temperature_K = part.temperature_K(weights)
    error_K = None
    if stated is not None:
        shifted = {name: image + stated.images[name] for name, image in weights.images.items()}
        change = (part.temperature_K(Weights.of(shifted)) - temperature_K)[truth.visible]
        error_K = float(np.sqrt(np.nanmean(change**2)))
    return Row(
        method=method,
        label=label,
        phase=phase,
        traced=traced,
        core_s=cost.core_s,
        wall_s=cost.wall_s,
        picture_core_s=fixed_core_s + max(cost.core_s - fixed_core_s, 0.0) / traced,
        rms_K=truth.rms(temperature_K),
        max_K=truth.largest(temperature_K),
        stated_K=error_K,
    )


def bench_error(
    case: Case,
    *,
    phase: str,
    lattice: Lattice,
    say: Say,
    accuracies_K: Sequence[float] = ACCURACIES_K,
    samples: Sequence[int] = SAMPLES,
    reference_samples: int = REFERENCE_SAMPLES,
) -> tuple[list[Row], Truth]:
    """Rows of `source` with several accuracies and of `path` with several numbers of samples.

    `source` makes the whole image, of which the pixels of the lattice are compared; `path` and the
    reference trace those pixels alone.
    """
    part, share = case.seen(lattice.of(case.scene)), lattice.share(case.scene)
    empty = case.seen(one_pixel(case.scene))
    say(f"{phase}: reference, {reference_samples} samples in {share:.3g} of the pixels")
    truth = Truth.of(part, samples=reference_samples, phase=phase)
    say(f"{phase}: error of the reference {truth.noise_K:.3f} K")
    rows: list[Row] = []

    def add(method: str, label: str, weights: Weights, cost: Cost, **more: Any) -> None:
        rows.append(_row(method, label, weights, cost, part=part, truth=truth, phase=phase, **more))
        row = rows[-1]
        say(f"{phase}: {row.label}: {row.picture_core_s:.4g} core-s, {row.rms_K:.3f} K RMS")

    case.run(case.settings(phase=phase, accuracy_K=100.0))  # builds
    solved = [("source", f"source, {k:g} K", {"accuracy_K": k}) for k in accuracies_K]
    plain = {"accuracy_K": PLAIN_K, "gather": False}
    solved.append(("source, no gather", f"source, no gather, {PLAIN_K:g} K", plain))
    for method, label, transport in solved:
        result, cost = case.run(case.settings(phase=phase, audit=False, **transport))
        error = result.weights_difference
        stated = None if error is None else lattice.pick(case.scene, error)
        weights = lattice.pick(case.scene, result.weights)
        add(method, label, weights, cost, stated=stated)
    for count in samples:
        settings = path_settings(case, count, phase=phase)
        fixed = empty.run(settings)[1].core_s
        result, cost = part.run(settings)
        more = {"stated": result.weights_difference, "traced": share, "fixed_core_s": fixed}
        add("path", f"path, {count} samples", result.weights, cost, **more)
    return rows, truth


def measure(given: Given) -> Part:
    """Measures isotropic scattering and, if droplets have diameters, Mie's phase function."""
    scene, options = given.scene, given.options
    mie = ["mie"] if scene.spray.model not in ("none", "grid") else []
    fixed = {"method": "source", "order": None, "accuracy_K": 0.1}
    prepared = changed(scene, transport={"phase": mie[0] if mie else "isotropic", **fixed})
    case = Case.of(prepared, given.device, cache=given.cache)
    rows, truths = [], {}
    for phase in ["isotropic", *mie]:
        more, truths[phase] = bench_error(
            case,
            phase=phase,
            lattice=Lattice((options.every, options.every)),
            say=given.say,
            accuracies_K=options.accuracy or ACCURACIES_K,
            reference_samples=options.samples,
        )
        rows += more
        given.save(error_part(scene, rows, truths))
    return error_part(scene, rows, truths)


def error_part(scene: Scene, rows: Sequence[Row], truths: dict[str, Truth]) -> Part:
    """Tables and figure of every phase function in `truths`."""
    tables, text = [], []
    for phase, truth in truths.items():
        lines = [_line(row) for row in rows if row.phase == phase]
        tables.append(Table((f"{phase}: method", *_HEAD), lines))
        text.append(
            f"{phase}: the reference is `path` with {truth.samples} samples per pixel in two "
            f"independent halves; its error of {truth.noise_K:.3f} K RMS cancels in the RMS, but "
            f"not in the largest difference. {int(truth.visible.sum())} pixels in front of the "
            "background with an emissivity above 0.05 are compared."
        )
    traced = min(row.traced for row in rows)
    if traced < 1.0:
        text.append(f"`path` traced {100 * traced:.3g} % of the pixels; its time is extrapolated.")
    return Part(
        name="error",
        title=f"Error against run time: {scene.name}",
        tables=tuple(tables),
        data={
            "rows": [asdict(row) for row in rows],
            "noise_K": {phase: truth.noise_K for phase, truth in truths.items()},
        },
        text=tuple(text),
        figure=error_figure(scene, rows),
        alternative="RMS error of the apparent temperature against core seconds",
    )


def _line(row: Row) -> list[str]:
    return [
        row.label,
        number(row.picture_core_s),
        f"{row.rms_K:.3f}",
        f"{row.max_K:.2f}",
        "-" if row.stated_K is None else f"{row.stated_K:.3f}",
    ]


@styled
def error_figure(scene: Scene, rows: Sequence[Row]) -> Figure:
    """Figure of the errors of methods against their cost, by phase function."""
    phases = list(dict.fromkeys(row.phase for row in rows))
    figure = figure_of(min(0.6 + 3.1 * len(phases), WIDTH_IN), 3.2)
    axes: Any = figure.subplots(1, len(phases), sharey=True, squeeze=False)[0]
    columns, height = scene.camera.pixels
    labelled: list[list[tuple[str, float, float]]] = [[] for _ in phases]
    for axis, phase, labels in zip(axes, phases, labelled, strict=True):
        for method, (marker, colour) in _STYLES.items():
            line = [row for row in rows if row.method == method and row.phase == phase]
            seconds = [row.picture_core_s for row in line]
            errors_K = [max(row.rms_K, 1e-3) for row in line]  # the axis is logarithmic
            axis.loglog(seconds, errors_K, f"{marker}-", color=colour, label=method)
            labels += [
                (row.label.rpartition(", ")[2], second, error_K)
                for row, second, error_K in zip(line, seconds, errors_K, strict=True)
            ]
        axis.set_title(f"{phase} scattering" if phase == "isotropic" else phase)
        axis.set_xlabel(f"core seconds for {columns} x {height} pixels")
        plain_ticks(axis)
        axis.grid(which="both")
        axis.legend()
        axis.margins(x=0.25, y=0.1)
    axes[0].set_ylabel("RMS error of the apparent temperature / K")
    figure.suptitle(f"{scene.name}: error against run time")
    for axis, labels in zip(axes, labelled, strict=True):
        label_points(axis, labels)
    return figure


def label_points(axes: Axes, labels: Sequence[tuple[str, float, float]]) -> None:
    """Writes texts beside points (text, x, y), where none covers another, a point or the legend."""
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    legend = axes.get_legend()
    taken = [] if legend is None else [legend.get_window_extent()]
    dots = axes.transData.transform(np.array([at for _, *at in labels]).reshape(-1, 2))
    taken += [Bbox.from_bounds(x - 3, y - 3, 6, 6) for x, y in dots]
    for text, x, y in labels:
        note = axes.annotate(text, (x, y), (0, 0), textcoords="offset points", fontsize=6.5)
        for away in (4.0, 10.0, 18.0, 28.0):
            for across, up in _AROUND:
                note.set_position((away * across, away * up))
                note.set(ha="left" if across > 0 else "right" if across < 0 else "center",
                         va="bottom" if up > 0 else "top" if up < 0 else "center")  # fmt: skip
                box = note.get_window_extent()
                covered = sum(_common(box, other) for other in taken)
                outside = box.width * box.height - _common(box, axes.get_window_extent())
                if covered + outside <= 0.0:
                    break
            else:
                continue
            break
        taken.append(note.get_window_extent())


def _common(one: Bbox, other: Bbox) -> float:
    """Area that two boxes share."""
    both = Bbox.intersection(one, other)
    return 0.0 if both is None else float(both.width * both.height)


_AROUND = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--accuracy", type=float, action="append", help="of `source`, K; several")
    every = "the reference and `path` trace every n-th pixel across and down (odd)"
    parser.add_argument("--every", type=int, default=5, help=every)
    samples = "samples per pixel of the reference"
    parser.add_argument("--samples", type=int, default=REFERENCE_SAMPLES, help=samples)


def main() -> None:
    """Writes the page."""
    write_measured(measure, _options)
