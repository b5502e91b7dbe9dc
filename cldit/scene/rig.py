"""How the simulated rig behaves, and how often it records."""

from __future__ import annotations

from typing import Annotated

from cldit.scene.checks import Section, Within
from cldit.scene.values import Temperature


class Rig(Section):
    """How the simulated rig behaves."""

    background_time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    background_start_K: Temperature = 295.0
    shot_scatter: Annotated[float, Within(0.0, 1.0)] = 0.03  # relative, of the optical depth
    shot_scatter_length_m: Annotated[float, Within(1e-5, 1.0)] = 4e-3
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1


class PlanSize(Section):
    """How often the rig records at each background."""

    shots: Annotated[int, Within(1, 100_000)] = 5
    references: Annotated[int, Within(1, 100_000)] = 5
