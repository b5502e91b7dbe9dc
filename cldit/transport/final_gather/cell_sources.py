"""Sources and stored radiance that paths of the final gather collect (stage 5)."""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Reals
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.moment_source import FinalSource
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.thick_region import ThickRegion


@dataclass(frozen=True)
class CellSources:
    """Sources of the thick region's cells, and the radiance at the ends of path segments.

    directions, light, program: ordinates, stored radiance and program of the final sweeps.
    records: (R, ...), see `ThickRegion.records`.
    """

    directions: Ordinates
    light: InterfaceRadiance
    program: Program
    records: Reals

    @property
    def depth(self) -> Reals:
        """Optical depth (R,) of the cells' edges, negative if paths continue (path_segment.h)."""
        depth, albedo = self.records[:, :2].T
        return np.asarray(np.where(albedo > 0, -depth, depth))


def records(
    problem: SweepProblem,
    region: ThickRegion,
    final: FinalSource,
    *,
    light: Reals,
    gradient: Reals | None,
) -> Reals:
    """Records (R, ...) of the region's cells, see `ThickRegion.records`.

    The sources are those after the final sweeps, which have more ordinates and are one iteration
    further, or at a fixed order those before, since the others would be one order higher.
    `light` (C, N) is the mean radiance of the cells from the final sweeps, and `gradient` (3, C, K)
    its gradient in the linear cells; None: it was not accumulated.
    """
    sweeper, source, order = final.sweeper, final.source, problem.settings.order
    moments = 1 if problem.settings.phase is None else MOMENTS
    angular, source_gradient = sweeper.read(source.angular, moments), None
    if source.gradient is not None:
        source_gradient = sweeper.read_gradient(source.gradient)
    if order is None and gradient is not None:
        angular, source_gradient = _updated(
            problem, sweeper, angular, source_gradient, light=light, gradient=gradient
        )
    if source_gradient is None and sweeper.gradients is not None:
        source_gradient = sweeper.gradients(angular[: sweeper.components])
    return region.records(
        problem.medium,
        final.medium,
        angular,
        source_gradient,
        sweeper.linear_cells,
        path_depth=problem.settings.path_depth if order is None else None,
        tuning=problem.settings.tuning,
    )


def _updated(
    problem: SweepProblem,
    sweeper: Sweeper,
    angular: Reals,
    source_gradient: Reals | None,
    *,
    light: Reals,
    gradient: Reals,
) -> tuple[Reals, Reals]:
    """Source and its gradient from the radiance of the final sweeps.

    With a phase function these give only the source to the camera, so the mean is not updated.
    """
    isotropic, source = problem.settings.phase is None, sweeper.source
    if isotropic:
        source = angular = sweeper.albedo.astype(light.dtype) * light + sweeper.thermal
    updated = sweeper.read_gradient(sweeper.limited_gradient(gradient, source))
    if not isotropic and source_gradient is not None:
        depth = problem.medium.depth[problem.medium.address[sweeper.linear_cells]]
        # The radiance towards the camera does not give the gradients of thicker cells.
        updated = np.where(depth < problem.settings.tuning.gradient_depth, updated, source_gradient)
    return angular, updated
