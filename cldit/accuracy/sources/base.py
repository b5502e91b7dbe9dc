"""The interface of a source of error."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cldit.accuracy.errors import Estimate
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.prepare.medium import Prepared
from cldit.scene import Scene

# Cells of a trace that estimates one error alone. With 48 ordinates they take some 6 core-s (3.5
# for 2.3e6 cells of gdi-cone), more than the image of most scenes.
MOST_SWEPT = 4e6
_CHOSEN_BY_RUN = (None, "auto", "need")  # values of keys


def remedies(advice: str, key: str = "", **further: str) -> Mapping[str, str]:
    """Advice that makes an error smaller, by the key that fixes it; "": by any other, or none.

    Without the `key` the run chooses by itself. `further` have __ in place of dots.
    """
    by_key = {key: f"{advice}, or none, so that the run chooses"} if key else {}
    by_key |= {name.replace("__", "."): remedy for name, remedy in further.items()}
    return {"": advice} | by_key


class ErrorSource(ABC):
    """A source of error of both results, an entry of `SOURCES`.

    cost_power: the cost grows as error ** -cost_power; 0: no resolution makes the error smaller.
    cost_share: part of a run's cost that grows so; sources that multiply each other's cost (cells,
    ordinates, wavelengths) have 1. of_spray: True if the error depends on spray and optics, not on
    cells and ordinates; it is then estimated once for each spray. of_cells: True if no other cells
    than the image's tell the error. remedy: what a user can do, by
    the key of the scene that fixes the source; "": any other key. also: names of further
    errors that the source estimates. shared_by: what two runs with the same error have in common,
    one of `cldit.accuracy.errors.PARTS`, or `OMISSION`.
    """

    name: str
    shared_by: str
    remedy: Mapping[str, str]
    cost_power: float = 0.0
    cost_share: float = 1.0
    of_spray: bool = False
    of_cells: bool = False
    also: tuple[str, ...] = ()

    def key(self, scene: Scene) -> str:
        """Key of the scene that fixes the source, of those with a remedy; empty: none."""
        for key in filter(None, self.remedy):
            section, name = key.split(".")
            if getattr(getattr(scene, section), name, None) not in _CHOSEN_BY_RUN:
                return key
        return ""

    def is_free(self, scene: Scene) -> bool:
        """True if the scene leaves the source to choice."""
        return False

    def applies(self, prepared: Prepared) -> bool:
        """True if a medium has the source."""
        return True

    @abstractmethod
    def estimate(self, at: VariantTracer) -> Sequence[Estimate]:
        """Errors by this source; those `of_spray` on coarse cells where there is no image yet."""

    def of(self, at: VariantTracer) -> Sequence[Estimate]:
        """Errors by this source, each estimated once; none where the medium does not have it."""
        if self.name not in at.estimates:
            estimates = self.estimate(at) if self.applies(at.prepared) else ()
            key, by = self.key(at.scene), self.shared_by
            at.estimates[self.name] = [
                replace(e, cause=replace(e.cause, fixed=key, shared_by=by)) for e in estimates
            ]
        return at.estimates[self.name]

    def errors_K(self, at: VariantTracer) -> tuple[float | None, float | None]:
        """Errors of both results, for a source that depends on this one; None: unknown."""
        errors_K = (e.errors_K for e in self.of(at) if e.cause.name == self.name)
        return next(errors_K, (None, None))

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        """A resolution that makes an error, `ratio` times its share and of an order, its share;
        sources with a `cost_power` have one."""
        raise TypeError(f"{self.name}: no resolution makes this error smaller")
