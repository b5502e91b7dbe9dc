"""Source iteration, the method `source`: discrete ordinates, formal solution, final gather.

`trace_source` is the algorithm. It has five stages, with equations in docs/theory.md:

1. Iteration to a residual (discrete_ordinates/iteration.py): the source of every scattering cell,
   S = a Lambda S + E, by GMRES along few ordinates and a defect correction along more.
2. Moment source (discrete_ordinates/moment_source.py): angular moments, for the phase function, and
   spatial moments in thick cells, from a few more sweeps.
3. Final sweeps (camera_source.py): the source of every cell to the camera, by many ordinates in two
   halves; and the radiance on the interfaces of the thick region.
4. Image (image.py): the formal solution along one ray a pixel, with the sources of either half, and
   along more where the scene or the expected error asks for them (ray_choice.py).
5. Final gather (final_gather/gather.py): the light that thick cells scatter, by short paths from
   each pixel.

Half the difference of the images of the two halves estimates the quadrature error.
"""

import time
from collections.abc import Callable, Mapping

import numpy as np

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.medium.octree import Octree
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.camera_source import CameraSource, final_sweeps, order_0_source
from cldit.transport.cell_phases import phase_moments
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.iteration import iterate_source
from cldit.transport.discrete_ordinates.moment_source import moment_source
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.final_gather.gather import Gather
from cldit.transport.final_gather.paths import PathSampler
from cldit.transport.image import FormalSolution, Rays
from cldit.transport.result import Trace, TraceInput, TraceSettings, weights_of
from cldit.transport.thick_region import ThickRegion
from cldit.transport.traced_pixels import traced_pixels


def trace_source(
    trace_input: TraceInput,
    report: Callable[[str], None] | None,
    pixels: Ints | None = None,
    rays: Ints | None = None,
) -> Trace:
    """Weights by source iteration.

    The precision is not `auto`. The device's other parts share the image and the final gather. Of
    the `pixels` (N,), flat numbers, images are one row; None: all pixels. `rays` (H, W) as in
    `trace`.
    """
    settings, start = trace_input.settings, time.perf_counter()
    cells, seconds = trace_input.cells, dict[str, float]()
    region = camera = gather = None
    if cells.needs.scattering:
        trace_input.check_boundary()
        region = thick_region(cells, settings)
        camera = _camera_source(trace_input, region, report)  # 1, 2, 3
        builds = sum(program.build_s for program in camera.programs)
        # Devices build in parallel: the sum may exceed the elapsed time.
        seconds["scattering"] = max(time.perf_counter() - start - builds, 0.0)
    image = formal_solution(trace_input, region)
    if region is not None and camera is not None and camera.cell_sources is not None:
        gather = Gather(PathSampler(image, region, camera.cell_sources, settings))

    start = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):  # the energy balance refuses a broken image
        lit = _lit(image, camera, gather)
        traced = traced_pixels(lit, trace_input, pixels, rays)  # 4, and 5 by `gather`
        seconds["image"] = time.perf_counter() - start
        mean = _mean(traced.halves)
        balance = EnergyBalance.of(
            mean[: cells.needs.boundaries],
            mean[-1],
            bound=settings.tuning.closure + 3 * settings.tolerance,
        )
    if gather is not None:
        seconds["gather"] = gather.seconds
        seconds["image"] = max(seconds["image"] - gather.seconds, 0.0)  # devices gather in parallel
    programs = _programs(image, camera, gather)
    seconds["compile"] = sum(program.build_s for program in programs)
    return Trace(
        weights=weights_of(mean, cells),
        weights_difference=_half(traced.halves, cells),
        scatters=cells.needs.scattering,
        middle=None if traced.middle is None else weights_of(_mean(traced.middle), cells),
        middle_difference=None if traced.middle is None else _half(traced.middle, cells),
        programs=programs,
        iterations=None if camera is None else camera.solution.iterations,
        source_error=0.0 if camera is None else camera.solution.error,
        seconds=seconds,
        counts=_counts(camera, traced.across, gather),
        precision="float64" if settings.precision == "float64" else "float32",
        short="" if gather is None else gather.short,
        closure=balance,
        subpixels=traced.subpixels,
        rays=traced.across if pixels is None else None,
    )


