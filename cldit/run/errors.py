"""The error of the picture: what each cause adds to T_app, and how that is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Cause:
    """One cause of error.

    error_K: RMS of T_app over the pixels that have one; None where nobody knows. how: what was
    compared, or why it is unknown. fixed: by a key of the scene, which names it.
    """

    name: str
    error_K: float | None
    how: str
    fixed: str = ""

    def __post_init__(self) -> None:
        if self.error_K is not None and not self.error_K >= 0.0:
            raise ValueError(f"{self.name}: error_K {self.error_K}; allowed is 0 or more, or None")

    @property
    def text(self) -> str:
        """The error for a table, to two digits."""
        return "unknown" if self.error_K is None else f"{self.error_K:.2g} K"


@dataclass(frozen=True)
class Errors:
    """All causes of the simulation together. Those of the model itself are not among them.

    Causes are taken for independent of each other: their squares add up.
    """

    causes: tuple[Cause, ...]

    @property
    def total_K(self) -> float | None:
        """RMS of all causes that are known; None where none is."""
        known = [cause.error_K for cause in self.causes if cause.error_K is not None]
        return sum(error**2 for error in known) ** 0.5 if known else None

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of causes that nobody knows: with one, `total_K` is a lower bound."""
        return tuple(cause.name for cause in self.causes if cause.error_K is None)

    @property
    def text(self) -> str:
        """`1.2 K`, `at least 1.2 K`, or `unknown`."""
        if self.total_K is None:
            return "unknown"
        return f"at least {self.total_K:.2g} K" if self.unknown else f"{self.total_K:.2g} K"

    def largest(self) -> Cause | None:
        """The cause that adds most; None where none is known."""
        known = [cause for cause in self.causes if cause.error_K is not None]
        return max(known, key=lambda cause: cause.error_K or 0.0, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, the sum beside the causes; `from_dict` reads it."""
        return {
            "total_K": self.total_K,
            "at_least": bool(self.unknown),
            "causes": [
                {"name": one.name, "error_K": one.error_K, "how": one.how, "fixed": one.fixed}
                for one in self.causes
            ],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Errors:
        """Reads what `to_dict` made.

        Args:
            data: of run.json.
        """
        return cls(tuple(Cause(**cause) for cause in data["causes"]))

    @classmethod
    def of(cls, causes: Iterable[Cause | None]) -> Errors:
        """Of those causes that the scene has; None stands for one that it has not."""
        return cls(tuple(cause for cause in causes if cause is not None))
