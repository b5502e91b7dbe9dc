"""Growth of cost with pixels, cells, droplet cells, wavelengths and orders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cldit.accuracy.node_traces import trace_nodes
from cldit.bench.case import Case, Say, changed, clocked
from cldit.bench.report import Part, Table
from cldit.medium.octree import Octree
from cldit.prepare.medium import make_medium
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.show.figures.sheet import figure_of
from tests.bench.page import write_measured

DIRECTIONS = 16
_ROUNDS = 3  # of runs at every number of wavelengths


def halved(scene: Scene) -> Scene:
    """Scene with cells and pixels twice as large."""
    return changed(
        scene,
        domain={"leaf_edge_m": 2 * scene.domain.leaf_m},
        camera={"pixels": [max(pixels // 2, 1) for pixels in scene.camera.pixels]},
    )


@dataclass(frozen=True)
class Point:
    """amount: of the varied quantity; core_s: of the part of the run that is named with it."""

    amount: float
    core_s: float


@dataclass(frozen=True)
class Growth:
    """Core seconds for one varied quantity, all else equal."""

    what: str
    part: str
    points: tuple[Point, ...]

    @property
    def exponent(self) -> float:
        """Exponent of a power law through all points; NaN with fewer than two."""
        if len(self.points) < 2:
            return float("nan")
        amount, cost = np.log([(p.amount, p.core_s) for p in self.points]).T
        return float(np.polyfit(amount, cost, 1)[0])

    @property
    def last(self) -> float:
        """Exponent between the last two points; NaN with fewer."""
        if len(self.points) < 2:
            return float("nan")
        a, b = self.points[-2:]
        return float(np.log(b.core_s / a.core_s) / np.log(b.amount / a.amount))


def growth(case: Case, *, cache: Path, say: Say) -> Part:
    """Varies each quantity alone, with cells and pixels twice as large."""
    scene = case.scene
    half = halved(scene)
    base = Case.of(half, case.device, cache=cache)
    found = [*_pixels(base), _cells(case, cache)]
    if base.tree.fields["droplet_scattering"].any():
        found += [_droplet_cells(base), _orders(base)]
    found.append(_wavelengths(half, base, cache))
    for one in found:
        say(f"{one.what}: exponent {one.exponent:.2f}")
    doubled = found[0].points
    twice = doubled[-1].core_s / doubled[-2].core_s
    many = found[-1].points
    lines = [
        (
            one.what,
            one.part,
            "; ".join(f"{p.amount:.4g}: {p.core_s:.3g}" for p in one.points),
            f"{one.exponent:.2f}",
            f"{one.last:.2f}",
        )
        for one in found
    ]
    return Part(
        name="growth",
        title=f"Growth of cost: {scene.name} at half its resolution",
        tables=(
            Table.of(
                ("of", "cost of", "amount: core-s", "exponent", "between the last two"), lines
            ),
        ),
        data=[{**asdict(one), "exponent": one.exponent, "last": one.last} for one in found],
        text=(
            f"`source`, {DIRECTIONS} directions, one thing varied at a time. Twice the pixels cost "
            f"{twice:.2f} times as much in all; {many[-1].amount:.0f} wavelengths cost "
            f"{many[-1].core_s / many[0].core_s:.2f} times one, spray and octree included, which "
            "are made once.",
        ),
        figure=_figure(found),
        alternative="Core seconds against pixels, cells, droplet cells, wavelengths and orders",
    )


def _settings(case: Case, **more: Any) -> Any:
    return case.settings(directions=DIRECTIONS, phase="isotropic", **more)


def _cost(case: Case, **more: Any) -> float:
    settings = _settings(case, **more)
    case.run(settings)
    return min(case.run(settings)[1].core_s for _ in range(2))


def _pixels(base: Case) -> list[Growth]:
    """Cost of a trace, and of its images: the difference from a trace of one pixel."""
    columns, rows = base.scene.camera.pixels
    amounts, costs = [], []
    for wide, high in ((1, 1), (2, 2), (4, 4), (4, 8)):
        pixels = [max(columns * wide // 2, 1), max(rows * high // 2, 1)]
        amounts.append(float(np.prod(pixels)))
        costs.append(_cost(base.seen(changed(base.scene, camera={"pixels": pixels}))))
    one = _cost(base.seen(changed(base.scene, camera={"pixels": [1, 1]})))
    points = tuple(Point(n, s) for n, s in zip(amounts, costs, strict=True))
    pictures = tuple(
        Point(n, max(s - one, 1e-6)) for n, s in zip(amounts[1:], costs[1:], strict=True)
    )
    return [Growth("pixels", "the trace", points), Growth("pixels", "pictures", pictures)]


def _cells(case: Case, cache: Path) -> Growth:
    points: list[Point] = []
    for coarser in (4, 2, 1):
        scene = changed(
            case.scene,
            domain={"leaf_edge_m": coarser * case.scene.domain.leaf_m},
            camera={"pixels": [1, 1]},
        )
        some = case.seen(scene) if coarser == 1 else Case.of(scene, case.device, cache=cache)
        result, _ = some.run(_settings(some, order=1))
        cells = float(result.counts.get("swept_cells", some.tree.slots * 512))
        if not points or cells > points[-1].amount:  # whole bricks: coarse boxes may be the same
            points.append(Point(cells, _cost(some)))
    return Growth("cells swept", "the trace, one pixel", tuple(points))


def _droplet_cells(base: Case) -> Growth:
    """Droplets in some of the cells only, in the same box."""
    points = []
    one = base.seen(changed(base.scene, camera={"pixels": [1, 1]}))
    scattering = np.flatnonzero(base.tree.fields["droplet_scattering"] > 0)
    for share in (8, 4, 2, 1):
        chosen = scattering[: len(scattering) // share]
        points.append(Point(float(len(chosen)), _cost(_with_tree(one, _only(base.tree, chosen)))))
    return Growth("droplet cells", "the trace, one pixel", tuple(points))


def _only(tree: Octree, chosen: Any) -> Octree:
    mask = np.zeros(len(tree.fields["droplet_scattering"]), bool)
    mask[chosen] = True
    fields = {
        name: np.where(mask, values, np.float32(0)) if name.startswith("droplet") else values
        for name, values in tree.fields.items()
    }
    return replace(tree, fields=fields)


def _with_tree(case: Case, tree: Octree) -> Case:
    return replace(case, medium=replace(case.medium, trees=[tree]))


def _orders(base: Case) -> Growth:
    one = base.seen(changed(base.scene, camera={"pixels": [1, 1]}))
    points = tuple(Point(float(n), _cost(one, order=n)) for n in (1, 2, 4, 8, 16))
    return Growth("orders", "the trace, one pixel", points)


def _wavelengths(half: Scene, base: Case, cache: Path) -> Growth:
    """Least cost of several rounds over all numbers of wavelengths."""
    settings = _settings(base)
    least: dict[int, float] = {}

    def work(count: int) -> int:
        optics = {"preset": "spectral", "wavelengths": count, "compare_paper": False}
        scene = changed(half, optics=optics)
        medium = make_medium(scene, base.device, Stages(None), cache)
        trees = list(medium.trees)
        nodes = medium.properties.chosen.quadrature
        each = [settings] * len(trees)
        trace_nodes(trees, nodes, scene, base.device, each, report=None)
        return len(medium.trees)  # those of the list are let go of as they are traced

    work(1)  # builds
    for _ in range(_ROUNDS):
        for count in (1, 3, 10):
            traced, cost = clocked(base.device, partial(work, count))
            least[traced] = min(cost.core_s, least.get(traced, np.inf))
    points = tuple(Point(float(traced), core_s) for traced, core_s in least.items())
    return Growth("wavelengths", "spray, optics, octree and traces", points)


def _figure(found: Sequence[Growth]) -> Figure:
    figure = figure_of(6.4, 4.4)
    axes: Any = figure.subplots()
    for one, marker in zip(found, "osD^vP", strict=False):
        first = one.points[0]
        axes.loglog(
            [p.amount / first.amount for p in one.points],
            [p.core_s / first.core_s for p in one.points],
            marker=marker,
            label=f"{one.what}: {one.part}, from {first.amount:.3g} ({one.exponent:.2f})",
        )
    limits = np.array(axes.get_xlim())
    axes.loglog(limits, limits, ":", color="0.5", label="linear")
    axes.set_xlabel("amount / least amount")
    axes.set_ylabel("core seconds / those of the least amount")
    axes.set_title("Growth of cost (exponent)", fontsize=10)
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=7)
    return figure


def main() -> None:
    """Writes growth.md."""
    write_measured(lambda given: growth(given.case(), cache=given.cache, say=given.say))
