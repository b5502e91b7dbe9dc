"""Source iteration: the source function of every scattering cell, then one ray a pixel.

The source is solved for by sweeping rays through the box of cells that the spray fills; one last
sweep with many directions, and the picture, follow. The last sweep is done in two halves, each
along every other direction; from the difference of the two pictures the run knows how far it is
from what more directions would give, or less.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.closure import Closure
from cldit.transport.gather import Gather
from cldit.transport.picture import Painter
from cldit.transport.result import Settings, Trace, weights_of
from cldit.transport.scattered import scattered_light
from cldit.transport.solve import Solution
from cldit.transport.thick import ThickCells
from cldit.transport.view import View, check_boundary

Floats = NDArray[np.float64]

_CLOSED = 1e-3  # what single precision may lose in thick and nearly conservative media


def trace_source(
    cells: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
) -> Trace:
    """Weights by source iteration, in the precision that `settings` gives (not `auto`)."""
    painted = _painted(cells, scene, view, device, settings, report)
    images = painted.images
    difference = None if len(images) < 2 else (images[0] - images[1]) / 2
    mean = images[0] if len(images) < 2 else (images[0] + images[1]) / 2
    return Trace(
        weights=weights_of(mean, cells),
        weights_difference=None if difference is None else weights_of(difference, cells),
        programs=painted.programs,
        solution=painted.solution,
        seconds=painted.seconds,
        counts=painted.counts,
        precision="float64" if settings.precision == "float64" else "float32",
        short=painted.short,
        closure=Closure.of(
            mean[: cells.needs.boundaries], mean[-1], bound=_CLOSED + 10 * settings.tolerance
        ),
    )


@dataclass(frozen=True)
class _Painted:
    """images (C + 1, H, W), by either half of the last sweep, or one; the others as in `Trace`."""

    images: list[Floats]
    programs: tuple[Program, ...]
    solution: Solution | None
    seconds: dict[str, float]
    counts: dict[str, int]
    short: str


def _painted(
    cells: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
) -> _Painted:
    """The pictures; what made them, some hundred megabytes on the device, is let go of."""
    defines: dict[str, Define] = {**cells.needs.defines, **view.defines}
    if settings.precision == "float64":
        defines["USE_FLOAT64"] = 1
    thick = None
    if settings.within_cells and cells.needs.scattering:
        size = 8 if settings.precision == "float64" else 4
        thick = ThickCells.of(
            cells,
            cells.box(),
            deeper_than=settings.thick,
            light_bytes=settings.final_directions * len(cells.needs.components) * size,
        )
    painter = Painter.of(
        cells,
        view,
        scene,
        device,
        {**defines, "CUTOFF": float(settings.cutoff)},
        accuracy_K=settings.accuracy_K,
        thick=None if thick is None else thick.listed,
        at_once=2 if cells.needs.scattering else 1,
        linear=cells.needs.scattering and settings.within_cells,
    )
    gather = None
    light = None
    seconds = {}
    if cells.needs.scattering:
        check_boundary(scene, cells, view)
        start = time.perf_counter()
        light = scattered_light(cells, thick, scene, view, device, settings, defines, report)
        seconds["scattering"] = time.perf_counter() - start
        seconds["scattering"] -= sum(program.build_s for program in light.programs)
        if thick is not None and light.ends is not None:
            cut = {**defines, "CUTOFF": float(settings.cutoff)}
            gather = Gather(painter, cells.box(), thick, light.ends, settings, cut)
    programs = [painter.parts[0].program, *([] if light is None else light.programs)]
    counts = {} if light is None else dict(light.counts)
    start = time.perf_counter()
    images, refined = (
        painter.pictures([None], np.zeros(0), gather)
        if light is None
        else painter.pictures(
            list(light.halves),
            light.defect,
            gather,
            across=light.across,
            expected=None if gather is None else gather.expected(),
        )
    )
    if scene.camera.rays_per_pixel != 1:
        counts["pixels_of_several_rays"] = refined
    seconds["image"] = time.perf_counter() - start
    if gather is not None:
        programs += gather.programs
        counts["samples"] = gather.samples
        seconds["gather"] = gather.seconds
        seconds["image"] -= gather.seconds + sum(p.build_s for p in gather.programs)
    return _Painted(
        images=images,
        programs=tuple(programs),
        solution=None if light is None else light.solution,
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts=counts,
        short="" if gather is None else gather.short,
    )
