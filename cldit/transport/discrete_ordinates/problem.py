"""What one trace sweeps through: its media, its programs, its directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program, build
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gmres import (
    Solution,
    defect_correction,
    gmres,
    next_order,
    order_0,
)
from cldit.transport.discrete_ordinates.gradients import diffusion_matters
from cldit.transport.discrete_ordinates.quadrature import Ordinates, about_camera, for_boundary
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.result import Settings
from cldit.transport.thick_region import ThickRegion
from cldit.transport.view import View

Floats = NDArray[np.float64]

# Optical depth of cells across which sources change in the last sweeps, and light is found to: in
# others that is little beside how much it depends on chance, with as many directions as there are.
_CHANGING = 0.15
# With fewer last directions and a phase function, neighbours tell as well how the light changes
# that the camera sees; without one, sweeps tell better from a few dozen on (`gdi`, 0.1 K asked:
# 0.083 K for 0.085 over every seventh pixel, 0.085 for 0.11 over every fifth).
_MANY = 256
_MANY_EVENLY = 48
# Directions of the solver, and of the sweep before the last, over those which correct it.
_SOLVED, _FORGETTING = 1 / 8, 2
_FEWEST = 16  # with 8, slabs err by 0.1 %: the second order of what these miss
# RMS error of what is solved along so few, before it is corrected: they differ from more by no
# less, and GMRES goes on from there.
_ROUGH = 1e-2
# By how much the last directions without a phase function are denser on the camera's side, from
# which most of what it sees of thick cells is lit: least error on `gdi`, between 0.4 and 0.9.
_LEAN = 0.6
_TWO_PASSES = 128  # directions from which two passes share them: with less each, `gdi` errs by more
_CHECKED = 8  # directions on which the sweeps are checked for what they make or lose


@dataclass(frozen=True)
class SweepProblem:
    """One trace's.

    seen: the medium as it is. solver: defines of the solver's sweeps, beside `defines`. changing
    (N,): scattering cells across which the sources of the last sweeps change; None: there are none.
    """

    seen: OpticalCells
    scene: Scene
    view: View
    device: Device
    settings: Settings
    defines: Mapping[str, Define]
    iterate: Program
    solver: Mapping[str, Define]
    linear_cells: NDArray[np.bool_] | None

    @classmethod
    def of(
        cls,
        seen: OpticalCells,
        scene: Scene,
        view: View,
        device: Device,
        settings: Settings,
        defines: Mapping[str, Define],
    ) -> SweepProblem:
        isotropic_source = 1.0 if settings.phase is None else 1.0 - settings.phase.asymmetry
        linear_cells = seen.depth[seen.address] > _CHANGING
        return cls(
            seen,
            scene,
            view,
            device,
            settings,
            {**defines, **simd_defines(device)},
            build(device, "source_update.cl", defines),
            {"LINEAR_SOURCE": 1} if diffusion_matters(seen, scattered=isotropic_source) else {},
            linear_cells if settings.linear_sources and linear_cells.any() else None,
        )

    def cells(self, scattered: float) -> OpticalCells:
        """The medium of which this share of the scattering counts."""
        if scattered == 1.0:
            return self.seen
        cells = OpticalCells.of(
            self.seen.tree, patches=self.seen.needs.patches, scattered=scattered
        )
        return cells.in_units_of(self.seen)

    def program(self, flags: Mapping[str, Define]) -> Program:
        return build(self.device, "sweep.cl", {**self.defines, **flags})

    @property
    def sources(self) -> dict[str, Define]:
        """What the sources of the sweeps after the solver have."""
        flags = dict(self.solver)
        if self.settings.phase is not None:
            flags["MOMENT_SOURCE"] = 1
        if self.linear_cells is not None:
            flags["LINEAR_SOURCE"] = 1
        return flags

    def finding(self) -> Program:
        """The sweep that finds as much of the light as these sources need."""
        flags = self.sources
        if "MOMENT_SOURCE" in flags:
            flags["ANGULAR_MOMENTS"] = 1
        if self.linear_cells is not None:
            flags["SPATIAL_MOMENTS"] = 1
        return self.program(flags)

    def towards(self, thick: ThickRegion | None) -> Program:
        """The sweep to the camera."""
        flags = self.sources
        if self.settings.phase is not None:
            flags.update(CAMERA_SWEEP=1, PHASE_STEPS=PHASE_STEPS)
        if not self.settings.within_cells:
            flags.update(CAMERA_SWEEP=1, VIEW_TRANSMISSION=1)
        many = _MANY_EVENLY if self.settings.phase is None else _MANY
        if self.linear_cells is not None and self.settings.final_directions >= many:
            flags["SPATIAL_MOMENTS"] = 1
        if thick is not None:
            flags["INTERFACE_RADIANCE"] = 1
        return self.program(flags)

    def sweeper(
        self, cells: OpticalCells, sweep: Program, linear_cells: NDArray[np.bool_] | None = None
    ) -> Sweeper:
        return Sweeper(
            self.device,
            cells,
            sweep,
            self.iterate,
            disc=self.view.disc,
            patches=self.view.patches,
            linear_cells=linear_cells,
        )

    @property
    def forward(self) -> float:
        """Share of the scattering that the last sweeps count as none: what goes nearly straight on
        (delta-M). At a fixed order it is one scattering as any other."""
        phase = self.settings.phase
        return 0.0 if phase is None or self.settings.order is not None else phase.forward

    @property
    def half(self) -> int:
        """Of the last directions."""
        return self.settings.final_directions // 2

    @property
    def more(self) -> int:
        """Directions that correct the solution."""
        return self.settings.directions

    @property
    def most(self) -> int:
        """Directions of the sweeps before the last, which make the source forget those."""
        return _FORGETTING * self.more

    @property
    def passes(self) -> int:
        """In which these go: in two, where half of them suffice, light across cells is nearer to
        what sources that change bring (slabs of 0.75 a cell err by a quarter less)."""
        return 2 if self.settings.phase is None and self.most >= _TWO_PASSES else 1

    def solution(
        self,
        sweeper: Sweeper,
        rng: np.random.Generator,
        report: Callable[[str], None] | None,
    ) -> tuple[Solution, DeviceOrdinates]:
        """Along few directions, and these; to be `defect_correction`."""
        count = min(max(_FEWEST, round(_SOLVED * self.more)), self.more)
        few = self.rays(sweeper, count, rng)
        guess = order_0(sweeper, sweeper.albedo)
        tolerance = max(_ROUGH, self.settings.tolerance)
        rough = gmres(sweeper, guess, few, tolerance=tolerance, report=report, confirmed=False)
        return rough, few

    def defect_correction(
        self,
        sweeper: Sweeper,
        solution: Solution,
        few: DeviceOrdinates,
        report: Callable[[str], None] | None,
        listed: Any = None,
    ) -> tuple[Solution, NDArray[Any]]:
        """See `gmres.defect_correction`."""
        tolerance = self.settings.tolerance
        return defect_correction(
            sweeper, solution, few, tolerance=tolerance, report=report, listed=listed
        )

    def scattered(self, sweeper: Sweeper, rng: np.random.Generator, times: int) -> Solution:
        """Of a fixed order: so many times, in the sweeper's cells, along half of the last
        directions each."""
        source = order_0(sweeper, sweeper.albedo)
        for _ in range(times):
            source = next_order(sweeper, source, self.rays(sweeper, self.half, rng))
        return Solution(source, self.settings.order or 0, 0.0, 0.0)

    def checked(self, sweeper: Sweeper, solution: Solution) -> tuple[Solution, Floats]:
        """The solution, and what sweeps and solver make or lose of a cavity's radiance of 1 (N,),
        in which what it lacks has gone."""
        rng = np.random.default_rng([self.settings.seed, 2])  # no other directions depend on it
        defect = sweeper.defect(solution.source, self.rays(sweeper, _CHECKED, rng))
        if solution.residual is not None:
            defect -= solution.residual[: self.seen.needs.boundaries].sum(axis=0)
        return replace(solution, residual=None), defect

    def rays(self, sweeper: Sweeper, count: int, rng: np.random.Generator) -> DeviceOrdinates:
        """Directions over the sphere."""
        directions = self._over_sphere(sweeper, count, rng).balanced()
        return sweeper.rays(directions, rng.random((count, 2)))

    def to_camera(
        self, sweeper: Sweeper, rng: np.random.Generator
    ) -> tuple[DeviceOrdinates, DeviceOrdinates]:
        """Both halves of the directions from which light is scattered to the camera."""
        phase, count = self.settings.phase, 2 * self.half
        if phase is not None:
            one, other = (half.by_axis() for half in about_camera(count, rng, phase).halves())
        else:
            both = self._over_sphere(sweeper, count, rng, _LEAN).halves()
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


def after_one_scattering(
    solution: Solution, source: NDArray[np.floating], sweeper: Sweeper
) -> Solution:
    """After one scattering more: the source, and what is left of what it lacked."""
    residual = None if solution.residual is None else solution.residual * sweeper.albedo
    return replace(solution, source=source, residual=residual)
