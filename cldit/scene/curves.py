"""Curves over wavelength or spatial frequency, given as a list of pairs or as a text file.

A pair is a wavelength in micrometres, or a frequency per millimetre, and a value from 0 to 1.
Curves are linear between the pairs; those over wavelength are 0 beyond.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from cldit.errors import FileError, SceneError
from cldit.io.text_tables import number_table, read_table_text

Curve = tuple[tuple[float, float], ...]
SHORTEST_UM, LONGEST_UM = 0.2, 50.0


@dataclass(frozen=True)
class Axis:
    """Quantity that a curve is over: name, unit, and limits."""

    name: str
    unit: str
    low: float
    high: float


WAVELENGTH = Axis("wavelength", "um", SHORTEST_UM, LONGEST_UM)
FREQUENCY = Axis("frequency", "1/mm", 0.0, 1e5)


def check_curve(pairs: Any, *, source: str, over: Axis = WAVELENGTH) -> Curve:
    """The `pairs` in rising order of wavelength or frequency; errors name the `source`."""
    try:
        pairs = list(pairs)
        if any(isinstance(number, bool) for pair in pairs for number in pair):
            raise TypeError("true or false")
        curve = [(float(wavelength), float(value)) for wavelength, value in pairs]
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(
            f"{source}: expected pairs of {over.name} ({over.unit}) and value (0..1), found {error}"
        ) from error
    if len(curve) < 2:
        raise SceneError(f"{source}: {len(curve)} pairs are no curve; allowed: two or more")
    for wavelength, value in curve:
        if not (math.isfinite(wavelength) and math.isfinite(value)):
            raise SceneError(f"{source}: ({wavelength:g}, {value:g}) is not finite")
        if not over.low <= wavelength <= over.high:
            nanometres = over is WAVELENGTH and wavelength > 100
            hint = ", which looks like nanometres; give micrometres" if nanometres else ""
            raise SceneError(
                f"{source}: {over.name} {wavelength:g} is outside {over.low:g}..{over.high:g} "
                f"{over.unit}{hint}"
            )
        if not 0.0 <= value <= 1.0:
            hint = "; give shares, not percent" if 1.0 < value <= 100.0 else ""
            raise SceneError(
                f"{source}: value {value:g} at {wavelength:g} {over.unit} is outside 0..1{hint}"
            )
    curve.sort(key=lambda pair: pair[0])
    for (lower, _), (upper, _) in pairwise(curve):
        if upper <= lower:
            raise SceneError(f"{source}: {upper:g} {over.unit} is given twice")
    if max(value for _, value in curve) == 0.0:
        raise SceneError(f"{source}: is empty, all values are 0; allowed: at least one above 0")
    return tuple(curve)


def read_curve(path: Path, over: Axis = WAVELENGTH) -> Curve:
    """Reads a text file of two columns, with header rows or without.

    Comments begin with #; columns are separated by semicolon, tab, comma or blanks.
    """
    try:
        lines = [line.split("#")[0] for line in read_table_text(path).splitlines()]
        table = number_table("\n".join(lines))
    except FileError as error:
        raise SceneError(str(error)) from error
    except ValueError as error:
        raise SceneError(f"{path}: {error}; allowed: {over.name} and value in a line") from error
    rows = [(*row.values,) for row in table.rows if row.label is None]
    if not rows or len(rows[0]) != 2:
        width = len(rows[0]) if rows else 1
        raise SceneError(
            f"{path}: {width} columns; allowed: two, {over.name} ({over.unit}) and value"
        )
    return check_curve(rows, source=str(path), over=over)
