"""Reads a case in the frame of the sample (`conftest.Foam.sample`), or is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
    with pytest.raises(SprayError, match=message):
        read(path, **keys)
