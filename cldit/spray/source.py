"""The spray that a scene names, from whichever model or file."""

from __future__ import annotations

from typing import assert_never

from cldit.scene.schema import CfdSpray, ConeSpray, EmptySpray, GridSpray
from cldit.spray.cfd import read_cfd
from cldit.spray.cone import make_cone
from cldit.spray.grid import read_grid
from cldit.spray.result import Spray


def make_spray(spec: ConeSpray | GridSpray | CfdSpray | EmptySpray) -> Spray:
    """Runs the model or reads the file.

    Raises:
        SprayError: the source is missing something or holds impossible values.
    """
    match spec:
        case ConeSpray():
            return make_cone(spec)
        case GridSpray():
            return read_grid(spec)
        case CfdSpray():
            return read_cfd(spec)
        case EmptySpray():
            return Spray()
        case _ as unreachable:
            assert_never(unreachable)
