"""The light that droplets scatter to the camera: solved for by sweeps, then swept once more for it.

The last sweeps find what the camera sees of the light in each cell, and keep what flights from
thick cells end in. What cells scatter to the camera goes by the phase function itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.discrete_ordinates.gradients import spatial_gradients
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.moment_source import (
    FinalSource,
    isotropic_source,
    moment_source,
)
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.final_gather.cell_sources import CellSources, records
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.result import Settings
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import View

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CameraSource:
    """halves: two estimates (C, N) of what the cells send to the camera, each of half of the last
    directions. across (3, C, N): how that changes across cells, where settings
    want it. defect (N,): what the sweeps make or lose of a cavity's radiance of 1.
    """

    halves: tuple[NDArray[np.floating], NDArray[np.floating]]
    across: NDArray[np.floating] | None
    solution: Solution
    defect: Floats
    ends: CellSources | None
    programs: tuple[Program, ...]
    counts: dict[str, int]


def camera_source(
    seen: OpticalCells,
    thick: ThickRegion | None,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    defines: Mapping[str, Define],
    report: Callable[[str], None] | None,
) -> CameraSource:
    """seen: cells with all of their scattering; thick: whose light flights are to find."""
    if settings.order == 0:
        return _of_order_0(seen, "USE_FLOAT64" in defines)
    work = SweepProblem.of(seen, scene, view, device, settings, defines)
    towards = work.towards(thick)
    rng = np.random.default_rng(settings.seed)
    if settings.phase is None and work.linear_cells is None:
        last = isotropic_source(work, rng, report)
    else:
        last = moment_source(work, towards, rng, report)
    swept = _final_sweeps(work, towards, last, thick)
    solution = replace(last.solution, towards=np.mean(swept.halves, axis=0))
    defect, programs = last.defect, (work.iterate, *last.programs, towards)
    sweeps = last.earlier + last.sweeper.sweeps
    del last  # with what the sweeper has on the device
    across: NDArray[np.floating] | None = None
    if settings.within_cells:
        across = spatial_gradients(swept.light, seen, seen.box(), swept.changes)
        across *= seen.albedo.astype(across.dtype)
    return CameraSource(
        halves=swept.halves,
        across=across,
        solution=solution,
        defect=defect,
        ends=swept.ends,
        programs=programs,
        counts={**_counts(seen), "sweeps": sweeps},
    )


def _of_order_0(seen: OpticalCells, double: bool) -> CameraSource:
    """Nothing is swept: whatever is scattered comes from the wall."""
    source: NDArray[np.floating] = seen.thermal_source()
    source[1] += seen.albedo
    source = source.astype(np.float64 if double else np.float32)
    return CameraSource(
        halves=(source, source),
        across=None,
        solution=Solution(source, 0, 0.0, 0.0),
        defect=np.zeros(len(seen.address)),
        ends=None,
        programs=(),
        counts={**_counts(seen), "sweeps": 0},
    )


def _counts(seen: OpticalCells) -> dict[str, int]:
    return {"swept_cells": seen.box().cells, "scattering_cells": len(seen.address)}


@dataclass(frozen=True)
class _FinalSweeps:
    """halves: as in `CameraSource`; light (C, N): what they found, as the camera sees it; changes:
    cells (M,) and how that changes across them (3, C, M), if they looked for it; ends: what they
    leave for flights."""

    halves: tuple[NDArray[np.floating], NDArray[np.floating]]
    light: NDArray[np.floating]
    changes: tuple[NDArray[np.intp], NDArray[np.floating]] | None
    ends: CellSources | None


def _final_sweeps(
    work: SweepProblem, program: Program, last: FinalSource, thick: ThickRegion | None
) -> _FinalSweeps:
    """The last sweeps, in two halves."""
    settings, seen, view, sweeper = work.settings, work.seen, work.view, last.sweeper
    rng = np.random.default_rng([settings.seed, 1])  # alike whatever the order, to compare orders
    half = work.half
    sets = work.to_camera(sweeper, rng)
    camera = kept = None
    if "CAMERA_SWEEP" in program.defines:
        table = np.zeros(1) if settings.phase is None else settings.phase.by_half_sine(PHASE_STEPS)
        place = view.middle[:3] - np.array([0.0, view.distance, 0.0])
        camera = sweeper.to_camera(program, seen, table, place)
    if thick is not None:
        kept = InterfaceRadiance.of(
            work.device,
            thick,
            sweeper.box,
            components=sweeper.components,
            directions=2 * half,
            real=sweeper.real,
        )
    halves: list[NDArray[np.floating]] = []
    changes: list[NDArray[np.floating]] = []
    light = np.zeros((sweeper.components, sweeper.count), sweeper.real)
    thermal = seen.thermal_source()
    for number, rays in enumerate(sets):
        interfaces = None if kept is None else kept.after(number * half)
        if camera is None:
            found = np.empty((1, *light.shape), sweeper.real)
            change = sweeper.moments(program, rays, out=found, interfaces=interfaces)
        else:
            found, change = sweeper.view_weighted_mean(camera, rays, interfaces)
        mean = found.reshape(light.shape).astype(np.float64)
        changes += [] if change is None else [change]
        halves.append((thermal + seen.albedo * mean).astype(sweeper.real))
        light += (mean / 2).astype(sweeper.real)
    across = np.mean(changes, axis=0) if changes else None
    if across is not None and last.source.changes is not None:
        across += last.source.changes
    known = None if across is None else (sweeper.linear_cells, across)
    ends = None
    if thick is not None and kept is not None:
        directions = Ordinates.joined([rays.directions for rays in sets])
        met = records(work, thick, last, light=light, changes=across)
        ends = CellSources(directions, kept, program, met)
    return _FinalSweeps((halves[0], halves[1]), light, known, ends)
