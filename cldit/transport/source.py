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

from cldit.errors import TransportError
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.directions import about_camera, for_boundary
from cldit.transport.result import Settings, Trace, weights_of
from cldit.transport.solve import Rays, Solution, another_order, first_guess, solve
from cldit.transport.sweep import Sweeper, ToCamera, sweep_defines
from cldit.transport.view import View, upload_tree

Floats = NDArray[np.float64]

_PHASE_STEPS = 1024


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
        solved = OpticalCells.of(cells.tree, scattered=1.0 - phase.asymmetry)
    view = View.of(scene, cells)
    defines: dict[str, Define] = {**cells.needs.defines, **view.defines}
    if settings.precision == "float64":
        defines["USE_FLOAT64"] = 1
    real = np.float64 if settings.precision == "float64" else np.float32
    planes = cells.source_planes(real)
    programs = [build(device, "image.cl", {**defines, "CUTOFF": float(settings.cutoff)})]
    scattered: list[NDArray[np.floating] | None] = [None]
    solution = None
    counts: dict[str, int] = {}
    seconds = {}
    if cells.needs.scattering:
        check_disc(scene, cells, view.disc)
        specialised = {**defines, **sweep_defines(device, cells.box())}
        programs += [build(device, "sweep.cl", specialised), build(device, "iterate.cl", defines)]
        start = time.perf_counter()
        flags = {"TO_CAMERA": 1} if phase is None else {"TO_CAMERA": 1, "PHASE_STEPS": _PHASE_STEPS}
        programs.append(build(device, "sweep.cl", {**specialised, **flags}))
        solution, halves = _scattering(
            solved, cells, scene, view, device, settings, programs, counts, report
        )
        scattered = list(halves)
        seconds["scattering"] = time.perf_counter() - start
    start = time.perf_counter()
    images = _images(cells, view, device, programs[0], planes, scattered)
    seconds["image"] = time.perf_counter() - start
    difference = None if len(images) < 2 else (images[0] - images[1]) / 2
    return Trace(
        weights=weights_of(np.mean(images, axis=0), cells),
        weights_difference=None if difference is None else weights_of(difference, cells),
        programs=tuple(programs),
        solution=solution,
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts=counts,
        precision=real.__name__,
    )


def check_disc(scene: Scene, cells: OpticalCells, disc: Floats) -> None:
    """Rays that leave the medium must still have the disc before them."""
    box = cells.box()
    if scene.background.shape == "disc" and disc[1] < box.low[1] + box.shape[1] - 1e-6:
        reach = cells.tree.frame.lower_m[1] + (box.low[1] + box.shape[1]) * cells.tree.frame.cell_m
        raise TransportError(
            f"background.centre_m: y = {scene.background_centre_m[1]:g} m lies inside the spray, "
            f"which reaches to y = {reach:.4g} m; allowed is a disc behind it"
        )


def _scattering(
    cells: OpticalCells,
    seen: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    programs: list[Program],
    counts: dict[str, int],
    report: Callable[[str], None] | None,
) -> tuple[Solution, list[NDArray[np.floating]]]:
    """The source of the scattering cells, and its two final estimates (C, N).

    cells: as they are swept; seen: as the picture shows them, which differs with a phase function.
    programs: image, sweep, iterate, and the sweep towards the camera.
    """
    disc = view.disc
    sweeper = Sweeper(device, cells, programs[1], programs[2], disc=disc)
    rng = np.random.default_rng(settings.seed)
    low = np.asarray(sweeper.box.low, float)
    high = low + sweeper.box.shape

    def rays(count: int) -> Rays:
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
                source = another_order(sweeper, source, rays(settings.directions))
            solution = Solution(source, settings.order, 0.0, 0.0)
        half = settings.final_directions // 2
        phase = settings.phase
        towards = [
            rays(half)
            if phase is None
            else Rays(about_camera(half, rng, phase), rng.random((half, 2)))
            for _ in range(2)
        ]
        table = np.zeros(1) if phase is None else phase.by_half_sine(_PHASE_STEPS)
        place = view.middle[:3] - np.array([0.0, view.distance, 0.0])
        camera = sweeper.to_camera(programs[3], seen, table, place)
        halves = [
            _to_camera(sweeper, seen, camera, solution.source, cells.scale, each)
            for each in towards
        ]
    solution = replace(solution, towards=np.mean(halves, axis=0))
    counts.update(
        swept_cells=sweeper.box.cells, scattering_cells=sweeper.count, sweeps=sweeper.sweeps
    )
    return solution, halves


def _thermal(cells: OpticalCells) -> Floats:
    """Thermal source (C, N) of the scattering cells."""
    out = np.zeros((len(cells.needs.components), len(cells.address)))
    for c, name in enumerate(cells.needs.components[2:], start=2):
        out[c] = cells.emitted[name][cells.address]
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
    mean[2:] *= scale / seen.scale
    return np.asarray(_thermal(seen) + seen.albedo * mean).astype(sweeper.real)


def _images(
    cells: OpticalCells,
    view: View,
    device: Device,
    program: Program,
    planes: NDArray[np.floating],
    scattered: list[NDArray[np.floating] | None],
) -> list[NDArray[np.float64]]:
    """Weights (C, H, W), one picture for each source (C, N) of the scattering cells.

    planes: thermal sources of all stored cells, overwritten where cells scatter.
    """
    real = planes.dtype.type
    columns, rows = view.pixels
    components = len(cells.needs.components)
    tree = upload_tree(device, cells, real)
    arguments = view.arguments(cells, real)
    out = zeros(device, "picture", components * rows * columns, real)
    images = []
    for listed in scattered:
        if listed is not None:
            planes[:, cells.address] = listed
        source = upload(device, "source", planes)
        program["image"](device.queue, *view.tiles, out, *tree, source, *arguments)
        image = download(device, out, np.empty((components, rows, columns), real))
        images.append(image.astype(np.float64))
    return images
