"""Final sweeps: what every scattering cell sends to the camera, and what the final gather needs.

The final sweeps find the light in each cell as the camera sees it, and keep the radiance on the
interfaces of thick cells, in which path segments of the final gather end. What cells scatter to the
camera goes by the phase function itself. The ordinates are in two halves: the difference of both
estimates tells how far they are from what more ordinates would give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Program
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.gradients import spatial_gradients
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.moment_source import FinalSource
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.final_gather.cell_sources import CellSources, records
from cldit.transport.phase import PHASE_STEPS

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]  # of the device's precision


@dataclass(frozen=True)
class CameraSource:
    """What the scattering cells send to the camera.

    halves: two estimates (C, N), each by half of the final ordinates. gradient (3, C, N): change
    along x, y, z across cells, where settings want it. defect (N,): what the sweeps make or lose of
    a cavity's radiance of 1. cell_sources: what path segments meet; None where no cell is thick.
    """

    halves: tuple[Reals, Reals]
    gradient: Reals | None
    solution: Solution
    defect: Floats
    cell_sources: CellSources | None
    programs: tuple[Program, ...]
    counts: dict[str, int]


def order_0_source(medium: OpticalCells, real: type[np.floating]) -> CameraSource:
    """Nothing is swept: whatever is scattered comes from the wall (paper, "Ray Tracing")."""
    source = medium.thermal_source()
    source[1] += medium.albedo
    sent = source.astype(real)
    return CameraSource(
        halves=(sent, sent),
        gradient=None,
        solution=Solution(sent, 0, 0.0, 0.0),
        defect=np.zeros(len(medium.address)),
        cell_sources=None,
        programs=(),
        counts=_counts(medium, 0),
    )


def final_sweeps(problem: SweepProblem, final: FinalSource) -> CameraSource:
    """Sweeps both halves of the final ordinates, and scatters what they find to the camera."""
    settings, medium, sweeper = problem.settings, problem.medium, final.sweeper
    region, program = problem.region, problem.final_program
    rng = np.random.default_rng([settings.seed, 1])  # alike whatever the order, to compare orders
    sets = problem.camera_ordinates(sweeper, rng)
    interfaces = None
    if region is not None:
        interfaces = InterfaceRadiance.of(
            problem.device,
            region,
            sweeper.box,
            components=sweeper.components,
            directions=2 * problem.half,
            real=sweeper.real,
        )
    camera = _camera_sweep(problem, final)
    light = np.zeros((sweeper.components, sweeper.count), sweeper.real)
    thermal = medium.thermal_source()
    halves: list[Reals] = []
    gradients: list[Reals] = []
    for number, ordinates in enumerate(sets):
        kept = None if interfaces is None else interfaces.after(number * problem.half)
        found, gradient = _swept(problem, final, camera, ordinates, kept)
        mean = found.reshape(light.shape).astype(np.float64)
        gradients += [] if gradient is None else [gradient]
        halves.append((thermal + medium.albedo * mean).astype(sweeper.real))
        light += (mean / 2).astype(sweeper.real)
    gradient = np.mean(gradients, axis=0) if gradients else None
    if gradient is not None and final.source.gradient is not None:
        gradient += final.source.gradient
    cell_sources = None
    if region is not None and interfaces is not None:
        joined = Ordinates.joined([ordinates.directions for ordinates in sets])
        met = records(problem, region, final, light=light, gradient=gradient)
        cell_sources = CellSources(joined, interfaces, program, met)
    return CameraSource(
        halves=(halves[0], halves[1]),
        gradient=_sent_gradient(problem, final, light, gradient),
        solution=replace(final.solution, towards=np.mean(halves, axis=0)),
        defect=final.defect,
        cell_sources=cell_sources,
        programs=(problem.update, *final.programs, program),
        counts=_counts(medium, final.sweeps + sweeper.sweeps),
    )


def _camera_sweep(problem: SweepProblem, final: FinalSource) -> CameraSweep | None:
    """What sweeps need that weight light by how it is scattered to the camera; None: all alike."""
    settings, view = problem.settings, problem.view
    if "CAMERA_SWEEP" not in problem.final_program.defines:
        return None
    table = np.zeros(1) if settings.phase is None else settings.phase.by_half_sine(PHASE_STEPS)
    place = view.middle[:3] - np.array([0.0, view.distance, 0.0])
    return final.sweeper.to_camera(problem.final_program, problem.medium, table, place)


def _swept(
    problem: SweepProblem,
    final: FinalSource,
    camera: CameraSweep | None,
    ordinates: DeviceOrdinates,
    interfaces: InterfaceRadiance | None,
) -> tuple[Reals, Reals | None]:
    """The light (C, N) that the camera sees in the cells, and its gradient (3, C, K) across the
    linear ones as far as the source's own does not tell it."""
    sweeper = final.sweeper
    if camera is not None:
        return sweeper.view_weighted_mean(camera, ordinates, interfaces)
    found = np.empty((1, sweeper.components, sweeper.count), sweeper.real)
    gradient = sweeper.moments(problem.final_program, ordinates, out=found, interfaces=interfaces)
    return found, gradient


def _sent_gradient(
    problem: SweepProblem, final: FinalSource, light: Reals, gradient: Reals | None
) -> Reals | None:
    """Gradient (3, C, N) of what cells send to the camera, of that of the light."""
    medium = problem.medium
    if not problem.settings.within_cells:
        return None
    known = None if gradient is None else (final.sweeper.linear_cells, gradient)
    sent = spatial_gradients(light, medium, medium.box(), known)
    sent *= medium.albedo.astype(sent.dtype)
    return sent


def _counts(medium: OpticalCells, sweeps: int) -> dict[str, int]:
    return {
        "swept_cells": medium.box().cells,
        "scattering_cells": len(medium.address),
        "sweeps": sweeps,
    }
