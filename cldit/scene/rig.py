"""The simulated rig, and the number of recordings."""

from typing import Annotated

from cldit.scene.checks import Section, Within
from cldit.scene.values import Temperature


class Rig(Section):
    """Behaviour of the simulated rig."""

    background_time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    """Time constant with which the black body approaches its set point."""
    background_start_K: Temperature = 295.0
    """Temperature of the black body when the sequence begins."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Random seed of noise and of `spray.scatter.optical_depth`."""


class PlanSize(Section):
    """Number of recordings at each background temperature."""

    shots: Annotated[int, Within(1, 100_000)] = 5
    """Number of injections at each background temperature."""
    references: Annotated[int, Within(1, 100_000)] = 5
    """Number of reference images, without injection, at each background temperature."""
    delays_s: tuple[Annotated[float, Within(1e-5, 0.1)], ...] = ()
    """Delays after the start of injection, at every background. Empty: `spray.time_s` alone."""
