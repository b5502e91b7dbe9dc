"""How the simulated rig behaves, and how often it records."""

from __future__ import annotations

from typing import Annotated

from cldit.scene.checks import Section, Within
from cldit.scene.values import Temperature


class Rig(Section):
    """How the simulated rig behaves."""

    background_time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    """With which the black body comes to its set point."""
    background_start_K: Temperature = 295.0
    """Of the black body when the sequence begins."""
    shot_scatter: Annotated[float, Within(0.0, 1.0)] = 0.03
    """Relative standard deviation of the spray's optical depth from shot to shot."""
    shot_scatter_length_m: Annotated[float, Within(1e-5, 1.0)] = 4e-3
    """Over which that scatter is alike."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Of noise and scatter."""


class PlanSize(Section):
    """How often the rig records at each background."""

    shots: Annotated[int, Within(1, 100_000)] = 5
    """Injections before each background."""
    references: Annotated[int, Within(1, 100_000)] = 5
    """Pictures without injection before each background."""
    delays_s: tuple[Annotated[float, Within(1e-5, 0.1)], ...] = ()
    """Times of the spray after the start of injection, each recorded before every background, with
    the shots and references above; none: `spray.time_s` alone."""
