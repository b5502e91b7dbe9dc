"""Splitting a wanted error over its causes by what each costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """What a smaller error of one cause costs.

    power: the cost that the cause scales grows as error^-power. share: of the run's cost that it
    scales, 0 to 1; causes that multiply each other's cost (cells, ordinates, wavelengths) have 1.
    """

    power: float
    share: float = 1.0


def split(wanted_K: float, efforts: Mapping[str, Effort]) -> dict[str, float]:
    """The error that each cause may have, so that all together cost least.

    Independent causes add up in squares, sum(e_i^2) = E^2. With a multiplier m for that bound, the
    cost C is least where -dC/de_i = 2 m e_i. With p_i the power of cause i, and C_i the part of the
    cost that it scales, -dC/de_i = p_i C_i / e_i, so that e_i^2 is in proportion to p_i C_i. Causes
    that multiply each other's cost all scale the whole of it: there e_i^2 is in proportion to p_i
    alone, whatever the cost is.

    Args:
        wanted_K: error of all causes together.
        efforts: of each cause.

    Returns:
        Error of each cause; their squares sum to that of `wanted_K`.
    """
    whole = sum(one.power * one.share for one in efforts.values())
    return {
        name: wanted_K * (one.power * one.share / whole) ** 0.5 for name, one in efforts.items()
    }
