"""Source iteration: the source function of every scattering cell, then one ray a pixel.

The source is solved for by sweeping rays through the box of cells that the spray fills; one last
sweep with many directions, and the picture, follow. The last sweep is done in two independent
halves; from the difference of the two pictures the run knows how far it is from what more
directions would give.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.closure import Closure
from cldit.transport.directions import Directions, about_camera, for_boundary
from cldit.transport.gather import Gather
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.picture import Painter
from cldit.transport.result import Settings, Trace, weights_of
from cldit.transport.solve import Rays, Solution, another_order, first_guess, solve
from cldit.transport.sweep import Sweeper, sweep_defines
from cldit.transport.thick import RimLight, ThickCells
from cldit.transport.towards import ToCamera
from cldit.transport.view import View, check_boundary

Floats = NDArray[np.float64]

_CLOSED = 1e-3  # what single precision may lose in thick and nearly conservative media
_CHECKED = 8  # directions on which the sweeps are checked for what they make or lose


def trace_source(
    cells: OpticalCells,
    scene: Scene,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
) -> Trace:
    """Weights by source iteration, in the precision that `settings` gives (not `auto`).

    With a phase function the sweeps scatter isotropically what it turns on average (transport
    correction, scattering x (1 - g)); then one more sweep gathers, in every cell, what the phase
    function itself scatters towards the camera, and the picture is made with all of the scattering.
    """
    solved, phase = cells, settings.phase
    if phase is not None and cells.needs.scattering:
        solved = OpticalCells.of(
            cells.tree, patches=cells.needs.patches, scattered=1.0 - phase.asymmetry
        )
    view = View.of(scene, cells)
    defines: dict[str, Define] = {**cells.needs.defines, **view.defines}
    if settings.precision == "float64":
        defines["USE_FLOAT64"] = 1
    real = np.float64 if settings.precision == "float64" else np.float32
    thick = None
    if settings.gather and settings.order is None and cells.needs.scattering:
        thick = ThickCells.of(cells, cells.box(), deeper_than=settings.thick)
    painter = Painter.of(
        cells,
        view,
        scene,
        device,
        {**defines, "CUTOFF": float(settings.cutoff)},
        accuracy_K=settings.accuracy_K,
        thick=None if thick is None else thick.listed,
        at_once=2 if cells.needs.scattering else 1,
    )
    gather = None
    programs = [painter.parts[0].program]
    scattered: list[NDArray[np.floating] | None] = [None]
    defect: Floats = np.zeros(0)
    solution = None
    counts: dict[str, int] = {}
    seconds = {}
    if cells.needs.scattering:
        check_boundary(scene, cells, view)
        ray_bytes = len(cells.needs.components) * np.dtype(real).itemsize
        specialised = {**defines, **sweep_defines(device, cells.box(), ray_bytes=ray_bytes)}
        small = {"TILE": device.info.tile} if device.info.tile < 16 else {}
        programs += [
            build(device, "sweep.cl", specialised),
            build(device, "iterate.cl", {**defines, **small}),
        ]
        start = time.perf_counter()
        flags = {"TO_CAMERA": 1} if phase is None else {"TO_CAMERA": 1, "PHASE_STEPS": PHASE_STEPS}
        if thick is not None:
            flags["RIM"] = 1
        programs.append(build(device, "sweep.cl", {**specialised, **flags}))
        solution, halves, defect, ends = _scattering(
            solved, cells, thick, scene, view, device, settings, programs, counts, report
        )
        if thick is not None and ends is not None:
            units = np.ones(len(cells.needs.components))
            units[cells.needs.boundaries :] = solved.scale / cells.scale
            gather = Gather(
                painter,
                cells.box(),
                thick,
                *ends,
                settings,
                {**defines, "CUTOFF": float(settings.cutoff)},
                source=solution.source,
                units=units,
            )
        scattered = list(halves)
        seconds["scattering"] = time.perf_counter() - start
    start = time.perf_counter()
    images, refined = painter.pictures(scattered, defect, gather)
    if scene.camera.rays_per_pixel != 1:
        counts["pixels_of_several_rays"] = refined
    seconds["image"] = time.perf_counter() - start
    if gather is not None:
        programs += gather.programs
        counts["samples"] = gather.samples
        seconds["gather"] = gather.seconds
        seconds["image"] -= gather.seconds + sum(p.build_s for p in gather.programs)
    difference = None if len(images) < 2 else (images[0] - images[1]) / 2
    mean = images[0] if len(images) < 2 else (images[0] + images[1]) / 2
    return Trace(
        weights=weights_of(mean, cells),
        weights_difference=None if difference is None else weights_of(difference, cells),
        programs=tuple(programs),
        solution=solution,
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts=counts,
        precision=real.__name__,
        short="" if gather is None else gather.short,
        closure=Closure.of(
            mean[: cells.needs.boundaries], mean[-1], bound=_CLOSED + 10 * settings.tolerance
        ),
    )


def _scattering(
    cells: OpticalCells,
    seen: OpticalCells,
    thick: ThickCells | None,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    programs: list[Program],
    counts: dict[str, int],
    report: Callable[[str], None] | None,
) -> tuple[Solution, list[NDArray[np.floating]], Floats, tuple[Directions, RimLight] | None]:
    """The source of the scattering cells, its two final estimates (C, N), and what they make or
    lose of a cavity's radiance of 1 (N,).

    cells: as they are swept; seen: as the picture shows them, which differs with a phase function.
    programs: image, sweep, iterate, and the sweep towards the camera.
    """
    disc = view.disc
    sweeper = Sweeper(device, cells, programs[1], programs[2], disc=disc, patches=view.patches)
    rng = np.random.default_rng(settings.seed)
    last = np.random.default_rng([settings.seed, 1])  # alike whatever the order, to compare orders
    low = np.asarray(sweeper.box.low, float)
    high = low + sweeper.box.shape

    def rays(count: int, rng: np.random.Generator = rng) -> Rays:
        directions = for_boundary(
            count,
            rng,
            low=low,
            high=high,
            disc_centre=disc[:3],
            disc_radius=float(disc[3]) ** 0.5,
            enclosure=scene.background.shape == "enclosure",
        )
        return Rays(directions, rng.random((count, 2)))

    half = settings.final_directions // 2
    defect = np.zeros(sweeper.count)
    light, ends = None, None
    guess = first_guess(sweeper, cells.albedo)
    if settings.order == 0:
        seen_guess = _thermal(seen)
        seen_guess[1] += seen.albedo
        halves: list[NDArray[np.floating]] = [seen_guess.astype(sweeper.real)] * 2
        solution = Solution(guess, 0, 0.0, 0.0)
    else:
        if settings.order is None:
            solution = solve(
                sweeper,
                guess,
                rays(settings.directions),
                tolerance=settings.tolerance,
                report=report,
            )
        else:
            source = guess
            for _ in range(settings.order - 1):
                source = another_order(sweeper, source, rays(half))
            solution = Solution(source, settings.order, 0.0, 0.0)
        if settings.order is None:
            # The solver's few directions are forgotten, but for what is scattered twice more.
            better = another_order(sweeper, solution.source, rays(half))
            lack = solution.lack
            solution = replace(
                solution, source=better, lack=None if lack is None else lack * cells.albedo
            )
        few = rays(_CHECKED)
        defect = sweeper.defect(solution.source, few.directions, few.starts)
        if solution.lack is not None:
            defect -= solution.lack[: cells.needs.boundaries].sum(axis=0)
        phase = settings.phase
        towards = [
            rays(half, last)
            if phase is None
            else Rays(about_camera(half, last, phase), last.random((half, 2)))
            for _ in range(2)
        ]
        table = np.zeros(1) if phase is None else phase.by_half_sine(PHASE_STEPS)
        place = view.middle[:3] - np.array([0.0, view.distance, 0.0])
        camera = sweeper.to_camera(programs[3], seen, table, place)
        if thick is not None:
            light = RimLight.of(
                device,
                thick,
                sweeper.box,
                components=len(seen.needs.components),
                directions=2 * half,
                real=sweeper.real,
            )
            ends = (Directions.joined([each.directions for each in towards]), light)
        halves = []
        for number, each in enumerate(towards):
            if light is not None:
                camera = replace(camera, light=light.after(number * half))
            halves.append(_to_camera(sweeper, seen, camera, solution.source, cells.scale, each))
    solution = replace(solution, towards=np.mean(halves, axis=0))
    counts.update(
        swept_cells=sweeper.box.cells, scattering_cells=sweeper.count, sweeps=sweeper.sweeps
    )
    return solution, halves, defect, ends


def _thermal(cells: OpticalCells) -> Floats:
    """Thermal source (C, N) of the scattering cells."""
    out = np.zeros((len(cells.needs.components), len(cells.address)))
    out[cells.needs.boundaries :] = cells.thermal_planes(np.float64)[:, cells.address]
    return out


def _to_camera(
    sweeper: Sweeper,
    seen: OpticalCells,
    camera: ToCamera,
    source: NDArray[np.floating],
    scale: float,
    rays: Rays,
) -> NDArray[np.floating]:
    """What the cells send to the camera: albedo x weighted mean + emission, (C, N).

    scale: unit of the source's thermal parts, as `seen.scale` is of the answer's.
    """
    sweeper.set_source(source, shining=True)
    sweeper.sweep(rays.directions, rays.starts, shining=True, camera=camera)
    mean = sweeper.weighted_mean(camera).astype(np.float64)
    mean[seen.needs.boundaries :] *= scale / seen.scale
    return np.asarray(_thermal(seen) + seen.albedo * mean).astype(sweeper.real)
