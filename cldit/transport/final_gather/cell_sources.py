"""The sources that paths of the final gather meet in the cells of the thick region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Program
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.moment_source import FinalSource, Light, limited
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.thick_region import ThickRegion

# With a phase function the last sweeps see how light changes across cells of no larger optical
# depth: of deeper ones the camera sees too little.
_SEEN_THROUGH = 4.0


@dataclass(frozen=True)
class CellSources:
    """What flights from thick cells meet, and end in.

    directions, light, program: of the last sweeps. records: see `ThickRegion.records`.
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
    work: SweepProblem,
    thick: ThickRegion,
    last: FinalSource,
    *,
    light: NDArray[np.floating],
    changes: NDArray[np.floating] | None,
) -> NDArray[np.floating]:
    """What flights meet: the cells' sources, as the last sweeps took them or as these found them.

    light (C, N): in the cells, as the last sweeps found it; changes (3, C, K): how it changes
    across the cells `linear_cells`, if they found that, too. It is from more directions than the
    sources that they took, and one pass nearer to the end: what light changes across a cell is
    also made by how the source does. It would be an order more where that is fixed.
    """
    sweeper, source, order = last.sweeper, last.source, work.settings.order
    if order is None and changes is not None:
        source = _found(work, sweeper, source, light, changes)
    known = source.changes
    if known is None and sweeper.gradients is not None:
        known = sweeper.gradients(source.moments[: sweeper.components])
    deep = work.settings.deep if order is None else None
    return thick.records(
        work.seen, last.cells, source.moments, known, sweeper.linear_cells, deep=deep
    )


def _found(
    work: SweepProblem,
    sweeper: Sweeper,
    source: Light,
    light: NDArray[np.floating],
    changes: NDArray[np.floating],
) -> Light:
    """The source of cells in which the last sweeps found this light. Its mean, too, without a phase
    function: with one they know only what goes to the camera."""
    some, moments, known = sweeper.linear_cells, source.moments, source.changes
    even = work.settings.phase is None
    if even:
        moments = sweeper.albedo.astype(light.dtype) * light + sweeper.thermal
    found = limited(sweeper, changes, moments)
    if not even and known is not None:
        depth = work.seen.depth[work.seen.address[some]]
        found = np.where(depth < _SEEN_THROUGH, found, known)
    return Light(moments, found)
