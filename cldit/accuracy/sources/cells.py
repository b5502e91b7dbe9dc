"""Error by the size of the cells, by Richardson extrapolation from two coarser grids."""

from __future__ import annotations

from typing import ClassVar

from cldit.accuracy.errors import NO_PIXEL, Cause, Estimate
from cldit.accuracy.resolution import Resolution, cells_are_free
from cldit.accuracy.richardson import error_at, predicted_error
from cldit.accuracy.sources.base import OR_NONE, ErrorSource, Excess, Measurement
from cldit.medium.resolution import in_whole_cells, swept_cells
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import GridSpray

_FINER_CELLS = 4e6  # swept, in a trace that estimates the error of a grid's voxels
_SAFE = 0.9  # of the share, which a finer lattice aims at


class _Cells(ErrorSource):
    """The cells of the medium, which are the lattice of a cone as well where both are free."""

    name = "cells"
    shared_by = "cells"
    also = ("order of the cells",)
    cost_power = 3.0  # the number of cells grows as h^-3, the error falls at least as h
    remedy: ClassVar = {
        "": "a smaller domain.leaf_edge_m",
        "domain.leaf_edge_m": f"a smaller domain.leaf_edge_m{OR_NONE}",
        "domain.rule": "domain.rule: need, or a smaller domain.leaf_edge_m",
    }

    def key(self, scene: Scene) -> str:
        if scene.domain.leaf_edge_m is not None:
            return "domain.leaf_edge_m"
        return "domain.rule" if scene.domain.rule == "paper" else ""

    def is_free(self, scene: Scene) -> bool:
        return cells_are_free(scene) and not isinstance(scene.spray, GridSpray)

    def predict(self, at: Measurement) -> list[Estimate]:
        """The error of cells that the scene fixes, by larger ones."""
        if isinstance(at.scene.spray, GridSpray):
            return []
        error_K, at_most = predicted_error(at.tracer, at.prepared.cube.depth)
        return [Estimate(Cause(self.name, error_K, "by larger ones", at_most=at_most))]

    def estimate(self, at: Measurement) -> list[Estimate]:
        assert at.solved is not None
        # In exact cells only the light has an error, which a trace by `path` sees as a whole.
        if at.solved.by_path and _exact(at.prepared, at.depth, at.scene):
            return []
        fixed = self.key(at.scene)
        if isinstance(at.scene.spray, GridSpray):
            return [self._by_finer(at, fixed)]
        at.stages.tell("errors: larger cells")
        found = error_at(at.tracer, at.depth)
        if found is None:
            why = "too few halvings of the cube to compare" if at.depth < 2 else NO_PIXEL
            return [Estimate.unknown(self.name, why, fixed)]
        cell_mm = 1e3 * at.prepared.cube.at(at.depth).cell_m
        sizes = ", ".join(f"{cell_mm * up:.3g}" for up in found.sizes)
        what = "cone and cells" if at.prepared.on_lattice else "cells"
        how = f"{what} of {sizes} mm, extrapolated by order {found.order:.2g}"
        out = [Estimate.of(self.name, found.difference, how, fixed, order=found.order)]
        if fixed and not found.shown:
            why = f"cells of {sizes} mm show no order of convergence between 1 and 2"
            out.append(Estimate.unknown(self.also[0], why, fixed))
        return out

    def _by_finer(self, at: Measurement, fixed: str) -> Estimate:
        """Error of a grid whose voxels are its cells: larger cells mix voxels, smaller do not."""
        cube = at.prepared.cube
        cells = swept_cells(cube, at.prepared.sources) * 8
        if cells > _FINER_CELLS:
            why = (
                f"cells half as large are {cells:.2g}, which would take longer than the image; "
                "compare with a run of half the domain.leaf_edge_m"
            )
            return Estimate.unknown(self.name, why, fixed)
        at.stages.tell("errors: cells half as large")
        found = at.tracer.difference(at.tracer.level(at.depth), at.tracer.level(at.depth + 1))
        h_mm = 1e3 * cube.at(at.depth).cell_m
        how = f"cells of {h_mm / 2:.3g} mm for {h_mm:.3g} mm: twice the step, by the first order"
        return Estimate.of(self.name, found.times(2.0), how, fixed)

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        if resolution.depth is None:
            return resolution
        if resolution.cube_m is None:
            return resolution.at_depth(resolution.depth + 1)
        assert resolution.spacing_m is not None
        less = (_SAFE / excess.ratio) ** (1.0 / excess.order)
        return resolution.on_lattice(resolution.spacing_m * max(less, 0.5))


def _exact(prepared: Prepared, depth: int, scene: Scene) -> bool:
    """True if cells are the voxels of a user's grid, or parts of them."""
    return isinstance(scene.spray, GridSpray) and in_whole_cells(
        prepared.cube.at(depth), prepared.sources
    )


CELLS = _Cells()
