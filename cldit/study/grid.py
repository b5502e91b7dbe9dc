"""Grids of scenes: `walls.temperature_K=300:600:25,fuel.temperature_K=330,350,370`.

Keys are those of a scene, dotted; values are numbers, words, or start:stop:step with the stop
included.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from cldit.errors import StudyError
from cldit.scene import Scene

MOST_POINTS = 100_000
ALIASES = {
    "fuel.temperature_K": "spray.fuel_temperature_K",
    "fuel.pressure_Pa": "spray.injection_pressure_Pa",
    "gas.temperature_K": "spray.ambient.temperature_K",
    "gas.pressure_Pa": "spray.ambient.pressure_Pa",
    "time_s": "spray.time_s",
}
_KEY = re.compile(r"[A-Za-z]\w*(\[\d+\])?(\.[A-Za-z]\w*(\[\d+\])?)*")
_UNITS = ("K", "Pa", "m", "um", "s", "kg", "deg", "Hz")

Value = float | int | str | bool | None


@dataclass(frozen=True)
class Axis:
    """Key of a scene and its values; `name` is the key as it was given."""

    name: str
    key: str
    values: tuple[Value, ...]

    @property
    def unit(self) -> str:
        """Unit at the end of the name; 1 without."""
        unit = self.name.rpartition("_")[2]
        return unit if unit in _UNITS else "1"


@dataclass(frozen=True)
class Point:
    """Scene of a grid and its position on every axis."""

    number: int
    place: tuple[int, ...]
    scene: Scene


@dataclass(frozen=True)
class Grid:
    """All combinations of the values of the axes; the last axis varies fastest."""

    axes: tuple[Axis, ...]

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def points(self, base: Scene) -> Iterator[Point]:
        """Scenes of the grid, validated."""
        places = itertools.product(*(range(count) for count in self.shape))
        for number, place in enumerate(places):
            chosen = {axis.key: axis.values[at] for axis, at in zip(self.axes, place, strict=True)}
            yield Point(number, place, base.with_(**chosen))

    @classmethod
    def parse(cls, argument: str) -> Grid:
        """Reads the text of the command line."""
        axes: list[Axis] = []
        for part in argument.split(","):
            key, equals, value = part.partition("=")
            if equals:
                axes.append(_axis(key.strip(), argument))
            elif not axes:
                raise StudyError(
                    f"--grid {argument!r}: {part!r} has no key; write KEY=VALUES, for instance "
                    "walls.temperature_K=300:600:25,spray.fuel_temperature_K=330,350"
                )
            else:
                value = part
            axis = axes[-1]
            axes[-1] = Axis(axis.name, axis.key, (*axis.values, *_values(value.strip(), axis.name)))
        keys = [axis.key for axis in axes]
        for axis in axes:
            if keys.count(axis.key) > 1:
                raise StudyError(f"--grid: {axis.key} is given twice")
            if len(set(axis.values)) < len(axis.values):
                raise StudyError(f"--grid: {axis.name} has a value twice: {axis.values}")
        grid = cls(tuple(axes))
        if math.prod(grid.shape) > MOST_POINTS:
            raise StudyError(
                f"--grid: {math.prod(grid.shape)} scenes; allowed: at most {MOST_POINTS}"
            )
        return grid


def _axis(key: str, argument: str) -> Axis:
    if not _KEY.fullmatch(key):
        raise StudyError(
            f"--grid {argument!r}: {key!r} is no key of a scene; write it with dots, for instance "
            "walls.temperature_K"
        )
    return Axis(key, ALIASES.get(key, key), ())


def _values(argument: str, name: str) -> tuple[Value, ...]:
    if not argument:
        raise StudyError(f"--grid: {name} lacks a value; write {name}=1,2,3 or {name}=1:3:1")
    parts = argument.split(":")
    if len(parts) == 1:
        return (_value(argument),)
    try:
        start, stop, step = (float(part) for part in parts)
        finite = all(map(math.isfinite, (start, stop, step)))
    except ValueError:
        finite = False
    if not finite:
        raise StudyError(
            f"--grid: {name}={argument} is no range; write start:stop:step, as 300:600:25"
        )
    if step == 0 or (stop - start) / step < 0:
        raise StudyError(
            f"--grid: {name}={argument} has no value; the step must lead from start to stop"
        )
    # The stop is included if a whole number of steps leads there, to rounding.
    count = math.floor((stop - start) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST_POINTS:
        raise StudyError(f"--grid: {name}={argument} has {count} values; allowed: {MOST_POINTS}")
    integers = all("." not in part and "e" not in part.lower() for part in parts)
    numbers = [float(f"{start + k * step:.12g}") for k in range(count)]
    return tuple(int(number) if integers else number for number in numbers)


def _value(argument: str) -> Value:
    words: dict[str, Value] = {"true": True, "false": False, "null": None}
    if argument.lower() in words:
        return words[argument.lower()]
    for kind in (int, float):
        try:
            return kind(argument)
        except ValueError:
            continue
    return argument
