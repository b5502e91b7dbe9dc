"""Errors of T_app and emissivity by source: estimates, and what a run states."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

from pydantic import ConfigDict

from cldit.accuracy.image_pair import ImageDifference
from cldit.arrays import Floats

PARTS = ("spray", "classes", "optics", "cells", "pixels", "seed")  # that two runs may share
OMISSION = "key"  # a bias by a key that omits physics, and no random error
NO_PIXEL = "no pixel has a T_app on either"


@dataclass(frozen=True)
class Cause:
    """Error by one source, as a run states it.

    error_K: RMS of T_app over the pixels that have one; None: unknown. how: what was compared, or
    why the error is unknown. fixed: key of the scene that fixes it. at_most: True for an upper
    bound. shared_by: what two runs have in common if they share this error, one of `PARTS`, or
    `OMISSION`; empty: nothing. emissivity: RMS error of emissivity over as many pixels, or None.
    """

    name: str
    error_K: float | None
    how: str
    fixed: str = ""
    at_most: bool = False
    shared_by: str = ""
    emissivity: float | None = None

    def __post_init__(self) -> None:
        if self.error_K is not None and not self.error_K >= 0.0:
            raise ValueError(f"{self.name}: error_K {self.error_K}; allowed: 0 or more, or None")

    @property
    def text(self) -> str:
        """The error of T_app for a table, to two digits."""
        return "unknown" if self.error_K is None else f"{self.error_K:.2g} K"

    @property
    def emissivity_text(self) -> str:
        """The error of emissivity for a table, to two digits."""
        return "unknown" if self.emissivity is None else f"{self.emissivity:.2g}"


@dataclass(frozen=True)
class Estimate:
    """Estimated error of one source, and how it depends on a size.

    cause: as it is stated, without emissivity; its source adds `fixed` and `shared_by`.
    emissivity_K: error of emissivity, times `kelvin_per_emissivity`; None: unknown. maps_K: (H, W)
    size of the difference in each pixel, of each result; empty: unknown. The error is proportional
    to `size` to the power `order`: a cell's edge, or one over a number. figures: errors of the
    spray's figures by the same source, by name.
    """

    cause: Cause
    emissivity_K: float | None = None
    maps_K: Sequence[Floats] = ()
    order: float = 1.0
    size: float = 1.0
    figures: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        name: str,
        differences: Sequence[ImageDifference],
        method: str,
        *,
        at_most: bool = False,
        order: float = 1.0,
        size: float = 1.0,
    ) -> Estimate:
        """Takes the differences of both results; unknown where no pixel has a T_app."""
        temperature, emissivity = differences
        if temperature.error_K is None:
            return cls.unknown(name, NO_PIXEL)
        cause = Cause(name, temperature.error_K, method, at_most=at_most)
        maps_K = [difference.map_K for difference in differences]
        return cls(cause, emissivity.error_K, maps_K, order, size)

    @classmethod
    def unknown(cls, name: str, reason: str) -> Estimate:
        """An error that nobody knows, and the reason."""
        return cls(Cause(name, None, reason))

    @property
    def errors_K(self) -> tuple[float | None, float | None]:
        """Errors of both results."""
        return self.cause.error_K, self.emissivity_K

    @property
    def error_K(self) -> float | None:
        """The larger error of both results; None: unknown."""
        return max((error_K for error_K in self.errors_K if error_K is not None), default=None)

    def stated(self, per_emissivity_K: float) -> Cause:
        """The cause with its error of emissivity."""
        if self.emissivity_K is None:
            return self.cause
        return replace(self.cause, emissivity=self.emissivity_K / per_emissivity_K)

    def at(self, size: float) -> Estimate:
        """The estimate for another size."""
        if self.cause.error_K is None or self.emissivity_K is None:
            return self
        method, factor = self.cause.how, (size / self.size) ** self.order
        if abs(size / self.size - 1) > 1e-9:
            method += f"; scaled to {size / self.size:.2g} of that size"
        cause = replace(self.cause, error_K=factor * self.cause.error_K, how=method)
        emissivity_K, maps_K = factor * self.emissivity_K, [factor * map_K for map_K in self.maps_K]
        return replace(self, cause=cause, emissivity_K=emissivity_K, maps_K=maps_K, size=size)


@dataclass(frozen=True)
class Errors:
    """Errors of the simulation by source, independent of each other: their squares add up.

    model: changes by a lens and by the model itself (n and k), which are never in the sum. why:
    reason why there is no error to state, although there are sources of it; empty otherwise.
    figures: errors of figures of the spray, such as `vapour_penetration_m`, by their name.
    """

    __pydantic_config__: ClassVar = ConfigDict(extra="ignore")  # run.json has their sum, too

    causes: tuple[Cause, ...]
    model: tuple[Cause, ...] = ()
    why: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def total_K(self) -> float | None:
        """RMS of all known errors of T_app; None where none is known, or there is no source."""
        return _total(cause.error_K for cause in self.causes)

    @property
    def total_emissivity(self) -> float | None:
        """Likewise of emissivity."""
        return _total(cause.emissivity for cause in self.causes)

    @property
    def emissivity_text(self) -> str:
        """The error of emissivity: `0.012`, `at least 0.012`, or `unknown`."""
        if self.total_emissivity is None:
            return "unknown"
        partial = any(cause.emissivity is None for cause in self.causes)
        return f"{'at least ' if partial else ''}{self.total_emissivity:.2g}"

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of sources whose error is unknown: with one, `total_K` is a lower bound."""
        return tuple(cause.name for cause in self.causes if cause.error_K is None)

    @property
    def text(self) -> str:
        """`1.2 K`, `at least 1.2 K`, `unknown`, or why there is no error."""
        if self.why:
            return f"not stated: {self.why}"
        if not self.causes:
            return "none: nothing is in the way"
        if self.total_K is None:
            return "unknown"
        return f"at least {self.total_K:.2g} K" if self.unknown else f"{self.total_K:.2g} K"

    def larger_K(self, per_emissivity_K: float) -> float:
        """The larger known total of both results, in K."""
        return max(self.total_K or 0.0, per_emissivity_K * (self.total_emissivity or 0.0))

    def exceed(self, tolerance_K: float, tolerance_emissivity: float | None = None) -> bool:
        """True if a known sum, as printed, exceeds its tolerance; None: there is none."""
        limit = math.inf if tolerance_emissivity is None else tolerance_emissivity
        pairs = (self.total_K, tolerance_K), (self.total_emissivity, limit)
        return any(total is not None and float(f"{total:.2g}") > limit for total, limit in pairs)

    def largest(self, *, of_emissivity: bool = False) -> Cause | None:
        """The largest contribution; None where none is known."""
        errors = [cause.emissivity if of_emissivity else cause.error_K for cause in self.causes]
        pairs = zip(errors, self.causes, strict=True)
        contributions = [pair for pair in pairs if pair[0] is not None]
        return max(contributions, key=lambda pair: pair[0] or 0.0, default=(None, None))[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, with the sum."""
        return {
            "total_K": self.total_K,
            "total_emissivity": self.total_emissivity,
            "at_least": bool(self.unknown),
            "causes": [asdict(cause) for cause in self.causes],
            "model": [asdict(cause) for cause in self.model],
            "why": self.why,
            "figures": dict(self.figures),
        }

    @classmethod
    def of(cls, causes: Iterable[Cause], model: Iterable[Cause] = ()) -> Errors:
        """Collects causes, and the spread of the model beside them."""
        return cls(tuple(causes), tuple(model))


def _total(errors: Iterable[float | None]) -> float | None:
    known_errors = [error for error in errors if error is not None]
    return sum(error**2 for error in known_errors) ** 0.5 if known_errors else None
