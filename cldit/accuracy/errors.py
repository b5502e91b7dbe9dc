"""The error of the picture: what each cause adds to T_app, and how that is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Cause:
    """One cause of error.

    error_K: RMS of T_app over the pixels that have one; None where nobody knows. how: what was
    compared, or why it is unknown. fixed: by a key of the scene, which names it. at_most: whether
    the error is an upper bound.
    """

    name: str
    error_K: float | None
    how: str
    fixed: str = ""
    at_most: bool = False

    def __post_init__(self) -> None:
        if self.error_K is not None and not self.error_K >= 0.0:
            raise ValueError(f"{self.name}: error_K {self.error_K}; allowed is 0 or more, or None")

    @property
    def text(self) -> str:
        """The error for a table, to two digits."""
        return "unknown" if self.error_K is None else f"{self.error_K:.2g} K"


@dataclass(frozen=True)
class Errors:
    """All causes of the simulation together.

    Causes are taken for independent of each other: their squares add up. model: the spread of the
    model itself (which evaporation, which n and k), which is beside them and never in the sum.
    """

    causes: tuple[Cause, ...]
    model: tuple[Cause, ...] = ()

    @property
    def total_K(self) -> float | None:
        """RMS of all causes that are known; None where none is, or there is no cause."""
        known = [cause.error_K for cause in self.causes if cause.error_K is not None]
        return sum(error**2 for error in known) ** 0.5 if known else None

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of causes that nobody knows: with one, `total_K` is a lower bound."""
        return tuple(cause.name for cause in self.causes if cause.error_K is None)

    @property
    def text(self) -> str:
        """`1.2 K`, `at least 1.2 K`, `unknown`, or that there is nothing to be wrong in."""
        if not self.causes:
            return "none: nothing is in the way"
        if self.total_K is None:
            return "unknown"
        return f"at least {self.total_K:.2g} K" if self.unknown else f"{self.total_K:.2g} K"

    def exceed(self, wanted_K: float) -> bool:
        """Whether the known sum, as it is printed, is more than `wanted_K`."""
        return self.total_K is not None and float(f"{self.total_K:.2g}") > wanted_K

    def largest(self) -> Cause | None:
        """The cause that adds most; None where none is known."""
        known = [cause for cause in self.causes if cause.error_K is not None]
        return max(known, key=lambda cause: cause.error_K or 0.0, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, the sum beside the causes; `from_dict` reads it."""
        return {
            "total_K": self.total_K,
            "at_least": bool(self.unknown),
            "causes": [asdict(cause) for cause in self.causes],
            "model": [asdict(cause) for cause in self.model],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Errors:
        """Reads what `to_dict` made.

        Args:
            data: of run.json.
        """
        causes, model = (
            tuple(Cause(**cause) for cause in data.get(name, ())) for name in ("causes", "model")
        )
        return cls(causes, model)

    @classmethod
    def of(cls, causes: Iterable[Cause | None], model: Iterable[Cause] = ()) -> Errors:
        """Of those causes that the scene has.

        Args:
            causes: None stands for one that the scene has not.
            model: the spread of the model itself.
        """
        return cls(tuple(cause for cause in causes if cause is not None), tuple(model))

    def remarks(self, wanted_K: float, limits: Mapping[str, str] | None = None) -> tuple[str, ...]:
        """Where the error is larger than was asked for: by what, and what can be done.

        Args:
            wanted_K: `transport.accuracy_K`.
            limits: why a cause cannot be made smaller, and what is allowed instead, by its name.

        Returns:
            One text; none where the error is as asked for.
        """
        largest = self.largest()
        if largest is None or not self.exceed(wanted_K):
            return ()
        held = f", held by {largest.fixed}" if largest.fixed else ""
        why = f"{held}; allowed is {_allowed(largest)}"
        if limits and largest.name in limits:
            why = f", for {limits[largest.name]}"
        return (
            f"stated error {self.text} RMS, more than transport.accuracy_K: {wanted_K:g} asks for: "
            f"{largest.name} make{'s' if largest.name in _ONE else ''} {largest.text}{why}",
        )


_ONE = ("trace", "deposit width", "gas grid", "pixel sampling")
_MORE_PARCELS = (
    "a smaller spray.droplets_per_parcel (run time grows as the number of parcels), or more "
    "parcels in the file"
)
_FIX = {
    "cells": "a smaller domain.leaf_edge_m",
    "trace": "more transport.directions or a larger transport.max_samples, or, for what only the "
    "audit finds, transport.method: path, or domain.leaf_edge_m of half the voxels of a grid",
    "wavelengths": "more optics.wavelengths",
    "parcels": _MORE_PARCELS,
    "deposit width": _MORE_PARCELS,
    "size classes": "more spray.size_classes",
    "gas grid": "a smaller spray.spacing_m",
    "pixel sampling": "more camera.pixels, or camera.rays_per_pixel: 4 or more",
}
# Where another key than the usual one holds the cause.
_OF_KEY = {
    "domain.rule": "domain.rule: need, or a smaller domain.leaf_edge_m",
    "optics.spectral_error_K": "a smaller optics.spectral_error_K",
    "spray.box.spacing_m": "a smaller spray.box.spacing_m (half takes up to 16 times as long)",
}
_CHOSEN = (  # by the run, where the scene leaves them out
    "domain.leaf_edge_m",
    "optics.wavelengths",
    "optics.spectral_error_K",
    "spray.size_classes",
    "spray.spacing_m",
)


def _allowed(cause: Cause) -> str:
    fix = _FIX.get(cause.name, "a larger transport.accuracy_K")
    fix = _OF_KEY.get(cause.fixed, fix)
    return f"{fix}, or none, so that the run chooses" if cause.fixed in _CHOSEN else fix
