"""Solvers for the scattered source, against each other: plain Lambda iteration, Anderson
mixing, both also with the diagonal of Lambda taken out (Olson, Auer and Buchler 1986), and GMRES,
which runs take. All see the same rays, so that there is one answer, known from double precision.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import Case, Cost, Say, clocked
from cldit.bench.kernels import Kernels
from cldit.bench.report import Part, Table, number
from cldit.errors import NotConvergedError
from cldit.medium.octree import Octree
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gmres import gmres, next_order, order_0
from cldit.transport.discrete_ordinates.quadrature import isotropic
from cldit.transport.discrete_ordinates.sweep import Sweeper

Array = NDArray[Any]
Residual = Callable[[Array], Array]

WANTED = 1e-4  # RMS error of the source of the worst component: what 1 K asks for
EXACT = 1e-8  # of the answer that the others are held to
MOST = 60  # passes of those that have no end of their own
DEPTH = 5  # steps that Anderson remembers
DIRECTIONS = 16


@dataclass(frozen=True)
class Medium:
    """The scene's droplets alone, `thicker` times as thick and absorbing 1 - albedo of what they
    take out; None leaves the scene as it is."""

    name: str
    thicker: float = 1.0
    coalbedo: float | None = None

    def of(self, tree: Octree) -> Octree:
        """The tree with this medium in its droplet cells."""
        if self.coalbedo is None:
            return tree
        fields = dict(tree.fields)
        absorption, scattering = fields["droplet_absorption"], fields["droplet_scattering"]
        extinction = (absorption + scattering).astype(np.float64) * self.thicker
        radiance = fields["droplet_emission"] / np.where(absorption > 0, absorption, 1)
        nothing = np.zeros_like(absorption)
        changed: dict[str, Array] = {
            "vapour_absorption": nothing,
            "vapour_emission": nothing,
            "droplet_absorption": extinction * self.coalbedo,
            "droplet_scattering": extinction * (1 - self.coalbedo),
            "droplet_emission": extinction * self.coalbedo * radiance,
        }
        return replace(tree, fields={n: v.astype(np.float32) for n, v in changed.items()})


MEDIA = (
    Medium("as it is"),
    Medium("optical depth x 100, albedo 0.9999", 100.0, 1e-4),
    Medium("optical depth x 1e6, albedo 0.999999", 1e6, 1e-6),
    Medium("albedo 1", 1.0, 0.0),
    Medium("optical depth x 100, albedo 1", 100.0, 0.0),
)


@dataclass(frozen=True)
class Row:
    """passes: sets of sweeps. residual: preconditioned, RMS of the worst component, at the end.
    error: likewise, of the source. stopped: why it ended."""

    medium: str
    method: str
    iterations: int
    core_s: float
    residual_rms: float
    error: float
    stopped: str


@dataclass(frozen=True)
class _Equation:
    """One medium on the device in one precision, and the rays that everything is solved with."""

    case: Case
    kernels: Kernels
    sweeper: Sweeper
    rays: DeviceOrdinates

    @classmethod
    def of(cls, case: Case, *, double: bool) -> _Equation:
        kernels = Kernels(case, defines={"USE_FLOAT64": 1} if double else None)
        rng = np.random.default_rng(3)
        sweeper, _ = kernels.sweeper()
        rays = sweeper.rays(isotropic(DIRECTIONS, rng), rng.random((DIRECTIONS, 2)))
        return cls(case, kernels, sweeper, rays)

    @property
    def guess(self) -> Array:
        return order_0(self.sweeper, self.kernels.cells.albedo).astype(self.sweeper.real)

    @property
    def iterations(self) -> int:
        return self.sweeper.sweeps // DIRECTIONS

    def diagonal(self, source: Array) -> Array:
        """What the source lacks, divided by what each cell keeps of its own light."""
        self.sweeper.set_source(source, shining=True)
        self.sweeper.sweep(self.rays, shining=True)
        return self.sweeper.residual(shining=True)

    def plain(self, source: Array) -> Array:
        """What one more scattering changes."""
        return next_order(self.sweeper, source, self.rays) - source


def lambda_iteration(residual_rms: Residual, source: Array) -> Iterator[Array]:
    """Sources (C, N) after each pass from `source` (C, N) on: `residual_rms` is added."""
    while True:
        source = source + residual_rms(source)
        yield source


def anderson(residual: Residual, source: Array, *, depth: int = DEPTH) -> Iterator[Array]:
    """Anderson mixing (1965), each component on its own.

    Of the last steps that combination is taken whose linear prediction of the residual is least.

    Args:
        residual: of a source, (C, N) to (C, N).
        source: (C, N) to begin with.
        depth: steps that are mixed.

    Returns:
        (C, N) after each pass.
    """
    steps: list[Array] = []
    changes: list[Array] = []
    before: tuple[Array, Array] | None = None
    while True:
        found = residual(source)
        if before is not None:
            steps = [*steps, source - before[0]][-depth:]
            changes = [*changes, found - before[1]][-depth:]
        before = source, found
        source = source + found
        for c in range(len(source)):
            columns = np.array([change[c] for change in changes], np.float64).T
            if not columns.size or not columns.any():
                continue
            factors = np.linalg.lstsq(columns, found[c].astype(np.float64), rcond=None)[0]
            for factor, step, change in zip(factors, steps, changes, strict=True):
                source[c] -= source.dtype.type(factor) * (step[c] + change[c])
        yield source


def _worst(values: Array) -> float:
    """RMS over cells of the worst component."""
    return float(np.sqrt(np.mean(values.astype(np.float64) ** 2, axis=1)).max())


def _iterations(single: _Equation) -> dict[str, Iterator[Array]]:
    return {
        "Lambda": lambda_iteration(single.plain, single.guess),
        "Lambda, diagonal": lambda_iteration(single.diagonal, single.guess),
        f"Anderson({DEPTH})": anderson(single.plain, single.guess),
        f"Anderson({DEPTH}), diagonal": anderson(single.diagonal, single.guess),
    }


def _iterated(
    medium: Medium, method: str, sources: Iterator[Array], single: _Equation, truth: Array
) -> Row:
    """Iterates until the true error is what is wanted: no solver ends sooner."""
    core_s, least, iterations = 0.0, np.inf, 0
    before = single.iterations
    stopped = f"{MOST} passes"
    source = single.guess
    for _ in range(MOST):
        source, cost = clocked(single.case.device, lambda: next(sources))
        core_s += cost.core_s
        least = min(least, error := _worst(source - truth))
        if error <= WANTED:
            stopped = "error reached"
            break
        if not error < 1e3:
            stopped = "diverges"
            break
    iterations = single.iterations - before
    residual_rms = _worst(single.diagonal(source))
    return Row(
        medium.name, method, iterations, core_s, residual_rms, _worst(source - truth), stopped
    )


def _gmres(medium: Medium, single: _Equation, double: Callable[[], _Equation], truth: Array) -> Row:
    """Solves to GMRES's own estimate, as runs do; where single precision ends, in double."""
    before = single.iterations
    spent = 0.0

    def attempt(equation: _Equation) -> tuple[Any, Cost]:
        def work() -> Any:
            try:
                return gmres(equation.sweeper, equation.guess, equation.rays, tolerance=WANTED)
            except NotConvergedError as error:
                return error

        return clocked(equation.case.device, work)

    found, cost = attempt(single)
    spent, iterations, stopped = cost.core_s, single.iterations - before, "own estimate"
    if isinstance(found, NotConvergedError):
        again = double()
        before = again.iterations
        found, cost = attempt(again)
        spent += cost.core_s
        stopped = f"own estimate, in double precision after {iterations} passes in single"
        iterations += again.iterations - before
        if isinstance(found, NotConvergedError):
            return Row(medium.name, "GMRES", iterations, spent, np.nan, np.nan, str(found))
    return Row(
        medium.name,
        "GMRES",
        iterations,
        spent,
        found.residual_rms,
        _worst(found.source - truth),
        stopped,
    )


