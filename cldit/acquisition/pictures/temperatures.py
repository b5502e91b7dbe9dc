"""Readings of the black body, one a picture, from where a laboratory writes them."""

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
    """Readings in kelvin, in the order of the pictures.

    Args:
        folder: where relative paths start.
        given: the numbers; or `log.csv::column` or `run.nxs::/entry/log`, with [first:last] or not.
        where: which pictures, for messages.
        count: how many pictures there are.
        setpoint_K: near which the readings must be.

    Returns:
        One reading a picture [K].

    Raises:
        EvaluationError: unreadable, another number than pictures, or far from the set point.
    """
    text = str(list(given)) if not isinstance(given, str) else given
    found = read_numbers(folder, given, column="temperature_K")
    if len(found) != count:
        raise EvaluationError(
            f"{where}: {count} pictures and {len(found)} temperatures ({text}); allowed is one each"
        )
    for number, kelvin in enumerate(found):
        if not (math.isfinite(kelvin) and abs(kelvin - setpoint_K) <= _FAR_K):
            hint = ", degrees Celsius?" if abs(kelvin + 273.15 - setpoint_K) <= _FAR_K else ""
            raise EvaluationError(
                f"{where}: temperature {number} is {kelvin:g}{hint} ({text}); allowed are kelvin "
                f"within {_FAR_K:g} K of temperature_K"
            )
    return found
