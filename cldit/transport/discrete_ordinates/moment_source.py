"""The source that the last sweeps start from: as the solver has it, or better.

Cells have one source each while that is solved for. Without a phase function, and where cells are
thin, the solution is all there is to know. Two things make more of it, by further sweeps:

With a phase function the solver's droplets scatter evenly what they turn on average (transport
correction: scattering x (1 - g)), which is right where light goes to and fro, and too little where
it is scattered once or twice. So the last sweeps are of another medium: of the phase function its
third moment f counts as no scattering at all, and the rest is even but for a first and a second
moment (delta-M: Joseph, Wiscombe, Weinman, J. Atmos. Sci. 33, 1976; Wiscombe, ibid. 34, 1977). The
mean and the moments of the light in each cell come from sweeps of the solution, and of what is
scattered in the other medium once more.

Across thick cells light changes. What it is times the place in the cell tells how much, and their
source is then linear in them (linear discontinuous, in one sweep after the other: Larsen and Morel,
J. Comput. Phys. 83, 1989).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS, phase_coefficients
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.gradients import limit
from cldit.transport.discrete_ordinates.problem import SweepProblem, after_one_scattering
from cldit.transport.discrete_ordinates.sweep import Sweeper

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FinalSource:
    """What the last sweeps start from.

    sweeper: that makes them; it holds the source. cells, source: the medium that they sweep, and
    what it sends, as they take it. solution, defect: of the solver's medium, as in `CameraSource`.
    earlier: sweeps, of another sweeper.
    """

    sweeper: Sweeper
    cells: OpticalCells
    source: Light
    solution: Solution
    defect: Floats
    programs: tuple[Program, ...]
    earlier: int = 0


def isotropic_source(
    work: SweepProblem,
    rng: np.random.Generator,
    report: Callable[[str], None] | None,
) -> FinalSource:
    """Without a phase function, and light even in cells: the solution, in the medium as it is."""
    plain = work.program(work.solver)
    sweeper = work.sweeper(work.seen, plain)
    if work.settings.order is None:
        solution, few = work.solution(sweeper, rng, report)
        sweeper.set_source(solution.source, shining=True)
        sweeper.sweep(work.rays(sweeper, work.half, rng), shining=True)
        solution, _ = work.defect_correction(sweeper, solution, few, report)
    else:
        solution = work.scattered(sweeper, rng, work.settings.order - 1)
    solution, defect = work.checked(sweeper, solution)
    sweeper.set_source(solution.source, shining=True)
    source = Light(solution.source, None)
    return FinalSource(sweeper, work.seen, source, solution, defect, (plain,))


@dataclass(frozen=True)
class Light:
    """moments (M, C, N): mean of the light in the cells; with a phase function all of moments.py.
    changes (3, C, K): across the cells `linear_cells`, if any."""

    moments: NDArray[np.floating]
    changes: NDArray[np.floating] | None


@dataclass(frozen=True)
class _Solved:
    """What is left of the solver; without its sweeper, as large as the last sweeps', unless that
    serves them too.

    albedo (N,), thermal (C, N): of the solver's cells; room: for moments, if there are any;
    sweeps: of a sweeper that is gone. The others as in `FinalSource`.
    """

    solution: Solution
    albedo: Floats
    thermal: NDArray[np.floating]
    defect: Floats
    programs: tuple[Program, ...]
    sweeps: int
    room: tuple[Any, ...]
    sweeper: Sweeper | None

    @classmethod
    def of(
        cls, work: SweepProblem, rng: np.random.Generator, report: Callable[[str], None] | None
    ) -> tuple[_Solved, Light]:
        """And the light that the solution makes."""
        settings, phase = work.settings, work.settings.phase
        plain = work.program(work.solver)
        every = settings.order is None
        even = phase.asymmetry if every and phase is not None else 0.0
        serves = (
            phase is None and "LINEAR_SOURCE" not in work.solver
        )  # all sweeps are of one medium
        sweeper = work.sweeper(work.cells(1.0 - even), plain, work.linear_cells if serves else None)
        programs = [plain]
        shape = (1 if phase is None else MOMENTS, sweeper.components, sweeper.count)
        light = np.zeros(shape, sweeper.real)
        changes = None
        room: tuple[Any, ...] = ()
        if phase is not None and settings.order != 1:
            room = sweeper.room(MOMENTS)
        if every:
            solution, few = work.solution(sweeper, rng, report)
            if phase is not None:
                programs.append(work.program({**work.solver, "ANGULAR_MOMENTS": 1}))
            sweeper.set_source(solution.source, shining=True)
            sweeper.moments(programs[-1], work.rays(sweeper, work.more, rng), out=light, room=room)
            listed = room[1] if room else None
            solution, more = work.defect_correction(sweeper, solution, few, report, listed=listed)
            light[0] += more
            solution = after_one_scattering(solution, solution.source, sweeper)
        else:
            solution = work.scattered(sweeper, rng, 0)
            light[0, 1] = 1.0  # as if it came from the wall, all round
        if work.linear_cells is not None:
            changes = np.zeros((3, shape[1], np.count_nonzero(work.linear_cells)), sweeper.real)
            if sweeper.gradients is not None:
                changes[:] = sweeper.gradients(light[0])[:, :, work.linear_cells]
        solution, defect = work.checked(sweeper, solution)
        solved = cls(
            solution=solution,
            albedo=sweeper.albedo,
            thermal=sweeper.thermal,
            defect=defect,
            programs=tuple(programs),
            sweeps=0 if serves else sweeper.sweeps,
            room=room,
            sweeper=sweeper if serves else None,
        )
        return solved, Light(light, changes)


def moment_source(
    work: SweepProblem,
    towards: Program,
    rng: np.random.Generator,
    report: Callable[[str], None] | None,
) -> FinalSource:
    """From a solution by one moment to a source by more; see the head of this file."""
    solved, light = _Solved.of(work, rng, report)
    solution, programs = solved.solution, solved.programs
    cells = work.cells(1.0 - work.forward)
    sweeper = solved.sweeper or work.sweeper(cells, towards, work.linear_cells)
    order = work.settings.order
    times, count = (
        (work.passes, work.most // work.passes) if order is None else (order - 1, work.most)
    )
    if times:
        again = work.finding()
        programs = (*programs, again)
        for _ in range(times):
            source = _source(work, sweeper, light)
            sweeper.set_source(source.moments, shining=True, changes=source.changes)
            rays = work.rays(sweeper, count, rng)
            more = sweeper.moments(again, rays, out=light.moments, room=solved.room)
            if more is not None and source.changes is not None:
                light = replace(light, changes=source.changes + more)
    source_there = solved.albedo * light.moments[0] + solved.thermal
    solution = replace(solution, source=source_there.astype(sweeper.real))
    source = _source(work, sweeper, light)
    sweeper.set_source(source.moments, shining=True, changes=source.changes)
    return FinalSource(sweeper, cells, source, solution, solved.defect, programs, solved.sweeps)


def limited(
    sweeper: Sweeper, changes: NDArray[np.floating], source: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Changes (3, C, K) of the source, of those of the light, across the cells `linear_cells`;
    source:
    (C or more, N)."""
    some = sweeper.linear_cells
    sent = sweeper.albedo.astype(changes.dtype)[some] * changes
    limit(sent, source[: sweeper.components, some])
    return np.asarray(sent)


def _source(work: SweepProblem, sweeper: Sweeper, light: Light) -> Light:
    """Source of a sweeper's cells that scatter this light by a phase function of three moments;
    moments: (M C, N), as sweeps take it."""
    albedo = sweeper.albedo.astype(light.moments.dtype)
    source = albedo * light.moments
    source[0] += sweeper.thermal
    if work.settings.phase is not None:
        moments = work.settings.phase.moments(3)
        _, first, second = (moments - work.forward) / (1.0 - work.forward)
        counts = phase_coefficients(float(first), float(second)).astype(source.dtype)
        source[1:] *= counts[:, None, None]
    changes = None
    if light.changes is not None:
        changes = limited(sweeper, light.changes, source[0])
    return Light(np.asarray(source.reshape(-1, sweeper.count)), changes)
