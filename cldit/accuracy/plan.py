"""What a run is to be traced with, so that its picture errs by no more than was asked for.

`transport.accuracy_K` is split over the causes of error by what a smaller error costs in each
(`cldit.accuracy.split`). Keys that the scene fixes stay fixed, and take no part. The cells are
chosen by a few coarse traces (`cldit.accuracy.cells`). When the errors have been measured, what is
too large is made smaller, twice at most.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from cldit.accuracy.cells import too_fine
from cldit.accuracy.errors import Cause, Errors
from cldit.accuracy.split import Effort, split
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, GridSpray

MOST_REFINEMENTS = 2
# The number of cells grows as h^-3, their error falls at least as h. A trace errs by the number of
# its ordinates to the power -2/3, wavelengths and classes by about one over their number, a
# lattice by its spacing to the power 3/2; classes and lattice cost time where the medium is made,
# a third of a run of gdi at 0.5 K.
EFFORTS = {
    "cells": Effort(3.0),
    "trace": Effort(1.5),
    "wavelengths": Effort(1.0),
    "size classes": Effort(1.0, share=0.3),
    "gas grid": Effort(2.0, share=0.3),
}
# What comes out of a trace or of wavelengths is mostly below what was asked of them. Cells can only
# be halved, at eight times the cost: they may take what others are likely to leave.
_COMES_OUT = 0.6
# What pilots foretell may leave cells next to nothing. At half of its share they are eight times as
# many; what is left too large is then said.
_LEAST_OF_SHARE = 0.5
_CLOSE = 1.1  # in squares: not worth another spray
# What causes that a plan may choose for add to the square of those that it may not. By the powers
# above cost grows as their error to the power -5.5. The sum is 5 % more than the fixed causes alone
# then, and a per cent of it costs (1 + 10) times what it costs where nothing is fixed.
_IN_VAIN = 0.1
_MOST_CLASSES = 64
_FINEST_LATTICE_m = 0.1e-3
_FIRST_LATTICE_m = 1e-3
# A trace has as many more ordinates as it is asked to err less, hence the power of EFFORTS.
# A refinement halves cells and quarters other errors at most: what cannot be made smaller may leave
# the rest next to nothing, and its share would cost more than the picture is worth.
_MOST_LARGER = 4.0
_PIXELS = "pixel sampling"
_SAFE = 0.9  # of an error that is foretold


@dataclass(frozen=True)
class Plan:
    """How a scene is traced.

    domain_m: edge of the domain. wanted_K: error of all causes together. shares_K: errors that free
    causes may have; foretold_K: that causes will have, whatever their share, as pilots say; fixed:
    those among them that the plan cannot make smaller, and whether their error is an upper bound;
    None: they were not looked for. depth: how often the cube is halved; None: as the scene has it.
    trace_K, spectral_K: asked of the trace and of the choice of wavelengths. size_classes,
    spacing_m: of the cone; None: there is none.
    lattice_of_m: edge of the cube whose cells are the cone's lattice as well, where the scene
    leaves both to choice; spacing_m then follows depth. refinements: made so far. limited: why
    cells are not finer, where they should be, and what is allowed; else empty. finest_lattice:
    whether the cone takes no finer lattice.
    """

    wanted_K: float
    shares_K: Mapping[str, float]
    trace_K: float
    spectral_K: float
    size_classes: int | None
    spacing_m: float | None
    domain_m: float
    depth: int | None = None
    lattice_of_m: float | None = None
    refinements: int = 0
    limited: str = ""
    finest_lattice: bool = False
    foretold_K: Mapping[str, float] = field(default_factory=dict)
    fixed: Mapping[str, bool] | None = None

    @classmethod
    def first(cls, scene: Scene) -> Plan:
        """The plan before anything is known of the spray.

        Args:
            scene: as the user wrote it.
        """
        wanted_K = scene.transport.accuracy_K
        cone = scene.spray if isinstance(scene.spray, ConeSpray) else None
        classes, spacing_m = (None, None) if cone is None else (cone.classes, cone.lattice_m)
        lattice_of_m = None
        if follows_cells(scene):  # a first lattice, to learn from
            lattice_of_m, spacing_m = scene.domain.edge_m, _FIRST_LATTICE_m
        if not scene.transport.audit:
            edge_m = scene.domain.edge_m
            return cls(wanted_K, {}, wanted_K, scene.optics.bound_K, classes, spacing_m, edge_m)
        return cls(
            wanted_K=wanted_K,
            **_shared(scene, wanted_K),
            size_classes=classes,
            spacing_m=spacing_m,
            domain_m=scene.domain.edge_m,
            lattice_of_m=lattice_of_m,
        )

    def at_depth(self, depth: int, limited: str = "") -> Plan:
        """The plan with the cube halved `depth` times, and the lattice that goes with it.

        Args:
            depth: halvings.
            limited: why they are not more, where they should be.
        """
        if self.lattice_of_m is not None:
            return replace(self.on_lattice(self.lattice_of_m / 2**depth), limited=limited)
        return replace(self, depth=depth, limited=limited)

    def on_lattice(self, spacing_m: float) -> Plan:
        """The plan with a lattice, and the cells that go with it.

        The cube may become larger than the domain, by less than twice, so that halving it ends in
        cells of the lattice.

        Args:
            spacing_m: of lattice and cells.
        """
        assert self.lattice_of_m is not None
        edge_m = spacing_m
        depth = 0
        while edge_m < self.domain_m * (1 - 1e-9):
            edge_m, depth = 2 * edge_m, depth + 1
        return replace(self, depth=depth, spacing_m=spacing_m, lattice_of_m=edge_m)

    @property
    def aim_K(self) -> float:
        """Error of all causes together that is worth its cost: the wanted one, or what is fixed
        with little added to it, by what of that is no upper bound.

        With F of what is fixed and R of the rest, their sum falls by R^2 / (F^2 + R^2) per cent
        where R falls by one; the cost grows by as many per cent whatever F is.
        """
        proven_K2, bounds_K2 = self._fixed_K2
        return float(max(self.wanted_K, ((1.0 + _IN_VAIN) * proven_K2 + bounds_K2) ** 0.5))

    @property
    def _fixed_K2(self) -> tuple[float, float]:
        """Squares of what is fixed: measured, and upper bounds."""
        each = {name: self.foretold_K.get(name, 0.0) ** 2 for name in self.fixed or {}}
        bounds = sum(each[name] for name, at_most in (self.fixed or {}).items() if at_most)
        return sum(each.values()) - bounds, bounds

    def knowing(self, scene: Scene, causes: Iterable[Cause]) -> Plan:
        """The plan that knows what the scene errs by whatever is chosen for it. No plan chooses
        pixels, nor directions that the scene sets: what pilots foretell of both counts as well.

        Args:
            scene: as the user wrote it.
            causes: measured, those of `free_causes` not among them.
        """
        errors_K, fixed = {}, {_PIXELS: False}
        for one in causes:
            if one.error_K is not None:
                errors_K[one.name], fixed[one.name] = one.error_K, one.at_most
        if "trace" not in free_causes(scene):
            fixed["trace"] = False
        return replace(self, foretold_K={**self.foretold_K, **errors_K}, fixed=fixed)

    def shared(self, scene: Scene) -> Plan:
        """The plan with shares of what the known causes leave, and never less than before.

        Args:
            scene: as the user wrote it.
        """
        left_K2 = self.aim_K**2 - sum(error_K**2 for error_K in self.foretold_K.values())
        return replace(self, **_shared(scene, max(left_K2, self.wanted_K**2) ** 0.5))

    @property
    def cells_K(self) -> float:
        """Error that the cells may have: what the other causes are likely to leave."""
        least_K = _LEAST_OF_SHARE * self.shares_K["cells"]
        return float(max(self._left_K2("cells"), least_K**2) ** 0.5)

    def _left_K2(self, *names: str) -> float:
        """What of the square of `aim_K` others than these causes are likely to leave."""
        likely_K = {name: _COMES_OUT * one for name, one in self.shares_K.items()}
        likely_K.update(self.foretold_K)
        return self.aim_K**2 - sum(e**2 for name, e in likely_K.items() if name not in names)

    def scene(self, scene: Scene) -> Scene:
        """The scene with what the plan chose where it leaves keys out."""
        transport = scene.transport.model_copy(update={"accuracy_K": self.trace_K})
        optics = scene.optics.model_copy(update={"spectral_error_K": self.spectral_K})
        parts: dict[str, Any] = {"transport": transport, "optics": optics}
        if isinstance(scene.spray, ConeSpray):
            update = {"size_classes": self.size_classes, "spacing_m": self.spacing_m}
            parts["spray"] = scene.spray.model_copy(update=update)
        return scene.model_copy(update=parts)

    def settled(
        self, scene: Scene, cells_K: float | None, errors_K: Mapping[str, tuple[float, float]]
    ) -> Plan:
        """The plan with classes and lattice as fine as what the cells leave needs.

        Args:
            scene: as the user wrote it.
            cells_K: error that the cells are likely to have; None: unknown, and taken for none.
            errors_K: of classes and lattice by cause, and the order in which they fall.
        """
        free = set(free_causes(scene))
        left = self._left_K2("cells", "size classes", "gas grid") - (cells_K or 0.0) ** 2
        left -= sum(e**2 for name, (e, _) in errors_K.items() if name not in free)
        mine = {name: e for name, (e, _) in errors_K.items() if name in free}
        if left <= 0 or not mine or sum(e**2 for e in mine.values()) <= _CLOSE * left:
            return self
        shares_K = _shares(left, mine)
        larger = {name: e / shares_K[name] for name, e in mine.items() if e > shares_K[name]}
        plan = replace(self, shares_K={**self.shares_K, **shares_K})
        return plan.resized(larger, {name: order for name, (_, order) in errors_K.items()})

    def resized(self, larger: Mapping[str, float], orders: Mapping[str, float]) -> Plan:
        """The plan with finer classes and lattice.

        Args:
            larger: error over what it may be, by cause.
            orders: in which the errors fall.
        """
        plan = self
        if "size classes" in larger and plan.size_classes is not None:
            classes = min(_MOST_CLASSES, math.ceil(plan.size_classes * larger["size classes"]))
            plan = replace(plan, size_classes=classes)
        if "gas grid" in larger and plan.spacing_m is not None:
            finer = larger["gas grid"] ** (1.0 / orders.get("gas grid", 1.0))
            plan = replace(plan, spacing_m=max(plan.spacing_m / finer, _FINEST_LATTICE_m))
        return plan

    def refined(
        self,
        errors: Errors,
        scene: Scene,
        *,
        reducible: set[str],
        orders: Mapping[str, float],
    ) -> Plan | None:
        """A plan for smaller errors; None where these are small enough, or cannot be made so.

        Args:
            errors: as measured.
            scene: as the user wrote it.
            reducible: causes that the plan can make smaller.
            orders: in which errors of classes and lattice fall with their size.
        """
        if self.refinements >= MOST_REFINEMENTS or not errors.exceed(self.wanted_K):
            return None
        known = {one.name: one.error_K for one in errors.causes if one.error_K is not None}
        free = [name for name in known if name in reducible]
        left = self.wanted_K**2 - sum(e**2 for name, e in known.items() if name not in free)
        if not free or left <= 0:
            return None
        shares_K = _shares(left, {name: known[name] for name in free})
        larger = {
            n: min(known[n] / shares_K[n], _MOST_LARGER) for n in free if known[n] > shares_K[n]
        }
        plan = replace(self, shares_K=shares_K, refinements=self.refinements + 1)
        if "cells" in larger and self.depth is not None:
            if plan.lattice_of_m is None:
                plan = plan.at_depth(self.depth + 1, plan.limited)
            elif plan.spacing_m is not None:
                less = (_SAFE / larger["cells"]) ** (1.0 / orders.get("cells", 1.0))
                plan = plan.on_lattice(plan.spacing_m * max(less, 0.5))
        if "trace" in larger:
            finer = larger["trace"] ** EFFORTS["trace"].power
            plan = replace(plan, trace_K=self.trace_K / finer)
        if "wavelengths" in larger:
            plan = replace(plan, spectral_K=_spectral_K(scene, shares_K["wavelengths"]))
        return plan.resized(larger, orders)

    @property
    def limits(self) -> dict[str, str]:
        """Why a cause cannot be made smaller, and what is allowed, by its name."""
        limits = {"cells": self.limited} if self.limited else {}
        if self.finest_lattice and self.lattice_of_m is None and self.spacing_m is not None:
            limits["gas grid"] = too_fine(self.spacing_m)
        return limits

    def bounded(self) -> tuple[str, ...]:
        """That what the plan cannot make smaller bounds what it chooses; else nothing."""
        proven_K2, bounds_K2 = self._fixed_K2
        left_K2 = self.wanted_K**2 - proven_K2 - bounds_K2
        rest_K2, fixed_K = _IN_VAIN * proven_K2, (proven_K2 + bounds_K2) ** 0.5
        if rest_K2 <= max(left_K2, (_LEAST_OF_SHARE * self.wanted_K) ** 2):
            return ()
        known_K = {name: self.foretold_K.get(name, 0.0) for name in self.fixed or {}}
        most = sorted(known_K, key=lambda name: -known_K[name])[:2]
        named = ", ".join(f"{name} {known_K[name]:.2g} K" for name in most)
        return (
            f"causes that the run cannot make smaller err by {fixed_K:.2g} K on coarse cells "
            f"({named}), and transport.accuracy_K: {self.wanted_K:g} asks for "
            f"less: the rest is chosen for {rest_K2**0.5:.2g} K",
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


def follows_cells(scene: Scene) -> bool:
    """Whether the cone's lattice is that of the cells: the scene leaves both to choice.

    Args:
        scene: as the user wrote it.
    """
    return (
        isinstance(scene.spray, ConeSpray)
        and scene.spray.spacing_m is None
        and cells_are_free(scene)
        and scene.transport.audit
    )


def cells_are_free(scene: Scene) -> bool:
    """Whether the scene leaves its cells to choice. A grid of the user's is its own cells.

    Args:
        scene: as the user wrote it.
    """
    domain = scene.domain
    own = isinstance(scene.spray, GridSpray)
    return domain.leaf_edge_m is None and domain.rule == "need" and not own


def free_causes(scene: Scene) -> tuple[str, ...]:
    """Causes whose error the scene leaves to the plan.

    Args:
        scene: as the user wrote it.
    """
    free = []
    if cells_are_free(scene):
        free.append("cells")
    droplets = getattr(scene.spray, "droplets", True) is not None
    if scene.transport.directions is None and droplets:
        free.append("trace")
    optics = scene.optics
    if (
        optics.preset == "spectral"
        and optics.wavelengths is None
        and optics.spectral_error_K is None
    ):
        free.append("wavelengths")
    spray = scene.spray
    if isinstance(spray, ConeSpray) and spray.droplets is not None and spray.size_classes is None:
        free.append("size classes")
    if isinstance(spray, ConeSpray) and spray.spacing_m is None and not follows_cells(scene):
        free.append("gas grid")
    return tuple(free)


def _shared(scene: Scene, free_K: float) -> dict[str, Any]:
    """What a plan asks of causes that it may choose for, where they may err by this together."""
    shares_K = split(free_K, {name: EFFORTS[name] for name in free_causes(scene)})
    return {
        "shares_K": shares_K,
        "trace_K": shares_K.get("trace", free_K),
        "spectral_K": _spectral_K(scene, shares_K.get("wavelengths", free_K)),
    }


def _shares(left_K2: float, known_K: Mapping[str, float]) -> dict[str, float]:
    """Shares of a square of errors; what errs by less than its share leaves the rest to others."""
    shares_K, open_ = dict(known_K), set(known_K)
    while open_:
        wanted = split(left_K2**0.5, {name: EFFORTS[name] for name in open_})
        within = {name for name in open_ if known_K[name] <= wanted[name]}
        if not within:
            return shares_K | wanted
        left_K2 -= sum(known_K[name] ** 2 for name in within)
        open_ -= within
    return shares_K


def _spectral_K(scene: Scene, share_K: float) -> float:
    fixed = scene.optics.spectral_error_K
    return fixed if fixed is not None else min(max(share_K, 1e-3), 100.0)
