"""Curves over wavelength, given as a list of pairs or as a text file.

A pair is a wavelength in micrometres and a value from 0 to 1. Curves are linear between the pairs
and 0 beyond.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from cldit.errors import FileError, SceneError
from cldit.io.text_tables import number_table, read_table_text

Curve = tuple[tuple[float, float], ...]
SHORTEST_UM, LONGEST_UM = 0.2, 50.0


def check_curve(pairs: Any, *, what: str) -> Curve:
    """The `pairs` in rising order of wavelength; errors name `what`.

    Raises:
        SceneError: not pairs of numbers, a wrong unit, fewer than two pairs, or no value above 0.
    """
    try:
        pairs = list(pairs)
        if any(isinstance(number, bool) for pair in pairs for number in pair):
            raise TypeError("true or false")
        curve = [(float(wavelength), float(value)) for wavelength, value in pairs]
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(
            f"{what}: expected pairs of wavelength (um) and value (0..1), found {error}"
        ) from error
    if len(curve) < 2:
        raise SceneError(f"{what}: {len(curve)} pairs are no curve; allowed: two or more")
    for wavelength, value in curve:
        if not (math.isfinite(wavelength) and math.isfinite(value)):
            raise SceneError(f"{what}: ({wavelength:g}, {value:g}) is not finite")
        if not SHORTEST_UM <= wavelength <= LONGEST_UM:
            hint = ", which looks like nanometres" if wavelength > 100 else ""
            raise SceneError(
                f"{what}: wavelength {wavelength:g} is outside {SHORTEST_UM:g}..{LONGEST_UM:g} um"
                f"{hint}; give micrometres"
            )
        if not 0.0 <= value <= 1.0:
            hint = "; give shares, not percent" if 1.0 < value <= 100.0 else ""
            raise SceneError(f"{what}: value {value:g} at {wavelength:g} um is outside 0..1{hint}")
    curve.sort(key=lambda pair: pair[0])
    for (before, _), (after, _) in pairwise(curve):
        if after <= before:
            raise SceneError(f"{what}: {after:g} um is given twice")
    if max(value for _, value in curve) == 0.0:
        raise SceneError(f"{what}: is empty, all values are 0; allowed: at least one above 0")
    return tuple(curve)


def read_curve(path: Path) -> Curve:
    """Reads a text file of two columns, with header rows or without.

    Comments begin with #; columns are separated by semicolon, tab, comma or blanks.

    Raises:
        SceneError: unreadable, not two columns of numbers, or as `check_curve`.
    """
    try:
        lines = [line.split("#")[0] for line in read_table_text(path).splitlines()]
        table = number_table("\n".join(lines))
    except FileError as error:
        raise SceneError(str(error)) from error
    except ValueError as error:
        raise SceneError(f"{path}: {error}; allowed: wavelength_um and value in a line") from error
    rows = [(*row.values,) for row in table.rows if row.label is None]
    if not rows or len(rows[0]) != 2:
        width = len(rows[0]) if rows else 1
        raise SceneError(f"{path}: {width} columns; allowed: two, wavelength_um and value")
    return check_curve(rows, what=str(path))
