"""Source iteration to a residual: the solution of S = a Lambda S + E (stage 1 of `trace_source`).

GMRES solves along few ordinates; one sweep along more gives the residual of that solution, and a
defect correction removes it (gmres.py). With a phase function the solver scatters isotropically,
with the transport correction: scattering x (1 - g) (Modest, Radiative Heat Transfer, ch. 12).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.buffers import zeros
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS
from cldit.transport.cell_phases import phase_moments
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gmres import (
    Report,
    Solution,
    defect_correction,
    gmres,
    next_order,
    order_0,
)
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.sweep import Sweeper


@dataclass(frozen=True)
class Moments:
    """Moments of radiance or of a source in the scattering cells, on the device.

    angular: list (M, C, N): the mean; with a phase function, all moments of angular_moments.py.
    gradient: (3, C, K) spatial gradient along x, y, z in the K linear cells, per cell; None: K = 0.
    """

    angular: Any
    gradient: Any


@dataclass(frozen=True)
class SolvedSource:
    """Source of the solver, and data of the solver that later stages reuse.

    light: radiance of the solution; None if the final sweeps use the solution itself.
    defect: (N,) error of sweeps and solver in a cavity of radiance 1.
    sweeper: None if the final sweeps need another, which takes as much memory.
    sweeps: ordinates swept by a sweeper that was released.
    scratch: device buffers for moments, see `Sweeper.room`.
    """

    solution: Solution
    light: Moments | None
    defect: Floats
    programs: tuple[Program, ...]
    sweeper: Sweeper | None
    sweeps: int = 0
    scratch: tuple[Any, ...] = ()


def iterate_source(
    problem: SweepProblem, rng: np.random.Generator, report: Report | None
) -> SolvedSource:
    """Solves for the source of every scattering cell to the tolerance of the settings.

    `rng` rotates the quadratures and shifts the rays; raises as `gmres`.
    """
    return (_constant if problem.isotropic else _moments)(problem, rng, report)


def _constant(
    problem: SweepProblem, rng: np.random.Generator, report: Report | None
) -> SolvedSource:
    """Constant isotropic source of each cell, in the original medium."""
    settings = problem.settings
    plain = problem.program(problem.solver_defines)
    sweeper = problem.sweeper(problem.medium, plain)
    if settings.order is None:
        solution, ordinates_of_solver = _coarse(problem, sweeper, rng, report)
        sweeper.set_source(solution.source, shining=True)
        sweeper.sweep(problem.ordinates(sweeper, problem.half, rng), shining=True)
        solution = defect_correction(
            sweeper, solution, ordinates_of_solver, tolerance=settings.tolerance, report=report
        )
    else:
        solution = _of_order(problem, sweeper, rng, settings.order - 1)
    solution, defect = _checked(problem, sweeper, solution)
    return SolvedSource(solution, None, defect, (plain,), sweeper)


def _moments(
    problem: SweepProblem, rng: np.random.Generator, report: Report | None
) -> SolvedSource:
    """Solution in transport-corrected cells, and the moments of its radiance."""
    settings, phase = problem.settings, problem.settings.phase
    plain = problem.program(problem.solver_defines)
    all_orders = settings.order is None
    turned: float | Floats = 0.0
    if all_orders and phase is not None:
        turned = phase_moments(problem.medium, phase, 2)[1]
    # Without a phase function all sweeps are of one medium and share a sweeper.
    serves = phase is None and "LINEAR_SOURCE" not in problem.solver_defines
    sweeper = problem.sweeper(
        problem.scattering_scaled(1.0 - turned), plain, problem.linear_cells if serves else None
    )
    programs = [plain]
    light, gradient = sweeper.unset_light(1 if phase is None else MOMENTS), None
    scratch: tuple[Any, ...] = ()
    if phase is not None and settings.order != 1:
        scratch = sweeper.room(MOMENTS)
    if all_orders:
        solution, ordinates_of_solver = _coarse(problem, sweeper, rng, report)
        if phase is not None:
            programs.append(problem.program({**problem.solver_defines, "ANGULAR_MOMENTS": 1}))
        sweeper.set_source(solution.source, shining=True)
        ordinates = problem.ordinates(sweeper, settings.directions, rng)
        sweeper.moments(programs[-1], ordinates, out=light, room=scratch)
        solution = defect_correction(
            sweeper,
            solution,
            ordinates_of_solver,
            tolerance=settings.tolerance,
            report=report,
            listed=scratch[1] if scratch else None,
            light=light,
        )
    else:
        solution = _of_order(problem, sweeper, rng, 0)
        walled = np.zeros((1 if phase is None else MOMENTS, sweeper.components, sweeper.count))
        walled[0, 1] = 1.0  # isotropic, from the wall
        light = sweeper.listed(walled)
    if problem.linear_cells is not None:
        count = 3 * sweeper.components * int(np.count_nonzero(problem.linear_cells))
        gradient = zeros(problem.device, "spatial gradient", count, sweeper.real)
        if sweeper.gradients is not None:
            changes = sweeper.gradients(sweeper.read(light))[:, :, problem.linear_cells]
            gradient = sweeper.listed(changes)
    solution, defect = _checked(problem, sweeper, solution, scattered=True)
    return SolvedSource(
        solution=solution,
        light=Moments(light, gradient),
        defect=defect,
        programs=tuple(programs),
        sweeper=sweeper if serves else None,
        sweeps=0 if serves else sweeper.sweeps,
        scratch=scratch,
    )


def _coarse(
    problem: SweepProblem, sweeper: Sweeper, rng: np.random.Generator, report: Report | None
) -> tuple[Solution, DeviceOrdinates]:
    """Solution along few ordinates, to be corrected, and these ordinates."""
    ordinates_of_solver = problem.solver_ordinates(sweeper, rng)
    guess = order_0(sweeper, sweeper.albedo)
    settings = problem.settings
    tolerance = max(settings.tuning.solver_rough, settings.tolerance)
    return gmres(
        sweeper, guess, ordinates_of_solver, tolerance=tolerance, report=report, confirmed=False
    ), ordinates_of_solver


def _of_order(
    problem: SweepProblem, sweeper: Sweeper, rng: np.random.Generator, times: int
) -> Solution:
    """Solution of a fixed order: scattered `times`, each along half of the final ordinates."""
    source = sweeper.listed(order_0(sweeper, sweeper.albedo))
    for _ in range(times):
        source = next_order(sweeper, source, problem.ordinates(sweeper, problem.half, rng))
    return Solution(source, problem.settings.order or 0, 0.0)


def _checked(
    problem: SweepProblem, sweeper: Sweeper, solution: Solution, *, scattered: bool = False
) -> tuple[Solution, Floats]:
    """Solution, and error (N,) of sweeps and solver in a cavity of radiance 1.

    The error includes the residual, with `scattered` after one more scattering, which is removed
    from the solution.
    """
    count = problem.settings.tuning.defect_ordinates
    rng = np.random.default_rng([problem.settings.seed, 2])  # independent of all other ordinates
    rays = problem.ordinates(sweeper, count, rng)
    defect = sweeper.defect(solution.source, rays, solution.residual, scattered=scattered)
    return replace(solution, residual=None), defect