def _programs(
    image: FormalSolution, camera: CameraSource | None, gather: Gather | None
) -> tuple[Program, ...]:
    """All programs of a trace."""
    return (
        image.programs[0],
        *(() if camera is None else camera.programs),
        *(() if gather is None else gather.sampler.programs),
    )


def _camera_source(
    trace_input: TraceInput, region: ThickRegion | None, report: Callable[[str], None] | None
) -> CameraSource:
    """Sources of the scattering cells to the camera: stages 1 to 3."""
    settings = trace_input.settings
    if settings.order == 0:
        return order_0_source(trace_input.cells, settings.real)
    problem = SweepProblem.of(trace_input, region)
    rng = np.random.default_rng(settings.seed)
    return final_sweeps(problem, moment_source(problem, iterate_source(problem, rng, report), rng))


def _lit(image: FormalSolution, camera: CameraSource | None, gather: Gather | None) -> Rays:
    """Rays through the medium with the sources to the camera."""
    if camera is None:
        return image.with_sources([], np.zeros(0))
    return image.with_sources([*camera.halves], camera.defect, gather, known=camera.known)


def _counts(camera: CameraSource | None, across: Ints, gather: Gather | None) -> dict[str, int]:
    """Sizes of a trace, see `Trace.counts`."""
    counts = {} if camera is None else dict(camera.counts)
    if np.any(across > 1):
        counts["pixels_of_several_rays"] = int(np.count_nonzero(across > 1))
        counts["rays"] = int(np.sum(across**2))
    if gather is not None:
        counts["samples"] = gather.samples
    return counts


def _mean(halves: Reals) -> Reals:
    return halves[0] if len(halves) < 2 else np.asarray((halves[0] + halves[1]) / 2)


def _half(halves: Reals, cells: OpticalCells) -> Weights | None:
    """Half the difference of both images; None of one."""
    return None if len(halves) < 2 else weights_of((halves[0] - halves[1]) / 2, cells)


def thick_region(cells: OpticalCells, settings: TraceSettings) -> ThickRegion | None:
    """Region of `cells` that the final gather refines; None if it refines none."""
    if not (settings.within_cells and cells.needs.scattering):
        return None
    phase = settings.phase
    return ThickRegion.of(
        cells,
        cells.box(),
        deeper_than=settings.thick_depth,
        tuning=settings.tuning,
        asymmetry=0.0 if phase is None else phase_moments(cells, phase, 2)[1],
    )


def formal_solution(trace_input: TraceInput, region: ThickRegion | None) -> FormalSolution:
    """Formal solution for one image of each half of the ordinates.

    The final gather adds the light of the thick cells of `region`; None: there is no gather.
    """
    scatters = trace_input.cells.needs.scattering
    return FormalSolution.of(
        trace_input.cells,
        trace_input.view,
        trace_input.scene,
        trace_input.device,
        trace_input.defines,
        cutoff=trace_input.cutoff,
        thick=None if region is None else region.listed,
        at_once=2 if scatters else 1,
        linear=scatters and trace_input.settings.within_cells,
    )


def source_function(
    tree: Octree,
    scene: Scene,
    device: Device,
    settings: TraceSettings,
    boundary: Mapping[str, float],
) -> Floats:
    """Source function (P,) of stored cells and coarse leaves to the camera, by stages 1 to 3.

    S = albedo x mean radiance + emission / extinction, with the radiance weighted by the phase
    function for scattering to the camera, in photons s-1 m-2 sr-1. `boundary` has the radiance that
    leaves `background`, `wall` and each patch, in the same unit. Raises as `trace_source`.
    """
    trace_input = TraceInput.of(tree, scene, device, settings)
    cells = trace_input.cells
    source = np.zeros(len(cells.depth))
    for emitted in cells.emitted.values():
        source += cells.scale * emitted
    if not cells.needs.scattering:
        return source
    region = None
    if settings.order != 0:
        trace_input.check_boundary()
        region = thick_region(cells, settings)
    camera = _camera_source(trace_input, region, None)
    mean = np.mean(camera.halves, axis=0, dtype=np.float64)
    units = [boundary.get(name, cells.scale) for name in cells.needs.components]
    source[cells.address] = np.asarray(units) @ mean
    return source
