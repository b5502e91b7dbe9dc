"""Systematic lines of a simulation: changes of its T_app by one spread of a stated quantity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from cldit.comparison.pixels import together
from cldit.comparison.shown import Shown
from cldit.dit.budget import Part
from cldit.errors import EvaluationError
from cldit.run import reevaluated


def with_lines(
    shown: Shown, *, onto: Shown, base: Shown | None, variants: Mapping[str, Shown]
) -> Shown:
    """A simulation with the change of its T_app by each of the `variants`, and by its walls.

    variants: the simulation `base` with one quantity changed by its spread each. onto: the result
    with which it is compared, whose setup states the spread of the walls. Recordings, and runs
    beside runs, have no such lines but the variants'.
    """
    if shown.run is None:
        return shown
    parts = [_part(name, base or shown, variant, onto) for name, variant in variants.items()]
    parts += _walls(shown, onto)
    return replace(shown, systematic=(*shown.systematic, *parts))


def _part(name: str, base: Shown, variant: Shown, onto: Shown) -> Part:
    if base.run is None or variant.run is None:
        raise EvaluationError(f"line {name}: {variant.name} is no run; allowed: a run")
    before, after = (together(onto, one, resample=True)[1].maps for one in (base, variant))
    if before.emissivity.shape != after.emissivity.shape:
        raise EvaluationError(f"line {name}: {variant.name} has other pixels than {base.name}")
    change_K = after.apparent_temperature_K.astype(float) - before.apparent_temperature_K
    return Part(
        name=name,
        kelvin=np.nan_to_num(change_K),
        emissivity=np.nan_to_num(after.emissivity.astype(float) - before.emissivity),
    )


def _walls(shown: Shown, onto: Shown) -> Iterator[Part]:
    """Change by walls that are warmer by their spread, as the measurement states it."""
    spread_K = onto.walls_spread_K
    if shown.run is None or not spread_K:
        return
    scene = shown.run.scene
    warmer = scene.with_(**{"walls.temperature_K": scene.walls.temperature_K + spread_K})
    run = reevaluated(shown.run, warmer)
    yield _part(f"walls by {spread_K:g} K", shown, replace(shown, maps=run.maps, run=run), onto)
