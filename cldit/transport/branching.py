"""Ray tracing of the paper (Section "Ray Tracing"): the method `branching`, for comparison."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Reals
from cldit.errors import TransportError
from cldit.gpu.buffers import download, zeros
from cldit.gpu.device import shares
from cldit.gpu.program import Program, build
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.result import Trace, TraceInput, weights_of
from cldit.transport.view import upload_medium

HIGHEST_ORDER = 3  # each order costs about a hundred times the one before


def trace_branching(trace_input: TraceInput, report: Callable[[str], None] | None) -> Trace:
    """Weights by the paper's method, which drops light below the cut-off.

    All of the device's partitions share the rows of the image. Raises TransportError if the order
    is above 3 or not given, or if the phase function is not isotropic.
    """
    cells, settings = trace_input.cells, trace_input.settings
    if settings.order is None or settings.order > HIGHEST_ORDER:
        order = "all" if settings.order is None else settings.order
        raise TransportError(
            f"transport.order: {order} with method branching; allowed: 0..{HIGHEST_ORDER}, since "
            "each order costs about a hundred times the one before; or use method source or path"
        )
    if settings.phase is not None:
        raise TransportError(
            "transport.phase: method branching scatters isotropically, as in the paper; allowed: "
            "isotropic"
        )
    trace_input.check_boundary()
    defines = {**trace_input.defines, "HIGHEST_ORDER": HIGHEST_ORDER}
    members = (trace_input.device, *trace_input.device.others)
    programs = [build(member, "branching.cl", defines) for member in members]
    start = time.perf_counter()
    image, started = _image(trace_input, programs, settings.order)
    count = int(started.sum(dtype=np.int64))
    if report is not None:
        report(f"{count} rays started by scattering")
    planes = image.astype(np.float64)
    # Light below the cut-off is lost on the line of sight and on later rays.
    closure = EnergyBalance.of(
        planes[: cells.needs.boundaries],
        planes[-1],
        bound=1e-4 + trace_input.cutoff * (settings.order + 1),
        noise=0.02,
    )
    return Trace(
        weights=weights_of(planes, cells),
        closure=closure,
        weights_difference=None,
        programs=tuple(programs),
        seconds={
            "compile": sum(program.build_s for program in programs),
            "scattering": time.perf_counter() - start,
        },
        counts={"scattering_cells": len(cells.address), "scattered_rays": count},
        precision=settings.real.__name__,
    )


def _image(
    trace_input: TraceInput, programs: list[Program], order: int
) -> tuple[Reals, NDArray[np.uint32]]:
    """Weights (C + 1, H, W), and the number (H, W) of rays that scattering started."""
    cells, view, settings = trace_input.cells, trace_input.view, trace_input.settings
    columns, rows = view.pixels
    components, real = len(cells.needs.components) + 1, settings.real
    divided, outs = shares(trace_input.device, rows), []
    for program, (member, portion) in zip(programs, divided, strict=True):
        out = zeros(member, "image", components * rows * columns, real)
        rays = zeros(member, "rays", rows * columns, np.uint32)
        if portion:
            program.launch(
                "branching",
                *view.tiles(program, "branching", len(portion)),
                {
                    "weights": out,
                    "started": rays,
                    "key": np.array([settings.seed, 1], np.uint32),
                    **upload_medium(member, cells, view, real, linear=settings.linear_coefficients),
                    "cutoff": trace_input.cutoff,
                    "order": order,
                },
                offset=(0, portion.start),
            )
            member.queue.flush()  # the next device starts while this one works
        outs.append((out, rays))
    image = np.empty((components, rows, columns), real)
    started = np.empty((rows, columns), np.uint32)
    for (member, portion), (out, rays) in zip(divided, outs, strict=True):
        part_rows = slice(portion.start, portion.stop)  # tiles reach into the next device's rows
        image[:, part_rows] = download(member, out, np.empty_like(image))[:, part_rows]
        started[part_rows] = download(member, rays, np.empty_like(started))[part_rows]
    return image, started
