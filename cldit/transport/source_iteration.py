"""Source iteration: the source function of every scattering cell, then one ray a pixel.

The source is solved for by sweeping rays through the box of cells that the spray fills; one last
sweep with many directions, and the picture, follow. The last sweep is done in two halves, each
along every other direction; from the difference of the two pictures the run knows how far it is
from what more directions would give, or less.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define
from cldit.scene.schema import Scene
from cldit.transport.camera_source import CameraSource, camera_source
from cldit.transport.cells import OpticalCells
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.final_gather.gather import Gather
from cldit.transport.image import FormalSolution, Gathered, Reals
from cldit.transport.result import Settings, Trace, weights_of
from cldit.transport.thick_region import ThickRegion
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
    made = prepared(cells, scene, view, device, settings, report)
    light, gather, seconds = made.light, made.gather, dict(made.seconds)
    programs = [made.formal_solution.parts[0].program, *([] if light is None else light.programs)]
    counts = {} if light is None else dict(light.counts)
    solution = None if light is None else light.solution
    short = ""
    start = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):  # of a broken picture; closure tells it
        images, refined = made.pictures(gather)
    if scene.camera.rays_per_pixel != 1:
        counts["pixels_of_several_rays"] = refined
    seconds["image"] = time.perf_counter() - start
    if gather is not None:
        programs += gather.programs
        counts["samples"] = gather.samples
        seconds["gather"] = gather.seconds
        seconds["image"] -= gather.seconds + sum(p.build_s for p in gather.programs)
        short = gather.short
    del made, light, gather  # some hundred megabytes on the device
    with np.errstate(over="ignore", invalid="ignore"):
        mean = images[0] if len(images) < 2 else (images[0] + images[1]) / 2
        closure = EnergyBalance.of(
            mean[: cells.needs.boundaries], mean[-1], bound=_CLOSED + 3 * settings.tolerance
        )
    difference = None if len(images) < 2 else (images[0] - images[1]) / 2
    return Trace(
        weights=weights_of(mean, cells),
        weights_difference=None if difference is None else weights_of(difference, cells),
        programs=tuple(programs),
        solution=solution,
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts=counts,
        precision="float64" if settings.precision == "float64" else "float32",
        short=short,
        closure=closure,
    )


@dataclass(frozen=True)
class Prepared:
    """All that pictures are made of. light: None, where nothing scatters; gather: where no cell is
    thick. seconds: that scattering took."""

    formal_solution: FormalSolution
    light: CameraSource | None
    gather: Gather | None
    seconds: dict[str, float]

    def pictures(self, gather: Gathered | None) -> tuple[list[Reals], int]:
        """See `FormalSolution.pictures`."""
        light = self.light
        if light is None:
            return self.formal_solution.pictures([None], np.zeros(0), gather)
        return self.formal_solution.pictures(
            list(light.halves),
            light.defect,
            gather,
            across=light.across,
            control_variate=None if self.gather is None else self.gather.control_variate,
        )


def prepared(
    cells: OpticalCells,
    scene: Scene,
    view: View,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
    flags: Mapping[str, Define] | None = None,
) -> Prepared:
    """Sweeps, and builds what is to follow; raises as `trace`. flags: of flights."""
    defines: dict[str, Define] = {**cells.needs.defines, **view.defines}
    if settings.precision == "float64":
        defines["USE_FLOAT64"] = 1
    cut = {**defines, "CUTOFF": float(settings.cutoff)}
    scatters = cells.needs.scattering
    thick = None
    if settings.within_cells and scatters:
        size = 8 if settings.precision == "float64" else 4
        thick = ThickRegion.of(
            cells,
            cells.box(),
            deeper_than=settings.thick,
            light_bytes=settings.final_directions * len(cells.needs.components) * size,
        )
    light = None
    seconds = {}
    if scatters:
        check_boundary(scene, cells, view)
        start = time.perf_counter()
        light = camera_source(cells, thick, scene, view, device, settings, defines, report)
        seconds["scattering"] = time.perf_counter() - start
        seconds["scattering"] -= sum(program.build_s for program in light.programs)
    formal_solution = FormalSolution.of(  # no sooner: sweeps take the most memory
        cells,
        view,
        scene,
        device,
        cut,
        accuracy_K=settings.accuracy_K,
        thick=None if thick is None else thick.listed,
        at_once=2 if scatters else 1,
        linear=scatters and settings.within_cells,
    )
    gather = None
    if thick is not None and light is not None and light.ends is not None:
        flown = {**cut, **(flags or {})}
        gather = Gather(formal_solution, cells.box(), thick, light.ends, settings, flown)
    return Prepared(formal_solution, light, gather, seconds)
