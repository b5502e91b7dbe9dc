"""Final sweeps: the source function of every scattering cell to the camera (stage 3).

The final sweeps of `trace_source` compute the mean radiance of each cell, weighted by the phase
function for scattering to the camera. They also store the radiance on the interfaces of the thick
region, where path segments of the final gather end. The ordinates form two halves; the difference
of the two estimates measures the quadrature error.
"""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.program import Program
from cldit.transport.cell_phases import class_weights
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.moment_source import FinalSource
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.final_gather.cell_sources import CellSources, records
from cldit.transport.phase import PHASE_STEPS


@dataclass(frozen=True)
class CameraSource:
    """Sources of the scattering cells to the camera, in the unit of `OpticalCells.emitted`.

    halves: two estimates (C, N), each from half of the final ordinates.
    known: (K,) linear cells and the spatial gradient (3, C, K) of the radiance in them, along x, y,
        z, per cell, which precedes that from neighbours; None: in no cell.
    defect: (N,) error of the sweeps in a cavity of radiance 1.
    cell_sources: sources and radiance for the final gather; None if no cell is thick.
    """

    halves: tuple[Reals, Reals]
    known: tuple[Ints, Reals] | None
    solution: Solution
    defect: Floats
    cell_sources: CellSources | None
    programs: tuple[Program, ...]
    counts: dict[str, int]


def order_0_source(medium: OpticalCells, real: type[np.floating]) -> CameraSource:
    """Source of order 0 in `medium` (paper, "Ray Tracing"): all scattered light is the wall's."""
    source = medium.thermal_source()
    source[1] += medium.albedo
    camera = source.astype(real)
    return CameraSource(
        halves=(camera, camera),
        known=None,
        solution=Solution(camera, 0, 0.0),
        defect=np.zeros(len(medium.address)),
        cell_sources=None,
        programs=(),
        counts=_counts(medium, 0),
    )


def final_sweeps(problem: SweepProblem, final: FinalSource) -> CameraSource:
    """Sweeps the final ordinates of `problem` and scatters the radiance to the camera."""
    settings, medium, sweeper = problem.settings, problem.medium, final.sweeper
    region, program = problem.region, problem.final_program
    rng = np.random.default_rng([settings.seed, 1])  # the same for all orders, to compare them
    sets = problem.camera_ordinates(sweeper, rng)
    interfaces = None
    if region is not None:
        interfaces = InterfaceRadiance.of(
            problem.device,
            region,
            sweeper.box,
            components=sweeper.ray_planes,
            directions=2 * problem.half,
            real=sweeper.real,
        )
    camera = _camera_sweep(problem, final)
    light = np.zeros((sweeper.components, sweeper.count), sweeper.real)
    thermal = medium.thermal_source()
    halves: list[Reals] = []
    gradients: list[Reals] = []
    for number, ordinates in enumerate(sets):
        stored = None if interfaces is None else interfaces.after(number * problem.half)
        radiance, gradient = _swept(problem, final, camera, ordinates, stored)
        mean = radiance.reshape(light.shape).astype(np.float64)
        gradients += [] if gradient is None else [gradient]
        halves.append((thermal + medium.albedo * mean).astype(sweeper.real))
        light += (mean / 2).astype(sweeper.real)
    gradient = np.mean(gradients, axis=0) if gradients else None
    if gradient is not None and final.source.gradient is not None:
        gradient += sweeper.read_gradient(final.source.gradient)
    cell_sources = None
    if region is not None and interfaces is not None:
        joined = Ordinates.joined([ordinates.directions for ordinates in sets])
        record = records(problem, region, final, light=light, gradient=gradient)
        cell_sources = CellSources(joined, interfaces, program, record)
    return CameraSource(
        halves=(halves[0], halves[1]),
        known=None if gradient is None else (sweeper.linear_cells, gradient),
        solution=final.solution,
        defect=final.defect,
        cell_sources=cell_sources,
        programs=(problem.update, *final.programs, program),
        counts=_counts(medium, final.sweeps + sweeper.sweeps),
    )


def _camera_sweep(problem: SweepProblem, final: FinalSource) -> CameraSweep | None:
    """Weights of ordinates for scattering to the camera; None: quadrature weights alone."""
    if "CAMERA_SWEEP" not in problem.final_program.defines:
        return None
    phase = problem.settings.phase
    tables = [] if phase is None else [table.by_half_sine(PHASE_STEPS) for table in phase.tables]
    weights = None if phase is None else class_weights(problem.medium, phase)
    return CameraSweep.of(
        final.sweeper.boxes,
        problem.final_program,
        problem.medium,
        phase=np.concatenate(tables) if tables else np.zeros(1),
        place=problem.view.camera,
        classes=weights,
    )


def _swept(
    problem: SweepProblem,
    final: FinalSource,
    camera: CameraSweep | None,
    ordinates: DeviceOrdinates,
    interfaces: InterfaceRadiance | None,
) -> tuple[Reals, Reals | None]:
    """Mean radiance (C, N) with the camera's weights, and gradient (3, C, K) of I - S."""
    sweeper = final.sweeper
    if camera is not None:
        blurred = problem.blurred(sweeper, ordinates.directions)
        return sweeper.view_weighted_mean(camera, ordinates, interfaces, blurred)
    mean = sweeper.unset_light(1)
    gradient = sweeper.moments(problem.final_program, ordinates, out=mean, interfaces=interfaces)
    changes = None if gradient is None else sweeper.read_gradient(gradient)
    return sweeper.read(mean), changes


def _counts(medium: OpticalCells, sweeps: int) -> dict[str, int]:
    return {
        "swept_cells": medium.box().cells,
        "scattering_cells": len(medium.address),
        "sweeps": sweeps,
    }
