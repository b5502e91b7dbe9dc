"""Ray tracing of the paper (Section "Ray Tracing"): the method `branching`, for comparison."""

import time
from collections.abc import Callable

import numpy as np

from cldit.errors import TransportError
from cldit.gpu.buffers import download, zeros
from cldit.gpu.device import shares
from cldit.gpu.program import build
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.result import Trace, TraceInput, weights_of
from cldit.transport.view import upload_medium

HIGHEST_ORDER = 3  # each order costs about a hundred times the one before


def trace_branching(given: TraceInput, report: Callable[[str], None] | None) -> Trace:
    """Weights by the paper's method, which drops light below the cut-off.

    All of the device's partitions share the rows of the image. Raises TransportError if the order
    is above 3 or not given, or if the phase function is not isotropic.
    """
    cells, view, settings = given.cells, given.view, given.settings
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
    given.check_boundary()
    real = settings.real
    defines = {**given.defines, "HIGHEST_ORDER": HIGHEST_ORDER}
    divided = shares(given.device, view.pixels[1])
    programs = [build(one, "branching.cl", defines) for one, _ in divided]
    start = time.perf_counter()
    columns, rows = view.pixels
    components = len(cells.needs.components) + 1
    outs = []
    for program, (one, mine) in zip(programs, divided, strict=True):
        out = zeros(one, "image", components * rows * columns, real)
        rays = zeros(one, "rays", rows * columns, np.uint32)
        if mine:
            program.launch(
                "branching",
                *view.tiles(program, "branching", len(mine)),
                {
                    "weights": out,
                    "started": rays,
                    "key": np.array([settings.seed, 1], np.uint32),
                    **upload_medium(one, cells, view, real, linear=settings.linear_coefficients),
                    "cutoff": given.cutoff,
                    "order": settings.order,
                },
                offset=(0, mine.start),
            )
            one.queue.flush()  # the next device starts while this one works
        outs.append((out, rays))
    image = np.empty((components, rows, columns), real)
    started = np.empty((rows, columns), np.uint32)
    for (one, mine), (out, rays) in zip(divided, outs, strict=True):
        here = slice(mine.start, mine.stop)  # tiles reach into the next device's rows
        image[:, here] = download(one, out, np.empty_like(image))[:, here]
        started[here] = download(one, rays, np.empty_like(started))[here]
    count = int(started.sum(dtype=np.int64))
    if report is not None:
        report(f"{count} rays started by scattering")
    planes = image.astype(np.float64)
    # Light below the cut-off is lost on the line of sight and on later rays.
    closure = EnergyBalance.of(
        planes[: cells.needs.boundaries],
        planes[-1],
        bound=1e-4 + given.cutoff * (settings.order + 1),
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
        precision=real.__name__,
    )
