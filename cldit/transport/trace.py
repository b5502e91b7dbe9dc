"""One trace: the octree and the scene's geometry -> weights per pixel.

Source iteration (`source`): the source function of every scattering cell is solved for by sweeping
rays through the box of cells that the spray fills; one last sweep with many directions, and one
ray a pixel, make the picture. The last sweep is done in two independent halves; from the
difference of the two pictures the run knows how far it is from what more directions would give.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cldit.errors import NotConvergedError, TransportError
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.medium.octree import Octree
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.directions import for_boundary
from cldit.transport.solve import Rays, Solution, another_order, first_guess, last_order, solve
from cldit.transport.sweep import Sweeper, sweep_defines

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """How a trace is carried out; `settings_for` derives it from the wanted accuracy.

    directions: of the sweeps that solve for the source; final_directions: of the two halves
    together of the last sweep; tolerance: RMS error allowed in the source (weights are 0..1).
    """

    directions: int
    final_directions: int
    tolerance: float
    order: int | None
    cutoff: float
    precision: Literal["auto", "float32", "float64"]
    seed: int


@dataclass(frozen=True)
class Trace:
    """What came out of a trace, and how.

    weights_difference: half the difference of the pictures from the two halves of the last sweep;
    its RMS estimates the standard error of the weights. None where nothing scatters.
    """

    weights: Weights
    weights_difference: Weights | None
    programs: tuple[Program, ...]
    solution: Solution | None
    seconds: dict[str, float]
    precision: str
    counts: dict[str, int] = field(default_factory=dict)


def settings_for(scene: Scene) -> Settings:
    """Directions and tolerance for the accuracy that the scene asks for.

    Measured on `gdi` against 256 and 1024 directions, RMS of T_app: 0.16 K with 32 and 64 in the
    last sweep, 0.11 K with 64 and 128, 0.08 K with the 96 and 192 that are used for 0.1 K.
    """
    spec = scene.transport
    finer = 0.1 / spec.accuracy_K
    directions = spec.directions or int(np.clip(8 * round(12 * finer), 16, 512))
    return Settings(
        directions=directions,
        final_directions=2 * directions,
        tolerance=float(np.clip(3e-5 / finer, 1e-6, 3e-4)),
        order=spec.order,
        cutoff=spec.cutoff,
        precision=spec.precision,
        seed=spec.seed,
    )


def _geometry(scene: Scene, tree: Octree) -> tuple[Floats, dict[str, int]]:
    """Disc (x, y, z, squared radius) in cells, and the defines of boundary and camera."""
    frame = tree.frame
    centre = frame.to_cells(np.asarray([scene.background_centre_m]))[0]
    disc = np.array([*centre, (scene.background.radius_m / frame.cell_m) ** 2])
    defines = {
        "BOUNDARY_DISC" if scene.background.shape == "disc" else "BOUNDARY_ENCLOSURE": 1,
        "CAMERA_PINHOLE" if scene.camera.model == "pinhole" else "CAMERA_ORTHOGRAPHIC": 1,
    }
    return disc, defines


def trace(
    tree: Octree,
    scene: Scene,
    device: Device,
    settings: Settings,
    *,
    report: Callable[[str], None] | None = None,
) -> Trace:
    """Weights of every pixel.

    With precision `auto`, a source that single precision cannot resolve (optically thick and nearly
    conservative media) is solved again in double precision where the device has it; the trace says
    so in `precision`.

    Raises:
        TransportError: the source did not converge, or the medium reaches behind the background.
        DeviceError, KernelError: the device cannot do it.
    """
    if settings.precision == "float64" and not device.info.float64:
        raise TransportError(
            f"transport.precision: float64 is not available on {device.info.name}; allowed: float32"
        )
    cells = OpticalCells.of(tree)
    if settings.precision != "auto":
        return _trace(cells, scene, device, settings, report)
    try:
        return _trace(cells, scene, device, replace(settings, precision="float32"), report)
    except NotConvergedError:
        if not device.info.float64:
            raise
        if report is not None:
            report("single precision does not resolve this source; again in double precision")
        return _trace(cells, scene, device, replace(settings, precision="float64"), report)


def _trace(
    cells: OpticalCells,
    scene: Scene,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
) -> Trace:
    disc, geometry = _geometry(scene, cells.tree)
    defines: dict[str, Define] = {**cells.needs.defines, **geometry}
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
        _check_disc(scene, cells, disc)
        specialised = {**defines, **sweep_defines(device, cells.box())}
        programs += [build(device, "sweep.cl", specialised), build(device, "iterate.cl", defines)]
        start = time.perf_counter()
        solution, halves = _scattering(
            cells, scene, device, settings, programs[1], programs[2], disc, counts, report
        )
        scattered = list(halves)
        seconds["scattering"] = time.perf_counter() - start
    start = time.perf_counter()
    images = _images(cells, scene, device, programs[0], disc, planes, scattered)
    seconds["image"] = time.perf_counter() - start
    difference = None if len(images) < 2 else (images[0] - images[1]) / 2
    return Trace(
        weights=_weights(np.mean(images, axis=0), cells),
        weights_difference=None if difference is None else _weights(difference, cells),
        programs=tuple(programs),
        solution=solution,
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts=counts,
        precision=real.__name__,
    )


def _check_disc(scene: Scene, cells: OpticalCells, disc: Floats) -> None:
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
    scene: Scene,
    device: Device,
    settings: Settings,
    sweep: Program,
    iterate: Program,
    disc: Floats,
    counts: dict[str, int],
    report: Callable[[str], None] | None,
) -> tuple[Solution, list[NDArray[np.floating]]]:
    """The source of the scattering cells, and its two final estimates (C, N)."""
    sweeper = Sweeper(device, cells, sweep, iterate, disc=disc)
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
        halves = [guess, guess]
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
        halves = [last_order(sweeper, solution.source, rays(half)) for _ in range(2)]
    counts.update(
        swept_cells=sweeper.box.cells, scattering_cells=sweeper.count, sweeps=sweeper.sweeps
    )
    return solution, halves


def _images(
    cells: OpticalCells,
    scene: Scene,
    device: Device,
    program: Program,
    disc: Floats,
    planes: NDArray[np.floating],
    scattered: list[NDArray[np.floating] | None],
) -> list[NDArray[np.float64]]:
    """Weights (C, H, W), one picture for each source (C, N) of the scattering cells.

    planes: thermal sources of all stored cells, overwritten where cells scatter.
    """
    frame = cells.tree.frame
    real = planes.dtype.type
    columns, rows = scene.camera.pixels
    components = len(cells.needs.components)
    middle = np.array([*frame.to_cells(np.asarray([scene.target_m]))[0], 0.0])
    width, height = (length / frame.cell_m for length in scene.camera.field_m)
    bounds = cells.bounds()
    directory = upload(device, "octree", cells.tree.directory)
    spans = np.maximum(1, frame.cells >> cells.tree.coarse_level).astype(np.int32)
    span = upload(device, "coarse leaves", spans)
    depth = upload(device, "optical depth", cells.depth.astype(real))
    out = zeros(device, "picture", components * rows * columns, real)
    images = []
    for listed in scattered:
        if listed is not None:
            planes[:, cells.address] = listed
        source = upload(device, "source", planes)
        program["image"](
            device.queue,
            (-(-columns // 8) * 8, -(-rows // 8) * 8),
            (8, 8),
            out,
            directory,
            span,
            depth,
            source,
            np.int32(cells.tree.slots * 512),
            np.int32(len(cells.depth)),
            np.int32(frame.bricks),
            np.array([*bounds.low, 0], np.int32),
            np.array([*np.add(bounds.low, bounds.shape), 0], np.int32),
            np.int32(columns),
            np.int32(rows),
            middle.astype(real),
            real(width / columns),
            real(height / rows),
            real(scene.camera.distance_m / frame.cell_m),
            disc.astype(real),
        )
        image = download(device, out, np.empty((components, rows, columns), real))
        images.append(image.astype(np.float64))
    return images


def _weights(image: NDArray[np.float64], cells: OpticalCells) -> Weights:
    planes = dict(zip(cells.needs.components, image, strict=True))
    nothing = np.zeros(image.shape[1:], np.float32)
    return Weights(
        background=planes["background"].astype(np.float32),
        wall=planes["wall"].astype(np.float32),
        vapour=(planes["vapour"] * cells.scale).astype(np.float32)
        if "vapour" in planes
        else nothing,
        liquid=(planes["liquid"] * cells.scale).astype(np.float32)
        if "liquid" in planes
        else nothing,
    )
