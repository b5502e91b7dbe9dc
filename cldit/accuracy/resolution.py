"""Resolution of a run: all numbers that a scene leaves to choice, and never written into it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray

_FIRST_LATTICE_m = 1e-3
# Cells of a computed gas to begin with, per kelvin asked (docs/benchmarks/error-sources.md), and
# their limits: half the cells take 3 to 12 times as long.
_GAS_PER_K, _FINEST_GAS_m, _COARSEST_GAS_m = 0.16e-3, 0.35e-3, 2e-3
_FINEST_GAS = (
    f"half of the gas's cells are below {1e3 * _FINEST_GAS_m:g} mm, which a run does not choose by "
    "itself, for the spray alone then takes minutes; allowed: a smaller spray.box.spacing_m"
)


@dataclass(frozen=True)
class Resolution:
    """Numerical resolution of one solution.

    ordinates_K, spectral_K: errors of T_app asked of the ordinates and of the choice of
    wavelengths. size_classes, spacing_m: classes of droplet size and lattice of a cone; None: the
    spray is no cone. gas_m: cells of a computed gas; None: as the scene has them. domain_m: edge of
    the domain. depth: number of times that the cube is halved; None: not chosen yet. cube_m: edge
    of the cube whose cells are the cone's lattice as well, where the scene leaves both to choice;
    spacing_m then follows depth. more_ordinates: ordinates over those of ordinates_K, for an error
    that only the audit shows. pixels_K: error asked of the rays that sample a pixel; None: the
    scene has their number. limits: why a source cannot be made smaller, and what would help, by its
    name.
    """

    ordinates_K: float
    spectral_K: float
    size_classes: int | None
    spacing_m: float | None
    domain_m: float
    depth: int | None = None
    cube_m: float | None = None
    more_ordinates: float = 1.0
    pixels_K: float | None = None
    gas_m: float | None = None
    limits: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def first(cls, scene: Scene, *, ordinates_K: float, spectral_K: float) -> Resolution:
        """The resolution before anything is known of the spray."""
        cone = scene.spray if isinstance(scene.spray, ConeSpray) else None
        classes, spacing_m = (None, None) if cone is None else (cone.classes, cone.lattice_m)
        edge_m, cube_m = scene.domain.edge_m, None
        if lattice_is_cells(scene):  # a first lattice, to learn from
            cube_m, spacing_m = edge_m, _FIRST_LATTICE_m
        start = cls(ordinates_K, spectral_K, classes, spacing_m, edge_m, cube_m=cube_m)
        gas_m = float(f"{_GAS_PER_K * ordinates_K:.2g}")
        return start.with_gas(gas_m) if gas_is_free(scene) else start

    @property
    def prepared_key(self) -> tuple[Any, ...]:
        """The part that spray and optics depend on."""
        return (self.spectral_K, self.size_classes, self.spacing_m, self.gas_m)

    def spray(self, scene: Scene) -> ConeSpray | LagrangianSpray | None:
        """The scene's spray with these classes of size, lattice and gas; None: it has none."""
        spec = scene.spray
        if isinstance(spec, LagrangianSpray):
            return spec if self.gas_m is None else spec.on_gas(self.gas_m)
        if not isinstance(spec, ConeSpray):
            return None
        update = {"size_classes": self.size_classes, "spacing_m": self.spacing_m}
        return spec.model_copy(update=update)

    def at_depth(self, depth: int, cell_m: float | None = None) -> Resolution:
        """The cube halved `depth` times, and the lattice that goes with it: of `cell_m`, or as fine
        as the cube's cells."""
        if self.cube_m is not None:
            return self.on_lattice(cell_m or math.ldexp(self.cube_m, -depth))
        return replace(self, depth=depth)

    def on_lattice(self, spacing_m: float) -> Resolution:
        """A lattice, and the cells that go with it.

        The cube may become larger than the domain, by less than twice, so that halving it ends in
        cells of the lattice.
        """
        assert self.cube_m is not None
        depth = lattice_depth(self.domain_m, spacing_m)
        cube_m = math.ldexp(spacing_m, depth)
        return replace(self, depth=depth, spacing_m=spacing_m, cube_m=cube_m)

    def with_gas(self, gas_m: float) -> Resolution:
        """Cells of a computed gas, within the limits of what a run chooses by itself."""
        gas_m = min(max(gas_m, _FINEST_GAS_m), _COARSEST_GAS_m)
        limit = _FINEST_GAS if gas_m < 2 * _FINEST_GAS_m else ""
        return replace(self, gas_m=gas_m).limited("gas grid", limit)

    def limited(self, source: str, reason: str) -> Resolution:
        """Notes why a source cannot be made smaller; with an empty text, that it can."""
        limits = {name: remedy for name, remedy in self.limits.items() if name != source}
        return replace(self, limits=limits | ({source: reason} if reason else {}))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the `plan` of run.json, with the keys of version 0.1.0."""
        limits = {
            "limited": self.limits.get("cells", ""),
            "finest_lattice": "gas grid" in self.limits,
        }
        return {key: getattr(self, name) for key, name in _STORED.items()} | limits

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Resolution:
        """Reads the `plan` of a run.json; raises KeyError where it is damaged."""
        read = {name: data[key] for key, name in _STORED.items() if name not in _LATER}
        return cls(**read, **{key: data[key] for key in _LATER if key in data})


_LATER = ("more_ordinates", "pixels_K", "gas_m")  # not in runs of 0.1.0
_STORED = {
    "trace_K": "ordinates_K",
    "lattice_of_m": "cube_m",
    **{name: name for name in ("spectral_K", "size_classes", "spacing_m", "domain_m", "depth")},
    **{name: name for name in _LATER},
}  # attributes by their keys


def lattice_depth(domain_m: float, spacing_m: float) -> int:
    """Number of times that a cube of at least the domain's edge is halved to cells of a lattice."""
    return max(math.ceil(math.log2(domain_m / spacing_m) - 1e-9), 0)


def cells_are_free(scene: Scene) -> bool:
    """True if the scene leaves its cells to choice. Those of a user's grid begin as its voxels."""
    return scene.domain.leaf_edge_m is None and scene.domain.rule == "need"


def gas_is_free(scene: Scene) -> bool:
    """True if the scene leaves the cells of a computed gas to choice."""
    spray = scene.spray
    return (
        isinstance(spray, LagrangianSpray) and spray.box.spacing_m is None and scene.transport.audit
    )


def lattice_is_cells(scene: Scene) -> bool:
    """True if the cone's lattice is that of the cells: the scene leaves both to choice."""
    return (
        isinstance(scene.spray, ConeSpray)
        and scene.spray.spacing_m is None
        and cells_are_free(scene)
        and scene.transport.audit
    )


def too_many(cell_m: float) -> str:
    """Limit of cells that do not fit the memory."""
    return (
        f"{1e3 * cell_m:.3g} mm cells exceed memory; allowed: a machine with more memory, or a "
        "larger transport.accuracy_K"
    )


def too_fine(spacing_m: float) -> str:
    """Limit of the lattice that suits a cone."""
    return (
        f"the cone allows no lattice finer than {1e3 * spacing_m:.3g} mm; allowed: a larger "
        "transport.accuracy_K"
    )
