"""Measuring what each cause of the medium adds to the error of T_app.

A cause is found by a second trace in which it alone differs: on larger cells, with either half of
the parcels, with parcels spread less, with fewer classes of size, on a coarser lattice, on larger
cells of gas. What does not depend on the cells is traced on cells twice as large as the picture's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from cldit.accuracy.cells import Refined, error_at
from cldit.accuracy.errors import Cause
from cldit.accuracy.picture import Picture, Step
from cldit.accuracy.pilot import Pilot
from cldit.accuracy.pixels import pixel_error
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import in_whole_cells, swept_cells
from cldit.prepare.gas_grid import GasGrid
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, GridSpray, LagrangianSpray

# The bias of the width falls with its fourth power: from a variance to its half goes 3/4 of it.
_OF_WIDTH = 4.0 / 3.0
# Halves of 13,700 parcels of gdi-flow say 0.9 of what seeds show, those of 6,900 say 0.67
# (docs/errors.md): fewer drive the gas, which halves share, more by chance than droplets differ.
_FEWEST_PARCELS = 13_000
_FINER_CELLS = 4e6  # swept, of a trace that is to tell the error of a grid's voxels
_HALF = 0.5  # of the step's square: where chance makes more, it hides what is asked for
_NO_PIXEL = "no pixel has a T_app on either"


@dataclass(frozen=True)
class Budget:
    """Traces variants of a medium, and compares them with it.

    scene: as the user wrote it, whose keys are fixed where they are not left out. depth: of the
    picture's cells.
    """

    scene: Scene
    pilot: Pilot
    depth: int
    say: Callable[[str], None]

    def of_cells(self, picture: Picture, *, audited: bool) -> list[tuple[Cause, Step | None]]:
        """Errors of cells and pixels, which depend on the chosen cells.

        Args:
            picture: (H, W) at the wavelength of the pilot, by `source`.
            audited: whether the error of the trace is by `path`, which sees all of what sources
                miss in the picture's cells; or there are no sources that could.

        Returns:
            Each cause, with its map where there is one.
        """
        self.pilot.kept[self.depth] = self.pilot.picked(picture)
        of_pixels = pixel_error(self.scene, self.pilot.probed, picture)
        return [*([] if audited and self._exact else [self._cells()]), of_pixels]

    def of_cells_by_pilot(self) -> list[tuple[Cause, Step | None]]:
        """The same for a picture by another method, whose noise would hide them."""
        why = "a picture of samples does not tell it; method source does"
        of_pixels = Cause("pixel sampling", None, why, "camera.rays_per_pixel"), None
        by_path = self.scene.transport.method == "path"
        return [*([] if by_path and self._exact else [self._cells()]), of_pixels]

    @property
    def _exact(self) -> bool:
        """Whether the medium is exact in the picture's cells: those of a user's grid are its
        voxels, or parts of them, and what is wrong there is the light alone."""
        frame = replace(self.pilot.probed.frame, depth=self.depth)
        return isinstance(self.scene.spray, GridSpray) and in_whole_cells(
            frame, self.pilot.probed.sources
        )

    def of_sources(self, depth: int | None = None) -> list[tuple[Cause, Step | None]]:
        """Errors of parcels and their width, and of the gas's own grid.

        Args:
            depth: of the cells that all are traced on. None: parcels are on cells twice as large as
                the picture's, the gas on the picture's own: larger ones blur what its cells show.
        """
        out = self._parcels(self._coarse if depth is None else depth)
        gas = self.pilot.probed.gas
        if gas is not None:
            known = {cause.name: cause.error_K for cause, _ in out}
            fine = self.depth if depth is None else depth
            out.append(self._gas_grid(gas, known.get("parcels"), fine))
        return out

    def _gas_grid(
        self, gas: GasGrid, sampling_K: float | None, depth: int
    ) -> tuple[Cause, Step | None]:
        name, how = "gas grid", gas.how
        if gas.sources is None:
            return Cause(name, None, how, gas.fixed), None
        self.say("errors: larger cells of gas")
        try:
            other = self.pilot.variant(name, gas.sources, depth)
        except (MediumError, TransportError) as error:  # it fills more cells, or reaches further
            return Cause(name, None, f"the spray on larger cells of gas: {error}", gas.fixed), None
        whole = self.pilot.step(self.pilot.level(depth), other)
        step, chance = without_chance(whole, sampling_K)
        return _cause(name, step, f"{how}; {chance}", gas.fixed, at_most=step is whole)

    @property
    def _coarse(self) -> int:
        return max(self.depth - 1, 0)

    def _cells(self) -> tuple[Cause, Step | None]:
        domain = self.scene.domain
        fixed = "" if domain.leaf_edge_m is None else "domain.leaf_edge_m"
        if not fixed and domain.rule == "paper":
            fixed = "domain.rule"
        if isinstance(self.scene.spray, GridSpray):
            return self._finer(fixed)
        self.say("errors: larger cells")
        found = error_at(self.pilot, self.depth)
        frame = self.pilot.probed.frame
        if found is None:
            why = "too few halvings of the cube to compare" if self.depth < 2 else _NO_PIXEL
            return Cause("cells", None, why, fixed), None
        cell_mm = 1e3 * frame.edge_m / 2**self.depth
        sizes = [f"{cell_mm * up:.3g}" for up in found.sizes]
        what = "cone and cells" if self.pilot.probed.on_lattice else "cells"
        how = f"{what} of {', '.join(sizes)} mm, extrapolated by order {found.order:.2g}"
        return Cause("cells", found.step.error_K, how, fixed), found.step

    def _finer(self, fixed: str) -> tuple[Cause, Step | None]:
        """Of a grid whose voxels are its cells: larger cells mix voxels, smaller ones do not."""
        probed = self.pilot.probed
        cells = swept_cells(probed.frame, probed.sources) * 8
        if cells > _FINER_CELLS:
            why = (
                f"cells half as large are {cells:.2g}, which would take longer than the picture; "
                "compare with a run of half the domain.leaf_edge_m"
            )
            return Cause("cells", None, why, fixed), None
        self.say("errors: cells half as large")
        step = self.pilot.step(self.pilot.level(self.depth), self.pilot.level(self.depth + 1))
        h_mm = 1e3 * probed.frame.edge_m / 2**self.depth
        how = f"cells of {h_mm / 2:.3g} mm for {h_mm:.3g} mm: twice the step, by the first order"
        return _cause("cells", step.times(2.0), how, fixed)

    def _parcels(self, depth: int) -> list[tuple[Cause, Step | None]]:
        parcels = self.pilot.probed.parcels
        if parcels is None:
            return []
        self.say("errors: either half of the parcels")
        one, other = (
            self.pilot.variant(f"half {number} of the parcels", half, depth)
            for number, half in enumerate(parcels.halves)
        )
        sampling = self.pilot.step(one, other).times(parcels.sampling)
        how = f"{parcels.sampling:.2g} of the difference of two halves of the parcels"
        fixed = getattr(self.scene.spray, "droplets_per_parcel", None) is not None
        key = "spray.droplets_per_parcel" if fixed else "spray.file"
        out = [_cause("parcels", sampling, how, key)]
        if parcels.narrower is not None:
            self.say("errors: parcels spread less")
            narrower = self.pilot.variant("parcels spread less", parcels.narrower, depth)
            narrow = self.pilot.step(self.pilot.level(depth), narrower).times(_OF_WIDTH)
            how = "4/3 of the step to half of the variance, as bias of fourth order has it"
            out.append(_cause("deposit width", narrow, how, key, at_most=True))
        points, _ = self.pilot.probed.sources
        if isinstance(self.scene.spray, LagrangianSpray) and points is not None:
            if len(points.position_m) < _FEWEST_PARCELS:
                why = (
                    f"{len(points.position_m)} parcels, whose halves share a gas that they drive; "
                    f"below {_FEWEST_PARCELS} seeds differ by more than halves say"
                )
                out.append((Cause("gas of few parcels", None, why, key), None))
        return out

    def sized(self) -> dict[str, Sized]:
        """Errors of the cone's classes of size and of its lattice, by cause."""
        cone = self.pilot.probed.cone
        if cone is None:
            return {}
        out: dict[str, Sized] = {}
        given: Any = self.scene.spray
        if self.pilot.probed.on_lattice:
            try:
                return self._classes(self.pilot.cone_at(cone, self._coarse))
            except SprayError:  # no cone has a lattice of cells twice as large
                return {}
        self.say("errors: a lattice twice and four times as coarse")
        wider = [cone.model_copy(update={"spacing_m": up * cone.lattice_m}) for up in (2, 4)]
        try:
            coarser, coarsest = (self._resprayed(one) for one in wider)
        except SprayError:  # it does not hold the plumes: what a finer one gains is unknown
            return out
        before = self.pilot.step(coarser, coarsest)
        last = self.pilot.step(self.pilot.level(self._coarse), coarser)
        found = Refined.of(before, last)
        sizes = ", ".join(f"{1e3 * up * cone.lattice_m:.3g}" for up in (1, 2, 4))
        how = f"cone on lattices of {sizes} mm, extrapolated by order {found.order:.2g}"
        fixed = "" if given.spacing_m is None else "spray.spacing_m"
        name = "gas grid"
        fast = found.most_K is not None
        out[name] = Sized(name, found.step, found.order, cone.lattice_m, how, fixed, fast)
        return out | self._classes(wider[0], coarser)

    def _classes(self, cone: ConeSpray, picture: Picture | None = None) -> dict[str, Sized]:
        """Of the classes of size; `picture` is that of the `cone`, None: of the larger cells."""
        if cone.droplets is None or cone.classes < 2:
            return {}
        self.say("errors: half of the classes of size")
        half = cone.model_copy(update={"size_classes": cone.classes // 2})
        whole = self.pilot.level(self._coarse) if picture is None else picture
        step = self.pilot.step(whole, self._resprayed(half))
        name, given = "size classes", self.scene.spray
        assert isinstance(given, ConeSpray)
        how = f"{half.size_classes} classes for {cone.classes}: error falls as 1 / number"
        fixed = "" if given.size_classes is None else "spray.size_classes"
        return {name: Sized(name, step, 1.0, 1 / cone.classes, how, fixed)}

    def unsized(self, known: Mapping[str, Sized]) -> list[tuple[Cause, Step | None]]:
        """Causes of the cone whose error is not known.

        Args:
            known: as `sized` found them.
        """
        cone = self.pilot.probed.cone
        out: list[tuple[Cause, Step | None]] = []
        if cone is None or self.pilot.probed.sources == (None, []):
            return out
        if "gas grid" not in known and not self.pilot.probed.on_lattice:
            why = "a lattice twice or four times as coarse does not hold the plumes"
            out.append((Cause("gas grid", None, why, "spray.spacing_m"), None))
        if "size classes" not in known and cone.droplets is not None:
            why = "one class alone, or no coarser lattice to compare on"
            out.append((Cause("size classes", None, why, "spray.size_classes"), None))
        return out

    def _resprayed(self, cone: ConeSpray) -> Picture:
        return self.pilot.traced(self.pilot.probed.resprayed(cone), self._coarse)


def foretold_K(pilot: Pilot, picture: Picture, trace_K: float) -> dict[str, float]:
    """Errors of the run's picture by what a pilot's picture shows beside its cells.

    Args:
        pilot: traces at one wavelength.
        picture: of this pilot.
        trace_K: asked of the trace of all wavelengths.

    Returns:
        By cause; what is not known is left out.
    """
    found = {"trace": pilot.noise_K(picture)}
    if found["trace"]:  # each wavelength has ordinates of its own, whose errors are independent
        found["trace"] *= trace_K / pilot.settings.accuracy_K
    if pilot.drawn is None:
        found["pixel sampling"] = pixel_error(pilot.scene, pilot.probed, picture)[0].error_K
    return {name: error_K for name, error_K in found.items() if error_K is not None}


@dataclass(frozen=True)
class Sized:
    """Error of a cause that follows a size by a known order.

    size: for which `step` is the error; metres of a lattice, or one over a number of classes.
    at_most: whether `step` is an upper bound.
    """

    name: str
    step: Step
    order: float
    size: float
    how: str
    fixed: str
    at_most: bool = False

    def at(self, size: float) -> tuple[Cause, Step | None]:
        """The cause where the size is another."""
        how = self.how
        if abs(size / self.size - 1) > 1e-9:
            how += f"; scaled to {size / self.size:.2g} of that size"
        step = self.step.times((size / self.size) ** self.order)
        return _cause(self.name, step, how, self.fixed, at_most=self.at_most)


def _cause(
    name: str, step: Step, how: str, fixed: str, *, at_most: bool = False
) -> tuple[Cause, Step | None]:
    if step.error_K is None:
        return Cause(name, None, _NO_PIXEL, fixed), None
    return Cause(name, step.error_K, how, fixed, at_most), step


def without_chance(step: Step, sampling_K: float | None) -> tuple[Step, str]:
    """The step between two sprays without what chance makes of either.

    Args:
        step: of their pictures.
        sampling_K: RMS of what chance makes of one; None: it is not known.

    Returns:
        The step by the cells of gas alone, and what was done, in words. Where chance is unknown,
        or makes more than half of the square, the step stays whole: an upper bound.
    """
    if step.error_K is None:
        return step, ""
    if sampling_K is None:
        return step, "at most, for what chance makes of either is in it"
    square = step.error_K**2 - 2.0 * sampling_K**2
    if square < _HALF * step.error_K**2:
        return step, "at most, for chance may have made half of its square"
    return step.times(square**0.5 / step.error_K), "what chance makes of either taken out"
