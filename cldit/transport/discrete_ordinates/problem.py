"""Discrete ordinates problem of one trace: medium, programs and ordinates of its sweeps.

Stages 1 to 3 of `trace_source` share it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.transport.cell_phases import phase_moments
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.blurred_boundary import (
    SIDE,
    ForwardPeak,
    blurred_maps,
    upload_blurred,
)
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gradients import diffusion_matters
from cldit.transport.discrete_ordinates.quadrature import Ordinates, about_camera, for_boundary
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.result import TraceInput, TraceSettings
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import View


@dataclass(frozen=True)
class SweepProblem:
    """Transport problem of one trace.

    medium: the cells with all of their scattering.
    region: thick region, which the final gather refines; None: there is none.
    defines: of all sweeps.
    update: program of the kernels between sweeps (source_update.cl).
    solver_defines: of the solver's sweeps, in addition to `defines`.
    linear_cells: (N,) mask of scattering cells with a linear source in the final sweeps; None: no
        cell.
    final_program: of the final sweeps.
    forward_peak: peak that blurs the boundary in these; None: no blur.
    """

    medium: OpticalCells
    region: ThickRegion | None
    view: View
    device: Device
    settings: TraceSettings
    defines: Mapping[str, Define]
    update: Program
    solver_defines: Mapping[str, Define]
    linear_cells: Mask | None
    final_program: Program
    forward_peak: ForwardPeak | None

    @classmethod
    def of(cls, trace_input: TraceInput, region: ThickRegion | None) -> "SweepProblem":
        """Chooses the physics of the sweeps, and builds the program of the final ones."""
        medium, view = trace_input.cells, trace_input.view
        device, settings = trace_input.device, trace_input.settings
        share: float | Floats = 1.0
        if settings.phase is not None:
            share = 1.0 - phase_moments(medium, settings.phase, 2)[1]
        tuning = settings.tuning
        linear = medium.depth[medium.address] > tuning.linear_depth
        linear_cells = linear if settings.linear_sources and linear.any() else None
        solver_defines: dict[str, Define] = {}
        if diffusion_matters(medium, scattered=share, tuning=tuning):
            solver_defines["LINEAR_SOURCE"] = 1
        defines = trace_input.defines
        sweep_defines = {**defines, **simd_defines(device)}
        flags = {**solver_defines, **_source_defines(settings, linear_cells)}
        if settings.phase is not None:
            flags.update(CAMERA_SWEEP=1, PHASE_STEPS=PHASE_STEPS)
            if settings.phase.classes is not None:
                flags["PHASE_CLASSES"] = len(settings.phase.tables)
        if not settings.within_cells:
            flags.update(CAMERA_SWEEP=1, VIEW_TRANSMISSION=1)
        spatial_from = tuning.spatial_from if settings.phase is None else tuning.spatial_from_phase
        if linear_cells is not None and settings.final_directions >= spatial_from:
            flags["SPATIAL_MOMENTS"] = 1
        peak = _forward_peak(settings, view)
        if peak is not None:
            flags["BLURRED_BOUNDARY"] = SIDE
        if region is not None:
            flags["INTERFACE_RADIANCE"] = 1
        return cls(
            medium=medium,
            region=region,
            view=view,
            device=device,
            settings=settings,
            defines=sweep_defines,
            update=build(device, "source_update.cl", sweep_defines),
            solver_defines=solver_defines,
            linear_cells=linear_cells,
            final_program=build(device, "sweep.cl", {**sweep_defines, **flags}),
            forward_peak=peak,
        )

    @property
    def isotropic(self) -> bool:
        """True if neither a phase function nor gradients require a moment source."""
        return self.settings.phase is None and self.linear_cells is None

    def scattering_scaled(self, share: float | Floats) -> OpticalCells:
        """Medium with this `share`, a number, (1,) or (N,), of its scattering; same source unit."""
        if np.all(share == 1.0):
            return self.medium
        everywhere = np.ones(len(self.medium.depth))
        everywhere[self.medium.address] = share
        cells = OpticalCells.of(
            self.medium.tree, patches=self.medium.needs.patches, scattered=everywhere
        )
        return cells.in_units_of(self.medium)

    def program(self, flags: Mapping[str, Define]) -> Program:
        """Program of sweep.cl with these defines in addition to `defines`."""
        return build(self.device, "sweep.cl", {**self.defines, **flags})

    def moment_program(self) -> Program:
        """Program of sweep.cl that accumulates the moments of the final sources."""
        flags = {**self.solver_defines, **_source_defines(self.settings, self.linear_cells)}
        if "MOMENT_SOURCE" in flags:
            flags["ANGULAR_MOMENTS"] = 1
        if self.linear_cells is not None:
            flags["SPATIAL_MOMENTS"] = 1
        return self.program(flags)

    def sweeper(
        self, cells: OpticalCells, sweep: Program, linear_cells: Mask | None = None
    ) -> Sweeper:
        """Sweeper of `cells` by the program `sweep`; `linear_cells` (N,) as in `Sweeper`."""
        return Sweeper(
            self.device,
            cells,
            sweep,
            self.update,
            disc=self.view.disc,
            patches=self.view.patches,
            linear_cells=linear_cells,
            tuning=self.settings.tuning,
        )

    @property
    def forward_fraction(self) -> Floats:
        """Forward fraction f (N,) or (1,) of delta-M for two moments in the final sweeps.

        It is the third moment of the phase function, so that this moment is also correct (Wiscombe,
        J. Atmos. Sci. 34, 1977); 0 at a fixed order, where all scattering counts.
        """
        phase, settings = self.settings.phase, self.settings
        if phase is None or settings.order is not None or not settings.tuning.delta_m:
            return np.zeros(1)
        return np.asarray(np.maximum(phase_moments(self.medium, phase, 4)[3], 0.0))

    def blurred(self, sweeper: Sweeper, directions: Ordinates) -> dict[str, Any]:
        """The boundary blurred by the forward peak along the final ordinates, as kernel arguments;
        none if it stays as it is."""
        if self.forward_peak is None:
            return {}
        maps, frames = blurred_maps(self.view, sweeper.box, directions, self.forward_peak)
        return upload_blurred(self.device, maps, frames, sweeper.real)

    @property
    def half(self) -> int:
        """Ordinates of either half of the final sweeps."""
        return self.settings.final_directions // 2

    @property
    def moment_ordinates(self) -> int:
        """Ordinates of all moment sweeps, which replace the error of the solver's few."""
        return self.settings.tuning.moment_share * self.settings.directions

    def solver_ordinates(self, sweeper: Sweeper, rng: np.random.Generator) -> DeviceOrdinates:
        """Few ordinates along which GMRES solves."""
        all_of, tuning = self.settings.directions, self.settings.tuning
        count = min(max(tuning.solver_fewest, round(tuning.solver_share * all_of)), all_of)
        return self.ordinates(sweeper, count, rng)

    def ordinates(self, sweeper: Sweeper, count: int, rng: np.random.Generator) -> DeviceOrdinates:
        """Ordinates over the sphere, with balanced weights; `rng` rotates them and shifts rays."""
        directions = self._over_sphere(sweeper, count, rng).balanced()
        return sweeper.rays(directions, rng.random((count, 2)))

    def camera_ordinates(
        self, sweeper: Sweeper, rng: np.random.Generator
    ) -> tuple[DeviceOrdinates, DeviceOrdinates]:
        """Both halves of the final ordinates."""
        phase, count = self.settings.phase, 2 * self.half
        if phase is not None:
            half_1, half_2 = (half.by_axis() for half in about_camera(count, rng, phase).halves())
        else:
            halves = self._over_sphere(sweeper, count, rng, self.settings.tuning.lean).halves()
            half_1, half_2 = (half.by_axis().balanced() for half in halves)
        starts = rng.random((count, 2))
        return sweeper.rays(half_1, starts[: self.half]), sweeper.rays(half_2, starts[self.half :])

    def _over_sphere(
        self, sweeper: Sweeper, count: int, rng: np.random.Generator, lean: float = 0.0
    ) -> Ordinates:
        low = np.asarray(sweeper.box.low, float)
        return for_boundary(
            count,
            rng,
            low=low,
            high=low + sweeper.box.shape,
            disc_centre=self.view.disc[:3],
            disc_radius=float(self.view.disc[3]) ** 0.5,
            lean=lean,
        )


def _forward_peak(settings: TraceSettings, view: View) -> ForwardPeak | None:
    """Forward peak that blurs the boundary in the final sweeps; None: no blur.

    A uniform boundary is not blurred.
    """
    alike = view.is_enclosed and not len(view.patches)
    if alike or settings.phase is None or settings.order is not None:
        return None
    tuning = settings.tuning
    blurs = tuning.delta_m and tuning.blurred_boundary
    return ForwardPeak.of(settings.phase) if blurs else None


def _source_defines(settings: TraceSettings, linear_cells: Mask | None) -> dict[str, Define]:
    """Defines of the sources after the solver."""
    flags: dict[str, Define] = {}
    if settings.phase is not None:
        flags["MOMENT_SOURCE"] = 1
    if linear_cells is not None:
        flags["LINEAR_SOURCE"] = 1
    return flags
