"""The interface of a source of error, and the data from which errors are estimated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.trace_error import TraceError
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError
from cldit.prepare.medium import Prepared
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray

# A coarser lattice does not resolve the plumes, reaches out of the domain, or behind a patch.
NO_COARSER_LATTICE = (SprayError, MediumError, TransportError)
# Cells of a trace that estimates one error alone. With 48 ordinates they take some 6 core-s (3.5
# for 2.3e6 cells of gdi-cone), more than the image of most scenes.
MOST_SWEPT = 4e6


@dataclass
class Measurement:
    """Data from which errors are estimated, before or after the image is traced.

    cell_m: edge of the cells that errors are estimated for; coarse_m: of those on which errors are
    estimated that do not depend on the cells. image: of the run at the tracer's wavelength; None
    before it is traced. exact: True if it has no error that `path` would not see. trace_errors: its
    own; empty if nothing scatters. predicted: earlier estimates. estimates: by source, each made
    once.
    """

    scene: Scene
    tracer: VariantTracer
    stages: Stages
    cell_m: float
    coarse_m: float
    image: ImagePair | None = None
    exact: bool = False
    trace_errors: Sequence[TraceError] = ()
    predicted: Mapping[str, Estimate] = field(default_factory=dict)
    estimates: dict[str, Sequence[Estimate]] = field(default_factory=dict)

    @property
    def prepared(self) -> Prepared:
        """Spray and optics."""
        return self.tracer.prepared

    def of(self, source: ErrorSource) -> Sequence[Estimate]:
        """Estimates of a source."""
        if source.name not in self.estimates:
            estimated = source.predict if self.image is None else source.estimate
            by = source.shared_by
            self.estimates[source.name] = [
                replace(e, cause=replace(e.cause, shared_by=by)) for e in estimated(self)
            ]
        return self.estimates[source.name]

    def errors_K(self, source: ErrorSource) -> tuple[float | None, float | None]:
        """Errors of both results by a source that another depends on; None: unknown."""
        errors_K = (e.errors_K for e in self.of(source) if e.cause.name == source.name)
        return next(errors_K, (None, None))

    def on_lattice(self, up: int) -> tuple[ConeSpray, ImagePair]:
        """The cone on a lattice so much coarser, and its image; raises `NO_COARSER_LATTICE`."""
        cone = self.prepared.cone
        assert cone is not None
        wider = cone.model_copy(update={"spacing_m": up * cone.lattice_m})
        name = f"{up} times the lattice"
        return wider, self.tracer.variant(
            name, lambda: self.prepared.resprayed(wider), self.coarse_m
        )


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
    cells and ordinates; it is then estimated once for each spray. remedy: what a user can do, by
    the key of the scene that fixes the source; "": any other key. also: names of further
    errors that the source estimates. shared_by: what two runs with the same error have in common,
    one of `cldit.accuracy.errors.PARTS`, or `OMISSION`.
    """

    name: str
    shared_by: str
    cost_power: float = 0.0
    cost_share: float = 1.0
    of_spray: bool = False
    remedy: Mapping[str, str] = remedies("a larger transport.accuracy_K")
    also: tuple[str, ...] = ()

    def key(self, scene: Scene) -> str:
        """Key of the scene that fixes the source, of those with a remedy; empty: none."""
        for key in filter(None, self.remedy):
            section, name = key.split(".")
            if getattr(getattr(scene, section), name, None) not in (None, "auto"):
                return key
        return ""

    def is_free(self, scene: Scene) -> bool:
        """True if the scene leaves the source to choice."""
        return False

    def applies(self, prepared: Prepared) -> bool:
        """True if the error of a prepared medium can be estimated on coarse cells."""
        return False

    def predict(self, at: Measurement) -> Sequence[Estimate]:
        """Errors by this source on coarse cells, before the image is traced."""
        return ()

    @abstractmethod
    def estimate(self, at: Measurement) -> Sequence[Estimate]:
        """Errors of the image by this source; none where the scene does not have it."""

    def finer(self, old: Resolution, *, share_K: float, ratio: float, order: float) -> Resolution:
        """A resolution that makes an error, `ratio` times its share and of an order, its share;
        sources with a `cost_power` have one."""
        raise TypeError(f"{self.name}: no resolution makes this error smaller")
