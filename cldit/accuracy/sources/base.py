"""The interface of a source of error, and the data from which errors are estimated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.trace_error import TraceError
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.prepare.medium import Prepared
from cldit.prepare.stages import Stages
from cldit.scene import Scene

OR_NONE = ", or none, so that the run chooses"


@dataclass(frozen=True)
class Excess:
    """An error above its share: the share, the ratio of both, and the order of the error."""

    share_K: float
    ratio: float
    order: float = 1.0


@dataclass(frozen=True)
class Solved:
    """The image of a run at the tracer's wavelength.

    by_path: True if it contains no error that `path` would not see. trace_error: None if nothing
    scatters.
    """

    image: ImagePair
    by_path: bool
    trace_error: TraceError | None

    @property
    def scatters(self) -> bool:
        """True if anything scatters."""
        return self.trace_error is not None


@dataclass
class Measurement:
    """Data from which errors are estimated, before or after the image is traced.

    depth: number of halvings of the cells that errors are estimated for; coarse: of those on which
    errors are estimated that do not depend on the cells. resolution: of the image; solved: the
    image; both None before it is traced. predicted: estimates from before. found: estimates by
    source, each made once.
    """

    scene: Scene
    tracer: VariantTracer
    stages: Stages
    depth: int
    coarse: int
    resolution: Resolution | None = None
    solved: Solved | None = None
    predicted: Mapping[str, Estimate] = field(default_factory=dict)
    found: dict[str, Sequence[Estimate]] = field(default_factory=dict)

    @property
    def prepared(self) -> Prepared:
        """Spray and optics."""
        return self.tracer.prepared

    def of(self, source: ErrorSource) -> Sequence[Estimate]:
        """Estimates of a source."""
        if source.name not in self.found:
            estimated = source.predict if self.solved is None else source.estimate
            self.found[source.name] = [one.shared(source.shared_by) for one in estimated(self)]
        return self.found[source.name]

    def error_K(self, source: ErrorSource) -> float | None:
        """Error of a source that another depends on; None: unknown."""
        return next((one.error_K for one in self.of(source) if one.cause.name == source.name), None)


class ErrorSource(ABC):
    """A source of error of T_app. Each has a file with one instance, which `SOURCES` lists.

    cost_power: the cost grows as error ** -cost_power; 0: no resolution makes the error smaller.
    cost_share: part of a run's cost that grows so; sources that multiply each other's cost (cells,
    ordinates, wavelengths) have 1. of_spray: True if the error depends on spray and optics, not on
    cells and ordinates; it is then estimated once for each spray. remedy: what a user can do, by
    the key of the scene that fixes the source; "": any other key. also: names of further
    errors that the source estimates. shared_by: what two runs with the same error have in common,
    one of `cldit.accuracy.errors.PARTS`, or `OMISSION`.
    """

    name: ClassVar[str]
    shared_by: ClassVar[str]
    cost_power: ClassVar[float] = 0.0
    cost_share: ClassVar[float] = 1.0
    of_spray: ClassVar[bool] = False
    remedy: ClassVar[Mapping[str, str]] = {"": "a larger transport.accuracy_K"}
    also: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def key(self, scene: Scene) -> str:
        """Key of the scene that fixes the source; empty: none."""

    def is_free(self, scene: Scene) -> bool:
        """True if the scene leaves the source to choice."""
        return False

    def applies(self, prepared: Prepared) -> bool:
        """True if the error of a prepared medium can be estimated on coarse cells."""
        return False

    def predict(self, at: Measurement) -> Sequence[Estimate]:
        """Errors by this source on coarse cells, before the image is traced."""
        return ()

    def of_image(self, at: Measurement, image: ImagePair) -> float | None:
        """Error that a coarse image shows by itself; None: unknown, or not shown."""
        return None

    @abstractmethod
    def estimate(self, at: Measurement) -> Sequence[Estimate]:
        """Errors of the image by this source; none where the scene does not have it."""

    def finer(self, resolution: Resolution, excess: Excess) -> Resolution:
        """A resolution with a smaller error; sources with a `cost_power` have one."""
        raise TypeError(f"{self.name}: no resolution makes this error smaller")
