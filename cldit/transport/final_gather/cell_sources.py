"""The sources that paths of the final gather meet in the cells of the thick region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Program
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.iteration import Moments
from cldit.transport.discrete_ordinates.moment_source import FinalSource, limited_gradient
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.thick_region import ThickRegion


@dataclass(frozen=True)
class CellSources:
    """What path segments from thick cells meet, and end in.

    directions, light, program: of the final sweeps. records: see `ThickRegion.records`.
    """

    directions: Ordinates
    light: InterfaceRadiance
    program: Program
    records: NDArray[np.floating]

    @property
    def depth(self) -> NDArray[np.floating]:
        """(R,) optical depth of the cells' edges, times -1 of deep ones, as in path_segment.h."""
        depth, albedo = self.records[:, :2].T
        return np.asarray(np.where(albedo > 0, -depth, depth))


def records(
    problem: SweepProblem,
    region: ThickRegion,
    final: FinalSource,
    *,
    light: NDArray[np.floating],
    gradient: NDArray[np.floating] | None,
) -> NDArray[np.floating]:
    """Records of the region's cells: their sources, as the final sweeps took or found them.

    light (C, N): in the cells, as the final sweeps found it; gradient (3, C, K): across the linear
    cells, if they found that, too. It is from more ordinates than the sources that they took, and
    one iteration nearer to the end: what light changes across a cell is also made by how the source
    does. Where the order is fixed it would be an order more.
    """
    sweeper, source, order = final.sweeper, final.source, problem.settings.order
    if order is None and gradient is not None:
        source = _found(problem, final, light, gradient)
    known = source.gradient
    if known is None and sweeper.gradients is not None:
        known = sweeper.gradients(source.angular[: sweeper.components])
    deep = problem.settings.path_depth if order is None else None
    return region.records(
        problem.medium,
        final.medium,
        source.angular,
        known,
        sweeper.linear_cells,
        deep=deep,
        tuning=problem.settings.tuning,
    )


def _found(
    problem: SweepProblem,
    final: FinalSource,
    light: NDArray[np.floating],
    gradient: NDArray[np.floating],
) -> Moments:
    """The source of cells in which the final sweeps found this light. Its mean, too, without a
    phase function: with one they know only what goes to the camera."""
    sweeper, angular, known = final.sweeper, final.source.angular, final.source.gradient
    isotropic = problem.settings.phase is None
    if isotropic:
        angular = sweeper.albedo.astype(light.dtype) * light + sweeper.thermal
    found = limited_gradient(sweeper, gradient, angular)
    if not isotropic and known is not None:
        depth = problem.medium.depth[problem.medium.address[sweeper.linear_cells]]
        # Of deeper cells the camera sees too little to tell it.
        found = np.where(depth < problem.settings.tuning.gradient_depth, found, known)
    return Moments(angular, found)
