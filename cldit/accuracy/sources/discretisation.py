"""Errors by wavelengths, cells and ordinates, whose numbers multiply each other's cost.

The error of the wavelengths is estimated where they are chosen; that of the cells by Richardson
extrapolation from images on three grids; that of ordinates, iteration and final gather from the
halves of the trace and its audit.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cldit.accuracy.errors import NO_PIXEL, Cause, Estimate
from cldit.accuracy.resolution import Resolution, cells_are_free
from cldit.accuracy.richardson import SAFE, error_at, extrapolated
from cldit.accuracy.sources.base import MOST_SWEPT, ErrorSource, remedies
from cldit.accuracy.sources.omissions import CUTOFF, GATHER
from cldit.accuracy.trace_error import TraceError
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.medium.resolution import counted, in_whole_cells
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.scene import Scene
from cldit.scene.spray import GridSpray

_FEWEST_K = 0.4  # for which, and for any larger error, a trace has its fewest ordinates
_LEAST_MORE = 2.0  # times the ordinates of a trial: less is lost in the audit's own error


class _Wavelengths(ErrorSource):
    """The number of wavelengths; `cldit.optics.wavelengths` knows the error of each number."""

    name = "wavelengths"
    shared_by = "optics"
    cost_power = 1.0  # the error falls about as one over their number
    remedy = remedies(
        "more optics.wavelengths",
        "optics.wavelengths",
        optics__spectral_error_K="a smaller optics.spectral_error_K, or none, so that the run "
        "chooses",
    )

    def is_free(self, scene: Scene) -> bool:
        return scene.optics.preset == "spectral" and not self.key(scene)

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        chosen = at.prepared.properties.chosen
        if not chosen.errors_K:
            return []
        method = f"{len(chosen.nodes)} nodes against more, on lines of sight through the spray"
        cause = Cause(self.name, chosen.error_K, method)
        return [Estimate(cause, kelvin_per_emissivity(at.scene) * chosen.error_emissivity)]

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        return replace(old, spectral_K=_bounded(share_K))


def spectral_K(scene: Scene, share_K: float) -> float:
    """Error asked of the wavelengths for a share: that of the scene where it sets one."""
    fixed_K = scene.optics.spectral_error_K
    return _bounded(share_K) if fixed_K is None else fixed_K


def _bounded(share_K: float) -> float:
    return min(max(share_K, 1e-3), 100.0)  # as the scene's own key


class _Cells(ErrorSource):
    """The cells of the medium, which are the lattice of a cone as well where both are free."""

    name = "cells"
    shared_by = "cells"
    of_cells = True
    also = ("order of the cells",)
    cost_power = 3.0  # the number of cells grows as h^-3, the error falls at least as h
    remedy = remedies(
        "a smaller domain.leaf_edge_m",
        "domain.leaf_edge_m",
        domain__rule="domain.rule: need, or a smaller domain.leaf_edge_m",
    )

    def is_free(self, scene: Scene) -> bool:
        return cells_are_free(scene) and not isinstance(scene.spray, GridSpray)

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        assert at.image is not None
        # In whole voxels only the light has an error, which a trace by `path` sees as a whole.
        if isinstance(at.scene.spray, GridSpray):
            in_voxels = in_whole_cells(at.frame(at.cell_m), at.prepared.sources)
            return [] if at.exact and in_voxels else [self._by_finer(at)]
        at.tell("errors: other cells")
        estimates = error_at(at, at.cell_m)
        if estimates is None:
            too_coarse = 4 * at.cell_m > at.prepared.cube.edge_m * (1 + 1e-9)
            reason = "too few halvings of the cube to compare" if too_coarse else NO_PIXEL
            return [Estimate.unknown(self.name, reason)]
        cell_mm = 1e3 * at.cell_m
        sizes = ", ".join(f"{cell_mm * up:.3g}" for up in estimates[0].sizes)
        subject = "cone and cells" if at.prepared.on_lattice else "cells"
        out = [extrapolated(self.name, f"{subject} of {sizes} mm", estimates)]
        if self.key(at.scene) and not estimates[0].shown:
            reason = f"cells of {sizes} mm show no order of convergence between 1 and 2"
            out.append(Estimate.unknown(self.also[0], reason))
        return out

    def _by_finer(self, at: VariantTracer) -> Estimate:
        """Error of a grid whose voxels are its cells: larger cells mix voxels, smaller do not."""
        cube = at.prepared.cube
        cells = 8 * counted(cube, at.prepared.sources, at.prepared.device).swept
        if cells > MOST_SWEPT:
            reason = (
                f"cells half as large are {cells:.2g}, which would take longer than the image; "
                "compare with a run of half the domain.leaf_edge_m"
            )
            return Estimate.unknown(self.name, reason)
        at.tell("errors: cells half as large")
        halved = at.level(at.cell_m / 2)
        differences = at.difference(at.level(at.cell_m), halved)
        h_mm = 1e3 * at.cell_m
        method = f"cells of {h_mm / 2:.3g} mm for {h_mm:.3g} mm: twice the step, by the first order"
        return Estimate.of(self.name, [step.times(2.0) for step in differences], method)

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        if old.depth is None:
            return old
        if old.cube_m is None:
            return old.at_depth(old.depth + 1)
        assert old.spacing_m is not None
        less = (SAFE / ratio) ** (1.0 / order)
        return old.on_lattice(old.spacing_m * max(less, 0.5))


class _Ordinates(ErrorSource):
    """The ordinates of a trace, or its random samples."""

    name = "trace"
    shared_by = "seed"
    cost_power = 1.5  # the error falls with the number of ordinates to the power -2/3
    remedy = remedies(
        "more transport.directions or a larger transport.max_samples, or, for the part that only "
        "the audit shows, transport.method: path, or domain.leaf_edge_m of half the voxels of a "
        "grid",
        transport__directions="more transport.directions, or none, so that the run chooses",
    )

    def is_free(self, scene: Scene) -> bool:
        droplets = getattr(scene.spray, "droplets", True) is not None
        return scene.transport.directions is None and droplets

    def estimate(self, at: VariantTracer) -> list[Estimate]:
        if not at.trace_errors:
            return []
        temperature, *rest = beyond(at)
        if temperature.error_K is None:
            return [Estimate.unknown(self.name, temperature.unknown)]
        method = "half the difference of two images, each by half of the ordinates or samples"
        if temperature.audit_K is not None:
            method = "some pixels traced by `path`, one standard error added, less the cells'"
        method += "; contains ordinates, iteration and gather"
        maps_K = [error.map_K for error in (temperature, *rest) if error.map_K is not None]
        cause, unknown = Cause(self.name, temperature.error_K, method), temperature.unknown
        out = [Estimate(cause, rest[0].error_K, maps_K)]
        return out + ([Estimate.unknown("audit", unknown)] if unknown else [])

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        finer = ratio**self.cost_power
        now_K, then_K = old.ordinates_K, old.ordinates_K / finer
        factor = finer * max(1.0, _FEWEST_K / now_K) / max(1.0, _FEWEST_K / then_K)
        factor *= old.more_ordinates
        return replace(old, ordinates_K=then_K, more_ordinates=factor)

    def denser(self, resolution: Resolution, ratio: float) -> Resolution:
        """More ordinates with as many paths: a trial for an error that both halves share."""
        factor = max(ratio**self.cost_power, _LEAST_MORE)
        return replace(resolution, more_ordinates=factor * resolution.more_ordinates)


def beyond(at: VariantTracer) -> tuple[TraceError, ...]:
    """Errors of the trace without what other sources state and the audit sees, too.

    `path` samples sources within cells, and follows rays to a cutoff of its own.
    """
    if all(error.audit_K is None for error in at.trace_errors):
        return tuple(at.trace_errors)
    stated = zip(*(source.errors_K(at) for source in (CELLS, CUTOFF, GATHER)), strict=True)
    pairs = zip(at.trace_errors, stated, strict=False)
    return tuple(
        replace(error, cells_K=math.hypot(*(e or 0.0 for e in errors))) for error, errors in pairs
    )


WAVELENGTHS, CELLS, ORDINATES = _Wavelengths(), _Cells(), _Ordinates()
