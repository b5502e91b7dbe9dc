"""The picture of what thick cells scatter, by chains of scatterings among them.

In the sweeps a cell has one source. Where it is thick the source varies within it, and what it
sends back to where it is lit from is far more than its mean. Where a line of sight meets thick
cells, chains follow what these scatter, by the phase function itself, until they leave them for
cells whose source is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.path import Known, trace_path
from cldit.transport.result import Settings, Trace


def gather(
    cells: OpticalCells,
    scene: Scene,
    device: Device,
    settings: Settings,
    report: Callable[[str], None] | None,
    result: Trace,
) -> Trace:
    """`result` of `source`, with its picture made anew where it shows cells thicker than
    `settings.thick`; raises as `trace`."""
    thick = np.zeros(len(cells.depth), np.bool_)
    thick[cells.address] = cells.depth[cells.address] > settings.thick
    solution = result.solution
    if solution is None or solution.towards is None or not thick.any():
        return result
    turned = 1.0 if settings.phase is None else 1.0 - settings.phase.asymmetry
    swept = OpticalCells.of(cells.tree, patches=cells.needs.patches, scattered=turned)
    units = np.ones(len(cells.needs.components))
    units[cells.needs.boundaries :] = swept.scale / cells.scale
    # Light meets thick cells as they are, and others as they were swept.
    known = Known(
        towards=_filled(cells, solution.towards, thick),
        depth=np.where(thick, cells.depth, swept.depth),
        source=_filled(cells, solution.source * units[:, None], thick),
        thick=thick,
    )
    picture = trace_path(cells, scene, device, settings, report, known)
    seconds = {"gather": picture.seconds["image"] + picture.seconds["scattering"]}
    return replace(
        picture,
        weights_difference=_sum(result.weights_difference, picture.weights_difference),
        standard_error=None,
        programs=(*result.programs, *picture.programs),
        solution=solution,
        closure=result.closure,  # of the solution and the plain picture
        seconds={**result.seconds, **seconds},
        counts={**result.counts, **picture.counts},
    )


def _filled(
    cells: OpticalCells, listed: NDArray[np.floating], thick: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Source (C, P) of all stored cells from that of the scattering ones (C, N); of thick cells
    what they emit."""
    planes = cells.source_planes(np.float64)
    thin = ~thick[cells.address]
    planes[:, cells.address[thin]] = listed[:, thin]
    return np.asarray(planes, np.float64)


def _sum(one: Weights | None, other: Weights | None) -> Weights | None:
    """Of differences that are independent, so that their squares add up."""
    if one is None or other is None:
        return one or other
    others = other.images
    return Weights.of({name: image + others[name] for name, image in one.images.items()})
