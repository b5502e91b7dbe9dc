"""The light that droplets scatter to the camera: solved for by sweeps, then swept once more for it.

Cells have one source each while that is solved for. Without a phase function the solution is all
there is to know. With one, the solver's droplets scatter evenly what they turn on average
(transport correction: scattering x (1 - g)), which is right where light goes to and fro, and too
little where it is scattered once or twice. So the last sweeps are of another medium: of the phase
function its second moment f counts as no scattering at all, and the rest is even but for a first
moment (delta-M: Joseph, Wiscombe, Weinman, J. Atmos. Sci. 33, 1976; Wiscombe, ibid. 34, 1977). The
mean and the first moment of the light in each cell come from sweeps of the solution, and of what
is scattered in the other medium a few times more. What cells then scatter to the camera goes by the
phase function itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.directions import Directions, about_camera, for_boundary
from cldit.transport.gradients import Gradients, across_cells, matter
from cldit.transport.phase import PHASE_STEPS, ScatteringTable
from cldit.transport.result import Settings
from cldit.transport.solve import Solution, another_order, first_guess, solve
from cldit.transport.sweep import Rays, Sweeper, sweep_defines
from cldit.transport.thick import Ends, RimLight, ThickCells
from cldit.transport.view import View

Floats = NDArray[np.float64]

_SCATTERINGS = 3  # by two moments, after the solution by one: slabs of depth 1 need them
_CHECKED = 8  # directions on which the sweeps are checked for what they make or lose


@dataclass(frozen=True)
class Scattered:
    """halves: two independent estimates (C, N) of what the cells send to the camera, each of half
    of the last directions. across (3, C, N): how that changes across cells, where settings
    want it. defect (N,): what the sweeps make or lose of a cavity's radiance of 1.
    """

    halves: tuple[NDArray[np.floating], NDArray[np.floating]]
    across: NDArray[np.floating] | None
    solution: Solution
    defect: Floats
    ends: Ends | None
    programs: tuple[Program, ...]
    counts: dict[str, int]


def scattered_light(
    seen: OpticalCells,
    thick: ThickCells | None,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    defines: Mapping[str, Define],
    report: Callable[[str], None] | None,
) -> Scattered:
    """seen: cells with all of their scattering; thick: whose light chains are to follow."""
    if settings.order == 0:
        return _of_order_0(seen, "USE_FLOAT64" in defines)
    evenly = 1.0 if settings.phase is None else 1.0 - settings.phase.asymmetry
    linear: dict[str, Define] = {"LINEAR": 1} if matter(seen, scattered=evenly) else {}
    work = _Work(
        seen,
        scene,
        view,
        device,
        settings,
        {**defines, **sweep_defines(device), **linear},
        build(device, "iterate.cl", defines),
    )
    towards = work.towards(thick)
    rng = np.random.default_rng(settings.seed)
    if settings.phase is None:
        last = _evenly(work, rng, report)
    else:
        last = _by_moments(work, settings.phase, towards, rng, report)
    halves, across, ends = _swept_to_camera(work, towards, last, thick)
    return Scattered(
        halves=halves,
        across=across,
        solution=replace(last.solution, towards=np.mean(halves, axis=0)),
        defect=last.defect,
        ends=ends,
        programs=(work.iterate, *last.programs, towards),
        counts={**_counts(seen), "sweeps": last.earlier + last.sweeper.sweeps},
    )


def _of_order_0(seen: OpticalCells, double: bool) -> Scattered:
    """Nothing is swept: whatever is scattered comes from the wall."""
    source: NDArray[np.floating] = seen.thermal_source()
    source[1] += seen.albedo
    source = source.astype(np.float64 if double else np.float32)
    return Scattered(
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
class _Last:
    """What the last sweeps start from.

    sweeper: that makes them; it holds the source. solution, defect: of the solver's medium, as in
    `Scattered`; gradients: how its source changes across cells. earlier: sweeps, of another
    sweeper.
    """

    sweeper: Sweeper
    solution: Solution
    defect: Floats
    gradients: Gradients | None
    programs: tuple[Program, ...]
    earlier: int = 0


def _evenly(work: _Work, rng: np.random.Generator, report: Callable[[str], None] | None) -> _Last:
    """Without a phase function: the solution, in the medium as it is."""
    plain = work.program({})
    sweeper = work.sweeper(work.seen, plain)
    # The solver's few directions are forgotten, but for what is scattered twice more.
    solution = work.solution(sweeper, rng, report, more=1)
    solution, defect = work.checked(sweeper, solution)
    sweeper.set_source(solution.source, shining=True)
    return _Last(sweeper, solution, defect, sweeper.gradients, (plain,))


@dataclass(frozen=True)
class _Solved:
    """What is left of the solver, without its sweeper and cells: as large as the last sweeps'.

    albedo (N,), thermal (C, N): of the solver's cells. The others as in `_Last`.
    """

    solution: Solution
    albedo: Floats
    thermal: NDArray[np.floating]
    defect: Floats
    gradients: Gradients | None
    programs: tuple[Program, ...]
    sweeps: int

    @classmethod
    def of(
        cls,
        work: _Work,
        asymmetry: float,
        rng: np.random.Generator,
        report: Callable[[str], None] | None,
    ) -> tuple[_Solved, NDArray[np.floating]]:
        """And (4, C, N) the mean, and the first moment, of the light in the cells."""
        plain = work.program({})
        sweeper = work.sweeper(work.cells(1.0 - asymmetry), plain)
        solution = work.solution(sweeper, rng, report, more=0)
        programs = [plain]
        light = np.zeros((4, sweeper.components, sweeper.count), sweeper.real)
        light[0, 1] = 1.0  # order 1: as if it came from the wall, all round
        if work.settings.order != 1:
            programs.append(work.program({"FLUX": 1}))
            sweeper.set_source(solution.source, shining=True)
            sweeper.moments(programs[-1], work.rays(sweeper, work.few, rng), out=light)
            solution = _one_more(solution, solution.source, sweeper)
        solution, defect = work.checked(sweeper, solution)
        done = cls(
            solution,
            sweeper.albedo,
            sweeper.thermal,
            defect,
            sweeper.gradients,
            tuple(programs),
            sweeper.sweeps,
        )
        return done, light


def _by_moments(
    work: _Work,
    phase: ScatteringTable,
    towards: Program,
    rng: np.random.Generator,
    report: Callable[[str], None] | None,
) -> _Last:
    """From a solution by one moment to a source by two; see the head of this file."""
    solved, light = _Solved.of(work, phase.asymmetry, rng, report)
    solution, programs = solved.solution, solved.programs
    sweeper = work.sweeper(work.cells(1.0 - phase.forward), towards)
    if work.settings.order is None:
        again = work.program({"FLUX": 1, "SLOPED": 1})
        programs = (*programs, again)
        for count in (*[work.few] * (_SCATTERINGS - 1), work.half // 2):
            sweeper.set_source(_sloped(sweeper, light, phase), shining=True)
            sweeper.moments(again, work.rays(sweeper, count, rng), out=light)
    sweeper.set_source(_sloped(sweeper, light, phase), shining=True)
    if work.settings.order != 1:
        solution = replace(solution, source=solved.albedo * light[0] + solved.thermal)
    return _Last(sweeper, solution, solved.defect, solved.gradients, programs, solved.sweeps)


def _swept_to_camera(
    work: _Work, program: Program, last: _Last, thick: ThickCells | None
) -> tuple[
    tuple[NDArray[np.floating], NDArray[np.floating]], NDArray[np.floating] | None, Ends | None
]:
    """Both halves of the last sweeps, (C, N) each, their change across cells, (3, C, N), and what
    they leave for chains."""
    settings, seen, view, sweeper = work.settings, work.seen, work.view, last.sweeper
    rng = np.random.default_rng([settings.seed, 1])  # alike whatever the order, to compare orders
    half = work.half
    sets = [work.to_camera(sweeper, half, rng) for _ in range(2)]
    table = np.zeros(1) if settings.phase is None else settings.phase.by_half_sine(PHASE_STEPS)
    place = view.middle[:3] - np.array([0.0, view.distance, 0.0])
    camera = sweeper.to_camera(program, seen, table, place)
    ends = None
    if thick is not None:
        ends = Ends(
            Directions.joined([rays.directions for rays in sets]),
            RimLight.of(
                work.device,
                thick,
                sweeper.box,
                components=sweeper.components,
                directions=2 * half,
                real=sweeper.real,
            ),
            last.solution.source,
            () if last.gradients is None else tuple(last.gradients(last.solution.source)),
        )
    halves: list[NDArray[np.floating]] = []
    light = np.zeros((sweeper.components, sweeper.count), sweeper.real)
    thermal = seen.thermal_source()
    for number, rays in enumerate(sets):
        if ends is not None:
            camera = replace(camera, light=ends.light.after(number * half))
        sweeper.sweep(rays, shining=True, camera=camera)
        mean = sweeper.weighted_mean(camera).astype(np.float64)
        halves.append((thermal + seen.albedo * mean).astype(sweeper.real))
        light += (mean / 2).astype(sweeper.real)
    across: NDArray[np.floating] | None = None
    if settings.within_cells:
        across = across_cells(light, seen, sweeper.box)
        across *= seen.albedo.astype(sweeper.real)
    return (halves[0], halves[1]), across, ends


@dataclass(frozen=True)
class _Work:
    """One trace's media, programs and rays."""

    seen: OpticalCells
    scene: Scene
    view: View
    device: Device
    settings: Settings
    defines: Mapping[str, Define]
    iterate: Program

    def cells(self, scattered: float) -> OpticalCells:
        """The medium of which this share of the scattering counts."""
        cells = OpticalCells.of(
            self.seen.tree, patches=self.seen.needs.patches, scattered=scattered
        )
        return cells.in_units_of(self.seen)

    def program(self, flags: Mapping[str, Define]) -> Program:
        return build(self.device, "sweep.cl", {**self.defines, **flags})

    def towards(self, thick: ThickCells | None) -> Program:
        """The sweep to the camera."""
        flags: dict[str, Define] = {"TO_CAMERA": 1}
        if self.settings.phase is not None:
            flags.update(PHASE_STEPS=PHASE_STEPS, SLOPED=1)
        if thick is not None:
            flags["RIM"] = 1
        return self.program(flags)

    def sweeper(self, cells: OpticalCells, sweep: Program) -> Sweeper:
        return Sweeper(
            self.device, cells, sweep, self.iterate, disc=self.view.disc, patches=self.view.patches
        )

    @property
    def half(self) -> int:
        """Of the last directions."""
        return self.settings.final_directions // 2

    @property
    def few(self) -> int:
        """Directions of the sweeps between the solver's and the last."""
        return self.settings.directions if self.settings.order is None else self.half

    def solution(
        self,
        sweeper: Sweeper,
        rng: np.random.Generator,
        report: Callable[[str], None] | None,
        *,
        more: int,
    ) -> Solution:
        """In the sweeper's cells; of a fixed order but for the last scattering, or two of them.

        more: scatterings after the converged solution, each with half of the last directions; 0
        leaves out two of a fixed order.
        """
        settings = self.settings
        guess = first_guess(sweeper, sweeper.albedo)
        if settings.order is None:
            rays = self.rays(sweeper, settings.directions, rng)
            solution = solve(sweeper, guess, rays, tolerance=settings.tolerance, report=report)
        else:
            solution = Solution(guess, settings.order, 0.0, 0.0)
            more += settings.order - 2
        for _ in range(more):
            rays = self.rays(sweeper, self.half, rng)
            source = another_order(sweeper, solution.source, rays)
            solution = _one_more(solution, source, sweeper)
        return solution

    def checked(self, sweeper: Sweeper, solution: Solution) -> tuple[Solution, Floats]:
        """The solution, and what sweeps and solver make or lose of a cavity's radiance of 1 (N,),
        in which what it lacks has gone."""
        rng = np.random.default_rng([self.settings.seed, 2])  # no other directions depend on it
        defect = sweeper.defect(solution.source, self.rays(sweeper, _CHECKED, rng))
        if solution.lack is not None:
            defect -= solution.lack[: self.seen.needs.boundaries].sum(axis=0)
        return replace(solution, lack=None), defect

    def rays(self, sweeper: Sweeper, count: int, rng: np.random.Generator) -> Rays:
        """Directions over the sphere."""
        low = np.asarray(sweeper.box.low, float)
        directions = for_boundary(
            count,
            rng,
            low=low,
            high=low + sweeper.box.shape,
            disc_centre=self.view.disc[:3],
            disc_radius=float(self.view.disc[3]) ** 0.5,
            enclosure=self.scene.background.shape == "enclosure",
        )
        return sweeper.rays(directions.balanced(), rng.random((count, 2)))

    def to_camera(self, sweeper: Sweeper, count: int, rng: np.random.Generator) -> Rays:
        """Directions from which light is scattered to the camera."""
        phase = self.settings.phase
        if phase is None:
            return self.rays(sweeper, count, rng)
        return sweeper.rays(about_camera(count, rng, phase), rng.random((count, 2)))


def _one_more(solution: Solution, source: NDArray[np.floating], sweeper: Sweeper) -> Solution:
    """After one scattering more: the source, and what is left of what it lacked."""
    lack = None if solution.lack is None else solution.lack * sweeper.albedo
    return replace(solution, source=source, lack=lack)


def _sloped(sweeper: Sweeper, light: NDArray[Any], phase: ScatteringTable) -> NDArray[Any]:
    """Source (4 C, N) of a sweeper's cells that scatter by a phase function of two moments.

    light (4, C, N): mean, and first moment, of the light in them.
    """
    first = (phase.asymmetry - phase.forward) / (1.0 - phase.forward)
    source = sweeper.albedo.astype(light.dtype) * light
    source[0] += sweeper.thermal
    source[1:] *= light.dtype.type(3.0 * first)
    return np.asarray(source.reshape(-1, sweeper.count))
