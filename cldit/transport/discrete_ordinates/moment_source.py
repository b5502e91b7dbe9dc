"""The moment source: what the final sweeps start from, as the solver has it, or better.

Cells have one isotropic source each while that is solved for. Without a phase function, and where
cells are thin, the solution is all there is to know. Two things make more of it, by further sweeps:

With a phase function the final sweeps are of another medium: the share f of the scattering that is
the third moment of the phase function counts as none, and the rest has a first and a second moment
(delta-M: Joseph, Wiscombe, Weinman, J. Atmos. Sci. 33, 1976; Wiscombe, ibid. 34, 1977). Moments of
the light in each cell come from sweeps of the solution, and of what is scattered once more.

Across thick cells the source is linear in place: sweeps also accumulate the first spatial moments
of I - S (linear discontinuous, in one sweep after the other: Larsen and Morel, J. Comput. Phys. 83,
1989).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Program
from cldit.transport.angular_moments import phase_coefficients
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.gradients import limit
from cldit.transport.discrete_ordinates.iteration import Moments, SolvedSource
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.sweep import Sweeper

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FinalSource:
    """What the final sweeps start from.

    sweeper: of these sweeps; it holds the source. medium, source: what they sweep, and what that
    sends, as they take it. solution, defect: of the solver's medium, as in `SolvedSource`.
    sweeps: before, of another sweeper.
    """

    sweeper: Sweeper
    medium: OpticalCells
    source: Moments
    solution: Solution
    defect: Floats
    programs: tuple[Program, ...]
    sweeps: int = 0


def moment_source(
    problem: SweepProblem, solved: SolvedSource, rng: np.random.Generator
) -> FinalSource:
    """The source by as many moments as the final sweeps take, from the solver's by one."""
    light = solved.light
    if light is None:
        assert solved.sweeper is not None
        source = Moments(solved.solution.source, None)
        solved.sweeper.set_source(source.angular, shining=True)
        return FinalSource(
            solved.sweeper,
            problem.medium,
            source,
            solved.solution,
            solved.defect,
            solved.programs,
        )
    medium = problem.scattering_scaled(1.0 - problem.forward_fraction)
    sweeper = solved.sweeper or problem.sweeper(medium, problem.final_program, problem.linear_cells)
    programs, order = solved.programs, problem.settings.order
    times, count = problem.moment_sweeps, problem.moment_ordinates
    if order is None:
        count //= times
    else:
        times = order - 1
    if times:
        program = problem.moment_program()
        programs = (*programs, program)
        for _ in range(times):
            source = _scattered(problem, sweeper, light)
            sweeper.set_source(source.angular, shining=True, changes=source.gradient)
            ordinates = problem.ordinates(sweeper, count, rng)
            more = sweeper.moments(program, ordinates, out=light.angular, room=solved.scratch)
            if more is not None and source.gradient is not None:
                light = replace(light, gradient=source.gradient + more)
    isotropic = solved.albedo * light.angular[0] + solved.thermal
    solution = replace(solved.solution, source=isotropic.astype(sweeper.real))
    source = _scattered(problem, sweeper, light)
    sweeper.set_source(source.angular, shining=True, changes=source.gradient)
    return FinalSource(sweeper, medium, source, solution, solved.defect, programs, solved.sweeps)


def limited_gradient(
    sweeper: Sweeper, light: NDArray[np.floating], source: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Gradient (3, C, K) of the source across the sweeper's linear cells, from that of the light
    there, (3, C, K); source: (C or more, N)."""
    cells = sweeper.linear_cells
    sent = sweeper.albedo.astype(light.dtype)[cells] * light
    limit(sent, source[: sweeper.components, cells])
    return np.asarray(sent)


def _scattered(problem: SweepProblem, sweeper: Sweeper, light: Moments) -> Moments:
    """The source of a sweeper's cells in this light, by a phase function of three moments; angular:
    (M C, N), as sweeps take it."""
    albedo = sweeper.albedo.astype(light.angular.dtype)
    source = albedo * light.angular
    source[0] += sweeper.thermal
    if problem.settings.phase is not None:
        moments, forward = problem.settings.phase.moments(3), problem.forward_fraction
        _, first, second = (moments - forward) / (1.0 - forward)
        counts = phase_coefficients(float(first), float(second)).astype(source.dtype)
        source[1:] *= counts[:, None, None]
    gradient = None
    if light.gradient is not None:
        gradient = limited_gradient(sweeper, light.gradient, source[0])
    return Moments(np.asarray(source.reshape(-1, sweeper.count)), gradient)
