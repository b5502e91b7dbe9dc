"""Reads a case in the frame of the sample (`conftest.Foam.sample`), or is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Spray

FRAME: dict[str, Any] = {"nozzle_m": (0.5e-3, 9e-3, 0.1e-3), "axis": "-y"}


def read(path: Path, **keys: Any) -> Spray:
    """Spray of a case; `keys` of the scene's spray come before those of the frame."""
    return read_cfd(CfdSpray(**({"file": path} | FRAME | keys)))


def notes_of(path: Path, **keys: Any) -> dict[str, float]:
    return read(path, **keys).notes


def refused(path: Path, message: str, **keys: Any) -> None:
    assert re.search(message, str(path.parent)) is None, "the name of the test's folder matches"
    with pytest.raises(SprayError, match=message):
        read(path, **keys)


def arrays_of(spray: Spray) -> dict[str, Any]:
    """All arrays of parcels and vapour by name."""
    found: dict[str, Any] = {}
    if (parcels := spray.parcels) is not None:
        names = ("position_m", "diameter_m", "droplets", "temperature_K", "density_kg_m3")
        found |= {name: getattr(parcels, name) for name in names}
    if (vapour := spray.vapour) is not None:
        found |= {"lower_m": vapour.cells.lower_m, "upper_m": vapour.cells.upper_m}
        found |= {"vapour_m3": vapour.number_density_m3, "vapour_K": vapour.temperature_K}
    return found


def same(one: Spray, two: Spray) -> bool:
    """True if notes and all arrays are equal to the bit."""
    first, second = arrays_of(one), arrays_of(two)
    if one.notes != two.notes or first.keys() != second.keys():
        return False
    return all(np.array_equal(first[name], second[name]) for name in first)
