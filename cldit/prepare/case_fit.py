"""How a scene's camera and walls fit a CFD case: what of the spray they show, and what they say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.camera.view import SensorView
from cldit.scene import Scene
from cldit.spray.result import Floats, Spray

_CUT = 1e-3  # share of the fuel outside the picture that is worth a word
_SMALL = 0.4  # of the picture's width and height: a spray that takes less has few pixels
_DIFFERENT_K = 5.0  # of walls and gas


@dataclass(frozen=True)
class Fuel:
    """Where a spray's fuel is: places (N, 3), liquid and vapour, with their masses (N,)."""

    position_m: Floats
    mass_kg: Floats

    @classmethod
    def of(cls, spray: Spray) -> Fuel:
        """All parcels, and the middles of all cells with vapour."""
        places, masses = [np.empty((0, 3))], [np.empty(0)]
        if spray.parcels is not None:
            places.append(spray.parcels.position_m)
            masses.append(spray.parcels.masses_kg)
        if spray.vapour is not None:
            cells = spray.vapour.cells
            places.append((cells.lower_m + cells.upper_m) / 2)
            masses.append(spray.vapour.masses_kg)
        return cls(np.concatenate(places), np.concatenate(masses))

    def extent_m(self, share: float = 1e-3) -> tuple[Floats, Floats]:
        """Lower and upper corner (3,) of the fuel but for a share of its mass at either end."""
        low, high = np.zeros(3), np.zeros(3)
        for axis in range(3):
            order = np.argsort(self.position_m[:, axis])
            reached = np.cumsum(self.mass_kg[order])
            ends = np.searchsorted(reached, [share * reached[-1], (1 - share) * reached[-1]])
            first, last = order[np.minimum(ends, len(order) - 1)]
            low[axis], high[axis] = self.position_m[first, axis], self.position_m[last, axis]
        return low, high


def seen_m(scene: Scene, position_m: Floats) -> Floats:
    """Where places appear in the plane of the camera's target.

    Args:
        scene: has the camera.
        position_m: (N, 3).

    Returns:
        x and z from the middle of the picture, m (N, 2).
    """
    away = position_m - np.array(scene.target_m)
    if scene.camera.model == "orthographic":
        return np.asarray(away[:, [0, 2]])
    distance_m = scene.camera.distance_m
    return np.asarray(away[:, [0, 2]] * (distance_m / (distance_m + away[:, 1]))[:, None])


def misfits(scene: Scene, spray: Spray) -> tuple[str, ...]:
    """What of a scene does not fit the case that it shows.

    Args:
        scene: with its camera and walls.
        spray: of a CFD case, in the project's frame.

    Returns:
        One line; none where all fits.
    """
    fuel = Fuel.of(spray)
    if not fuel.mass_kg.sum():
        return ()
    found = [*_field(scene, fuel)]
    ambient_K = spray.notes.get("ambient_temperature_K")
    wall_K = spray.notes.get("wall_temperature_K", ambient_K)
    if wall_K is not None and abs(wall_K - scene.walls.temperature_K) > _DIFFERENT_K:
        whose = "walls" if "wall_temperature_K" in spray.notes else "gas outside the jet"
        found.append(
            f"walls.temperature_K is {scene.walls.temperature_K:g} K, the case's {whose} "
            f"{'have' if whose == 'walls' else 'has'} {wall_K:.0f} K"
        )
    if not found:
        return ()
    return (
        f"{scene.name} does not fit the case: {'; '.join(found)} (`cldit import CASE --fit` writes "
        "a scene that does)",
    )


def _field(scene: Scene, fuel: Fuel) -> list[str]:
    """Whether the picture cuts the spray, or is far larger."""
    view = SensorView.from_scene(scene)  # the pictures that the rig takes
    half = np.array(view.pixel_m) * np.array(view.pixels) / 2
    inside = np.all(np.abs(seen_m(scene, fuel.position_m)) <= half, axis=1)
    cut = float(fuel.mass_kg[~inside].sum() / fuel.mass_kg.sum())
    width, height = (f"{2e3 * edge:.3g}" for edge in half)
    if cut > _CUT:
        return [
            f"the sensor's field, {width} mm x {height} mm, leaves {100 * cut:.2g} % of the fuel "
            "out"
        ]
    low, high = fuel.extent_m()
    size = np.maximum(high, 0.0) - np.minimum(low, 0.0)  # with the nozzle
    if np.all(size[[0, 2]] < 2 * _SMALL * half):
        return [
            f"the sensor's field is {width} mm x {height} mm, the spray {1e3 * size[0]:.2g} mm x "
            f"{1e3 * size[2]:.2g} mm"
        ]
    return []
