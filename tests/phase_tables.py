"""Phase functions as the tables that kernels sample, for tests."""

from __future__ import annotations

from cldit.optics import scene_phase
from cldit.transport.phase import ScatteringTable


def henyey_greenstein(g: float) -> ScatteringTable:
    """Table of the phase function of Henyey and Greenstein."""
    return ScatteringTable.of(scene_phase.henyey_greenstein(g))
