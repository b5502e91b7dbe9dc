"""Errors that all pixels share, as changes of a difference by one standard deviation each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cldit.arrays import Floats
from cldit.comparison.shown import Shown
from cldit.dit.budget import Part


@dataclass(frozen=True)
class Mode:
    """An error that all pixels share: changes (H, W) of the differences by one standard deviation.

    size: the value that fits the difference best, in standard deviations. degrees: of freedom of
    the estimate of this standard deviation.
    """

    name: str
    kelvin: Floats = field(repr=False)
    emissivity: Floats = field(repr=False)
    size: float = 0.0
    degrees: float = math.inf


def shared_modes(one: Shown, other: Shown) -> tuple[Mode, ...]:
    """Errors that all pixels share; a systematic error of the same name is the same in both.

    With both corrected for a quantity that is larger by s of its spreads they are equal if other +
    s change(other) = one + s change(one).
    """
    found = [
        Mode(
            f"{part.name} of {each.name}",
            sign * np.nan_to_num(part.kelvin),
            sign * np.nan_to_num(part.emissivity),
            degrees=part.degrees,
        )
        for each, sign in ((one, -1.0), (other, 1.0))
        for part in each.common
    ]
    first, second = ({part.name: part for part in each.systematic} for each in (one, other))
    zero = np.zeros(one.maps.emissivity.shape)
    nothing = Part(name="", kelvin=zero, emissivity=zero)
    for name in dict.fromkeys((*first, *second)):
        before, after = (parts.get(name, nothing) for parts in (first, second))
        found.append(
            Mode(
                name,
                np.nan_to_num(before.kelvin - after.kelvin),
                np.nan_to_num(before.emissivity - after.emissivity),
            )
        )
    return tuple(found)
