"""What the sweeps of one trace have in common: the medium, the programs, the ordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gradients import diffusion_matters
from cldit.transport.discrete_ordinates.quadrature import Ordinates, about_camera, for_boundary
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.result import Settings
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import View

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SweepProblem:
    """One trace's transport problem, as the stages of `trace_source` take it.

    medium: the cells with all of their scattering. region: thick cells, which the final gather
    refines; None: there are none. update: kernels between sweeps. solver_defines: of the solver's
    sweeps, beside `defines`. linear_cells (N,): scattering cells whose source in the final sweeps
    is linear in place; None: no cell's is. final_program: of the final sweeps.
    """

    medium: OpticalCells
    region: ThickRegion | None
    scene: Scene
    view: View
    device: Device
    settings: Settings
    defines: Mapping[str, Define]
    update: Program
    solver_defines: Mapping[str, Define]
    linear_cells: NDArray[np.bool_] | None
    final_program: Program

    @classmethod
    def of(
        cls,
        medium: OpticalCells,
        region: ThickRegion | None,
        scene: Scene,
        view: View,
        device: Device,
        settings: Settings,
    ) -> SweepProblem:
        """Chooses what the sweeps must know, and builds the program of the final ones.

        Raises:
            DeviceError, KernelError: the device cannot do it.
        """
        share = 1.0 if settings.phase is None else 1.0 - settings.phase.asymmetry
        tuning = settings.tuning
        linear = medium.depth[medium.address] > tuning.linear_depth
        linear_cells = linear if settings.linear_sources and linear.any() else None
        solver_defines: dict[str, Define] = {}
        if diffusion_matters(medium, scattered=share, tuning=tuning):
            solver_defines["LINEAR_SOURCE"] = 1
        defines = settings.defines(medium, view)
        sweep_defines = {**defines, **simd_defines(device)}
        flags = {**solver_defines, **_source_defines(settings, linear_cells)}
        if settings.phase is not None:
            flags.update(CAMERA_SWEEP=1, PHASE_STEPS=PHASE_STEPS)
        if not settings.within_cells:
            flags.update(CAMERA_SWEEP=1, VIEW_TRANSMISSION=1)
        many = tuning.spatial_from if settings.phase is None else tuning.spatial_from_phase
        if linear_cells is not None and settings.final_directions >= many:
            flags["SPATIAL_MOMENTS"] = 1
        if region is not None:
            flags["INTERFACE_RADIANCE"] = 1
        return cls(
            medium=medium,
            region=region,
            scene=scene,
            view=view,
            device=device,
            settings=settings,
            defines=sweep_defines,
            update=build(device, "source_update.cl", defines),
            solver_defines=solver_defines,
            linear_cells=linear_cells,
            final_program=build(device, "sweep.cl", {**sweep_defines, **flags}),
        )

    @property
    def isotropic(self) -> bool:
        """Neither a phase function nor linear sources: the solver's source is all there is."""
        return self.settings.phase is None and self.linear_cells is None

    def scattering_scaled(self, share: float) -> OpticalCells:
        """The medium of which this share of the scattering counts."""
        if share == 1.0:
            return self.medium
        cells = OpticalCells.of(
            self.medium.tree, patches=self.medium.needs.patches, scattered=share
        )
        return cells.in_units_of(self.medium)

    def program(self, flags: Mapping[str, Define]) -> Program:
        """sweep.cl with these defines besides."""
        return build(self.device, "sweep.cl", {**self.defines, **flags})

    def moment_program(self) -> Program:
        """The sweep that finds those moments of the light which the final sources need."""
        flags = {**self.solver_defines, **_source_defines(self.settings, self.linear_cells)}
        if "MOMENT_SOURCE" in flags:
            flags["ANGULAR_MOMENTS"] = 1
        if self.linear_cells is not None:
            flags["SPATIAL_MOMENTS"] = 1
        return self.program(flags)

    def sweeper(
        self, cells: OpticalCells, sweep: Program, linear_cells: NDArray[np.bool_] | None = None
    ) -> Sweeper:
        """A sweeper of this trace's box; see `Sweeper`."""
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
    def forward_fraction(self) -> float:
        """Share f of the scattering that delta-M takes for none in the final sweeps. At a fixed
        order it is one scattering as any other."""
        phase, settings = self.settings.phase, self.settings
        if phase is None or settings.order is not None or not settings.tuning.delta_m:
            return 0.0
        return phase.forward

    @property
    def half(self) -> int:
        """Ordinates of either half of the final sweeps."""
        return self.settings.final_directions // 2

    @property
    def moment_ordinates(self) -> int:
        """Ordinates of all moment sweeps, which make the source forget the solver's."""
        return self.settings.tuning.moment_share * self.settings.directions

    @property
    def moment_sweeps(self) -> int:
        """In which these go: in two, where half of them suffice, gradients are nearer to what
        linear sources bring (slabs of 0.75 a cell err by a quarter less)."""
        enough = self.moment_ordinates >= self.settings.tuning.moment_sweeps_from
        return 2 if self.settings.phase is None and enough else 1

    def solver_ordinates(self, sweeper: Sweeper, rng: np.random.Generator) -> DeviceOrdinates:
        """The few ordinates along which GMRES solves."""
        all_of, tuning = self.settings.directions, self.settings.tuning
        count = min(max(tuning.solver_fewest, round(tuning.solver_share * all_of)), all_of)
        return self.ordinates(sweeper, count, rng)

    def ordinates(self, sweeper: Sweeper, count: int, rng: np.random.Generator) -> DeviceOrdinates:
        """Ordinates over the sphere, with balanced weights."""
        return sweeper.rays(
            self._over_sphere(sweeper, count, rng).balanced(), rng.random((count, 2))
        )

    def camera_ordinates(
        self, sweeper: Sweeper, rng: np.random.Generator
    ) -> tuple[DeviceOrdinates, DeviceOrdinates]:
        """Both halves of the ordinates from which light is scattered to the camera."""
        phase, count = self.settings.phase, 2 * self.half
        if phase is not None:
            one, other = (half.by_axis() for half in about_camera(count, rng, phase).halves())
        else:
            both = self._over_sphere(sweeper, count, rng, self.settings.tuning.lean).halves()
            one, other = (half.by_axis().balanced() for half in both)
        starts = rng.random((count, 2))
        return sweeper.rays(one, starts[: self.half]), sweeper.rays(other, starts[self.half :])

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
            enclosure=self.scene.background.shape == "enclosure",
            lean=lean,
        )


def _source_defines(
    settings: Settings, linear_cells: NDArray[np.bool_] | None
) -> dict[str, Define]:
    """What the sources of the sweeps after the solver have."""
    flags: dict[str, Define] = {}
    if settings.phase is not None:
        flags["MOMENT_SOURCE"] = 1
    if linear_cells is not None:
        flags["LINEAR_SOURCE"] = 1
    return flags
