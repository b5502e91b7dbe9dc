"""Readings of the black body, one per image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from cldit.acquisition.pictures.columns import read_numbers
from cldit.errors import EvaluationError

_FAR_K = 30.0  # from the set point: another unit, or another column


def read_temperatures(
    folder: Path, given: Sequence[float] | str, *, where: str, count: int, setpoint_K: float
) -> list[float]:
    """Reads temperatures in kelvin, in the order of the images.

    Args:
        folder, given: as for `read_numbers`.
        where: names the images in messages.
        count: number of images.
        setpoint_K: readings must be near it.

    Raises:
        EvaluationError: unreadable, not one per image, or far from the set point.
    """
    text = str(list(given)) if not isinstance(given, str) else given
    found = read_numbers(folder, given, column="temperature_K")
    if len(found) != count:
        raise EvaluationError(
            f"{where}: {count} images and {len(found)} temperatures ({text}); allowed: one each"
        )
    for number, kelvin in enumerate(found):
        if not (math.isfinite(kelvin) and abs(kelvin - setpoint_K) <= _FAR_K):
            hint = ", degrees Celsius?" if abs(kelvin + 273.15 - setpoint_K) <= _FAR_K else ""
            raise EvaluationError(
                f"{where}: temperature {number} is {kelvin:g}{hint} ({text}); allowed: kelvin "
                f"within {_FAR_K:g} K of temperature_K"
            )
    return found