def compare(case: Case, media: tuple[Medium, ...] = MEDIA, *, say: Say) -> list[Row]:
    """Runs every solver on every medium.

    Args:
        case: with the scene.
        media: to be tried.
        say: takes lines of progress.

    Returns:
        A row for each pair.
    """
    rows: list[Row] = []
    for medium in media:
        some = replace(case, medium=replace(case.medium, trees=[medium.of(case.tree)], paper=None))
        exact = _Equation.of(some, double=True)
        try:
            truth = gmres(exact.sweeper, exact.guess, exact.rays, tolerance=EXACT).source
        except NotConvergedError as error:
            say(f"{medium.name}: no reference: {error}")
            raise
        say(f"{medium.name}: reference after {exact.iterations} passes")
        single = _Equation.of(some, double=False)
        single.diagonal(single.guess)  # builds
        for method, sources in _iterations(single).items():
            rows.append(_iterated(medium, method, sources, single, truth))
            say(_line(rows[-1]))
        rows.append(_gmres(medium, single, lambda exact=exact: exact, truth))  # type: ignore[misc]
        say(_line(rows[-1]))
    return rows


def _line(row: Row) -> str:
    return (
        f"{row.medium}: {row.method}: {row.iterations} passes, {row.core_s:.3g} core-s, error "
        f"{row.error:.1e} ({row.stopped})"
    )


def solver(case: Case, *, say: Say) -> Part:
    """Solvers on the scene of `case` at half its resolution, and on its droplets made stiff.

    `say` takes lines of progress.
    """
    rows = compare(case, say=say)
    head = (
        "medium", "solver", "passes", "core-s", "residual", "true error of the source", "ended by",
    )  # fmt: skip
    lines = [
        (
            row.medium,
            row.method,
            str(row.iterations),
            number(row.core_s),
            f"{row.residual_rms:.1e}",
            f"{row.error:.1e}",
            row.stopped,
        )
        for row in rows
    ]
    count = OpticalCells.of(case.tree).address.size
    return Part(
        name="solver",
        title=f"Solving for the scattered source: {case.scene.name} at half its resolution",
        tables=(Table.of(head, lines),),
        data=[asdict(row) for row in rows],
        text=(
            f"{count} scattering cells, {DIRECTIONS} directions; a pass sweeps all of them once. "
            "Stiff media are the scene's droplets alone. Errors are RMS over cells, of the worst "
            f"of the light's parts, against GMRES in double precision to {EXACT:g} with the same "
            "rays; residuals are those that are divided by what a cell keeps of its own light. "
            f"All but GMRES end as soon as their true error is {WANTED:g}, which no run could "
            f"know, or after {MOST} passes; GMRES ends by its own estimate, from the residual and "
            "the smallest singular value that it met, which takes a pass to confirm. "
            "Where it stalls in single precision, it goes on in double, and says so.",
        ),
    )
