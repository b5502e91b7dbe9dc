"""Fit of a scene's camera and walls to a CFD case."""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.camera.view import SensorView
from cldit.scene import Scene
from cldit.spray.result import Spray

_CUT = 1e-3  # share of the fuel outside the field that is worth a remark
_SMALL = 0.4  # of the field's width and height: a smaller spray has few pixels
_DIFFERENT_K = 5.0  # of walls and gas


@dataclass(frozen=True)
class Fuel:
    """Positions (N, 3) of a spray's fuel, liquid and vapour, with their masses (N,)."""

    position_m: Floats
    mass_kg: Floats

    @classmethod
    def of(cls, spray: Spray) -> "Fuel":
        """Collects all parcels, and the centres of all cells with vapour."""
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
        """Lower and upper corner (3,) of the fuel without a share of its mass at either end."""
        low, high = np.zeros(3), np.zeros(3)
        for axis in range(3):
            order = np.argsort(self.position_m[:, axis])
            reached = np.cumsum(self.mass_kg[order])
            ends = np.searchsorted(reached, [share * reached[-1], (1 - share) * reached[-1]])
            lowest, highest = order[np.minimum(ends, len(order) - 1)]
            low[axis], high[axis] = self.position_m[lowest, axis], self.position_m[highest, axis]
        return low, high


def seen_m(scene: Scene, position_m: Floats) -> Floats:
    """Projects positions (N, 3) onto the plane of the camera's target: x and z (N, 2), m, from the
    centre of the field."""
    offset = position_m - np.array(scene.target_m)
    if scene.camera.model == "orthographic":
        return np.asarray(offset[:, [0, 2]])
    distance_m = scene.camera.distance_m
    return np.asarray(offset[:, [0, 2]] * (distance_m / (distance_m + offset[:, 1]))[:, None])


def misfits(scene: Scene, spray: Spray) -> tuple[str, ...]:
    """Remark on a scene's camera and walls that do not fit its CFD case, or nothing."""
    fuel = Fuel.of(spray)
    if not fuel.mass_kg.sum():
        return ()
    mismatches = [*_field(scene, fuel)]
    ambient_K = spray.notes.get("ambient_temperature_K")
    wall_K = spray.notes.get("wall_temperature_K", ambient_K)
    if wall_K is not None and abs(wall_K - scene.walls.temperature_K) > _DIFFERENT_K:
        whose = "walls" if "wall_temperature_K" in spray.notes else "gas outside the jet"
        mismatches.append(
            f"walls.temperature_K is {scene.walls.temperature_K:g} K, the case's {whose} "
            f"{'have' if whose == 'walls' else 'has'} {wall_K:.0f} K"
        )
    if not mismatches:
        return ()
    return (
        f"{scene.name} does not fit the case: {'; '.join(mismatches)} (`cldit import CASE --fit` "
        "writes a scene that does)",
    )


def _field(scene: Scene, fuel: Fuel) -> list[str]:
    """Reports a field that cuts the spray, or is much larger."""
    view = SensorView.from_scene(scene)  # of the images that the rig takes
    half = np.array(view.pixel_m) * np.array(view.pixels) / 2
    inside = np.all(np.abs(seen_m(scene, fuel.position_m)) <= half, axis=1)
    cut = float(fuel.mass_kg[~inside].sum() / fuel.mass_kg.sum())
    width, height = (f"{2e3 * edge:.3g}" for edge in half)
    if cut > _CUT:
        return [
            f"the sensor's field, {width} mm x {height} mm, excludes {100 * cut:.2g} % of the fuel"
        ]
    low, high = fuel.extent_m()
    size = np.maximum(high, 0.0) - np.minimum(low, 0.0)  # with the nozzle
    if np.all(size[[0, 2]] < 2 * _SMALL * half):
        return [
            f"the sensor's field is {width} mm x {height} mm, the spray {1e3 * size[0]:.2g} mm x "
            f"{1e3 * size[2]:.2g} mm"
        ]
    return []
