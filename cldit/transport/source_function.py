"""The source function of every cell, as the picture's formal solution integrates it.

S = albedo x mean radiance + emission / extinction, the radiance weighted by the phase function for
scattering to the camera: stages 1 to 3 of source_iteration.py, before boundaries of given radiance.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.medium.octree import Octree
from cldit.scene.schema import Scene
from cldit.transport.camera_source import final_sweeps, order_0_source
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.iteration import iterate_source
from cldit.transport.discrete_ordinates.moment_source import moment_source
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.result import Settings
from cldit.transport.source_iteration import thick_region
from cldit.transport.view import View, check_boundary

Floats = NDArray[np.float64]


def source_function(
    tree: Octree,
    scene: Scene,
    device: Device,
    settings: Settings,
    boundary: Mapping[str, float],
) -> Floats:
    """The source function of stored cells and coarse leaves.

    Args:
        tree, scene: the medium, and its camera and boundary.
        device: solves.
        settings: of a precision other than `auto`.
        boundary: radiance that leaves `background`, `wall` and each patch, photons s-1 m-2 sr-1.

    Returns:
        (P,) in the tree's addresses, photons s-1 m-2 sr-1.

    Raises:
        NotConvergedError: the source does not reach the tolerance.
        TransportError: the medium reaches behind the background.
        DeviceError, KernelError: the device cannot do it.
    """
    cells = OpticalCells.of(tree, patches=tuple(patch.name for patch in scene.patches))
    source = np.zeros(len(cells.depth))
    for emitted in cells.emitted.values():
        source += cells.scale * emitted
    if not cells.needs.scattering:
        return source
    if settings.order == 0:
        camera = order_0_source(cells, settings.real)
    else:
        view = View.of(scene, cells)
        check_boundary(scene, cells, view)
        region = thick_region(cells, settings)
        problem = SweepProblem.of(cells, region, scene, view, device, settings)
        rng = np.random.default_rng(settings.seed)
        camera = final_sweeps(
            problem, moment_source(problem, iterate_source(problem, rng, None), rng)
        )
    mean = np.mean(camera.halves, axis=0, dtype=np.float64)
    units = [boundary.get(name, cells.scale) for name in cells.needs.components]
    source[cells.address] = np.asarray(units) @ mean
    return source
