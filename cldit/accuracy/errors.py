"""Errors of T_app by source: estimates, what a run states, and the remark where it is too much."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    `OMISSION`; empty: nothing.
    """

    name: str
    error_K: float | None
    how: str
    fixed: str = ""
    at_most: bool = False
    shared_by: str = ""

    def __post_init__(self) -> None:
        if self.error_K is not None and not self.error_K >= 0.0:
            raise ValueError(f"{self.name}: error_K {self.error_K}; allowed: 0 or more, or None")

    @property
    def text(self) -> str:
        """The error for a table, to two digits."""
        return "unknown" if self.error_K is None else f"{self.error_K:.2g} K"


@dataclass(frozen=True)
class Estimate:
    """Estimated error of one source, and how it depends on a size.

    cause: as it is stated. map_K: (H, W) size of the difference in each pixel; None: unknown. The
    error is proportional to `size` to the power `order`: a cell's edge, or one over a number.
    figures: errors of the spray's figures by the same source, by their name.
    """

    cause: Cause
    map_K: Floats | None = None
    order: float = 1.0
    size: float = 1.0
    figures: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        name: str,
        found: ImageDifference,
        how: str,
        fixed: str,
        *,
        at_most: bool = False,
        order: float = 1.0,
        size: float = 1.0,
    ) -> Estimate:
        """Takes the difference of two images; unknown where no pixel has a T_app."""
        if found.error_K is None:
            return cls.unknown(name, NO_PIXEL, fixed)
        return cls(Cause(name, found.error_K, how, fixed, at_most), found.map_K, order, size)

    @classmethod
    def unknown(cls, name: str, why: str, fixed: str = "") -> Estimate:
        """An error that nobody knows, and the reason."""
        return cls(Cause(name, None, why, fixed))

    @property
    def error_K(self) -> float | None:
        """The error; None: unknown."""
        return self.cause.error_K

    def shared(self, by: str) -> Estimate:
        """The estimate with the part of a run by which two runs share it."""
        return replace(self, cause=replace(self.cause, shared_by=by))

    def at(self, size: float) -> Estimate:
        """The estimate for another size."""
        if self.error_K is None or self.map_K is None:
            return self
        how, factor = self.cause.how, (size / self.size) ** self.order
        if abs(size / self.size - 1) > 1e-9:
            how += f"; scaled to {size / self.size:.2g} of that size"
        cause = replace(self.cause, error_K=factor * self.error_K, how=how)
        return replace(self, cause=cause, map_K=factor * self.map_K, size=size)


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
        """RMS of all known errors; None where none is known, or there is no source."""
        known = [cause.error_K for cause in self.causes if cause.error_K is not None]
        return sum(error**2 for error in known) ** 0.5 if known else None

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

    def exceed(self, tolerance_K: float) -> bool:
        """True if the known sum, as printed, exceeds the tolerance."""
        return self.total_K is not None and float(f"{self.total_K:.2g}") > tolerance_K

    def largest(self) -> Cause | None:
        """The largest contribution; None where none is known."""
        known = [cause for cause in self.causes if cause.error_K is not None]
        return max(known, key=lambda cause: cause.error_K or 0.0, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, with the sum."""
        return {
            "total_K": self.total_K,
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
