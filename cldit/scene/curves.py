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
from cldit.io.files import read_text

Curve = tuple[tuple[float, float], ...]
SHORTEST_UM, LONGEST_UM = 0.2, 50.0


def check_curve(pairs: Any, *, what: str) -> Curve:
    """The `pairs` in rising order of wavelength; errors name `what`.

    Raises:
        SceneError: not pairs of numbers, a wrong unit, fewer than two pairs, or no value above 0.
    """
    try:
        curve = [(float(wavelength), float(value)) for wavelength, value in pairs]
    except (TypeError, ValueError) as error:
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
    """Reads a text file of two columns, separated by comma, semicolon or blanks.

    Comments begin with #; a first line without numbers is a header.

    Raises:
        SceneError: unreadable, not two columns of numbers, or as `check_curve`.
    """
    try:
        lines = read_text(path).splitlines()
    except FileError as error:
        raise SceneError(str(error)) from error
    rows: list[tuple[float, float]] = []
    header = True
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            wavelength, value = (float(word) for word in words)
        except ValueError as error:
            if header and not rows:
                header = False
                continue
            raise SceneError(
                f"{path}, line {number}: {line.strip()!r}; allowed: two numbers, "
                "wavelength_um and value"
            ) from error
        rows.append((wavelength, value))
    return check_curve(rows, what=str(path))
