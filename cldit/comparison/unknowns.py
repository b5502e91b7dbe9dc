"""Free parameters of a spray: keys of the scene with the standard deviations of their priors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cldit.errors import SceneError, StudyError
from cldit.io.plain_data import read_mapping
from cldit.scene import Scene
from cldit.scene.keys import value_at

DEFAULT: Mapping[str, str | float] = {
    "spray.mixing_length": "5 %",
    "spray.plumes[*].cone_angle_deg": 2.0,
    "spray.droplets.m_um": "5 %",  # and of D32
    "spray.injected_mass_kg": "5 %",  # and of the rate
    "spray.time_s": 20e-6,  # start of injection
    "spray.ambient.temperature_K": 3.0,
}
"""Priors that apply to the keys of these that a scene has."""


@dataclass(frozen=True)
class Unknown:
    """A key and the values of the scene's paths that it is short for; `[*]` is each of a list.

    deviations: of each path, which are one random number.
    """

    key: str
    text: str
    means: Mapping[str, float]
    deviations: Mapping[str, float]

    @classmethod
    def of(cls, key: str, deviation: Any, scene: Scene) -> Unknown:
        """A deviation is a number in the key's unit, or a share such as `5 %`.

        Raises SceneError if the scene has no such key, StudyError if a value is not allowed.
        """
        head, star, tail = key.partition("[*]")
        paths = [f"{head}[{i}]{tail}" for i in range(len(value_at(scene, head)))] if star else [key]
        means = {path: value_at(scene, path) for path in paths}
        for path, value in means.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise StudyError(f"{key}: {path} is {value!r}; allowed: keys with a number")
        try:
            share = str(deviation).endswith("%")
            size = float(str(deviation).removesuffix("%")) / (100.0 if share else 1.0)
        except ValueError:
            size = math.nan
        if not (0.0 < size < math.inf):
            raise StudyError(
                f"{key}: {deviation!r}; allowed: a standard deviation above 0, such as 2.0 or 5 %"
            )
        sizes = {path: size * (abs(value) if share else 1.0) for path, value in means.items()}
        return cls(key, f"{key} ({deviation})", means, sizes)

    def of_scene(self, scene: Scene) -> Unknown:
        """The same deviations about the values of another scene."""
        return replace(self, means={path: value_at(scene, path) for path in self.means})

    def values(self, deviations: float) -> dict[str, float]:
        """Values of the paths, so many deviations above those of the scene."""
        return {
            path: float(f"{mean + deviations * self.deviations[path]:.9g}")
            for path, mean in self.means.items()
        }


def unknowns_of(
    scene: Scene, data: Mapping[str, float | str] | str | Path = DEFAULT
) -> tuple[Unknown, ...]:
    """Unknowns of a mapping or YAML file, `KEY: DEVIATION`; of `DEFAULT`, those the scene has."""
    named = "" if isinstance(data, Mapping) else f"{data}: "
    deviations = data if isinstance(data, Mapping) else read_mapping(Path(data), error=StudyError)
    unknowns = []
    for key, value in deviations.items():
        try:
            unknowns.append(Unknown.of(key, value, scene))
        except SceneError as error:
            if data is not DEFAULT:  # with a key of another model or distribution
                raise StudyError(f"{named}{error}") from error
        except StudyError as error:
            raise StudyError(f"{named}{error}") from error
    return tuple(unknowns)
