"""Moment source: the solver's source with further moments (stage 2 of `trace_source`).

The solver has one isotropic source in each cell. Without a phase function and in thin cells, the
final sweeps use it unchanged. Otherwise a few discrete ordinates sweeps add moments.

With a phase function the final sweeps use the delta-M method: the share f of the scattering, the
third moment of the phase function, counts as unscattered; the rest has a first and a second moment
(Joseph, Wiscombe and Weinman, J. Atmos. Sci. 33, 1976; Wiscombe, ibid. 34, 1977). Angular moments
of the radiance come from sweeps of the solution and of the light scattered once more.

In thick cells the source is linear in space: sweeps also accumulate the first spatial moments of
I - S (linear discontinuous, iterated from sweep to sweep: Larsen and Morel, J. Comput. Phys. 83,
1989).
"""

from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.program import Program
from cldit.transport.angular_moments import phase_coefficients
from cldit.transport.cell_phases import phase_moments
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.iteration import Moments, SolvedSource
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.sweep import Sweeper


@dataclass(frozen=True)
class FinalSource:
    """Input of the final sweeps.

    sweeper: of these sweeps, with the source.
    medium, source: the swept cells, and their source, the sweeper's present one.
    solution, defect: of the solver's medium, as in `SolvedSource`; the defect is (N,).
    programs: built so far.
    sweeps: ordinates that another sweeper has swept.
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
    """Source with all moments of the final sweeps, from the solver's isotropic source.

    `rng` rotates the quadratures and shifts the rays.
    """
    light = solved.light
    if light is None:
        assert solved.sweeper is not None
        solved.sweeper.set_source(solved.solution.source, shining=True)
        source = Moments(solved.sweeper.source, None)
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
    times = 1 if order is None else order - 1
    if times:
        program = problem.moment_program()
        programs = (*programs, program)
        for _ in range(times):
            source = _scattered(problem, sweeper, light)
            gradient = sweeper.moments(
                program,
                problem.ordinates(sweeper, problem.moment_ordinates, rng),
                out=light.angular,
                room=solved.scratch,
                since=source.gradient,
            )
            light = replace(light, gradient=gradient)
    source = _scattered(problem, sweeper, light)
    return FinalSource(
        sweeper, medium, source, solved.solution, solved.defect, programs, solved.sweeps
    )


def _scattered(problem: SweepProblem, sweeper: Sweeper, light: Moments) -> Moments:
    """Source of this radiance, scattered by a phase function of three Legendre moments.

    It is the sweeper's present one.
    """
    ratios = None
    if problem.settings.phase is not None:
        moments = phase_moments(problem.medium, problem.settings.phase, 3)
        forward = problem.forward_fraction
        _, moment_1, moment_2 = (moments - forward) / (1.0 - forward)
        ratios = phase_coefficients(moment_1, moment_2)
    return Moments(sweeper.source, sweeper.scatter(light.angular, light.gradient, ratios))
