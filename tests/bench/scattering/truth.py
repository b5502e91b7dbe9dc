"""Simulated truth: a trace with plates in the enclosure, and its maps in every arrangement.

The plates are patches of the enclosure, as warm as the walls unless an arrangement changes them:
`ring` around the background disc, `beside` the spray, and `before` it on the camera's side. So one
trace serves every arrangement of walls, plates and backgrounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps
from cldit.dit.scattering import WALL, Scattered, enclosure, scattered_by
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import build_octree
from cldit.optics.liquid import liquid
from cldit.optics.response import scene_filter
from cldit.optics.vapour import vapour_band
from cldit.prepare.medium import properties_of
from cldit.prepare.spray_factory import make_spray
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.scene.vessel import Patch
from cldit.transport.trace import settings_for, trace

Floats = NDArray[np.float64]

PLATES = ("ring", "beside", "before")
SECOND_FILTER_UM = (3.5, 3.6)  # where liquid absorbs most compared with its vapour
_LIQUID_K, _VAPOUR_K = 350.0, 400.0  # of n and k, of the cross section
_RING = 1.5  # radius of the ring over that of the disc
_PLATE = 0.4  # radius of the other plates over the cube's edge
_DIRECTIONS = 40_000
_AS_IT_IS: Mapping[str, float] = MappingProxyType({})


def with_plates(scene: Scene) -> Scene:
    """Scene with the three plates, as warm as the walls.

    Raises:
        EvaluationError: the background is not a disc.
        SceneError: a patch of the scene has the name of a plate.
    """
    if scene.background.shape != "disc":
        raise EvaluationError("background.shape: enclosure; the study needs a disc")
    x, y, z = scene.domain.centre_m
    half = scene.domain.edge_m / 2.0
    radius_m = _RING * scene.background.radius_m
    plates = {
        "ring": (scene.background_centre_m, [0, -1, 0], radius_m),
        "beside": ([x - half, y, z], [1, 0, 0], _PLATE * scene.domain.edge_m),
        "before": ([x, y - half, z], [0, 1, 0], _PLATE * scene.domain.edge_m),
    }
    added = [
        {
            "name": name,
            "centre_m": centre,
            "facing": facing,
            "radius_m": radius,
            "temperature_K": scene.walls.temperature_K,
        }
        for name, (centre, facing, radius) in plates.items()
    ]
    return scene.with_(patches=[*scene.model_dump(mode="json")["patches"], *added])


def through_second_filter(scene: Scene) -> Scene:
    """Scene at 3.5 to 3.6 um, with n, k and vapour cross section of the shipped data.

    Raises:
        OpticsError: there are no shipped data of the fuel.
    """
    low, high = SECOND_FILTER_UM
    um = np.linspace(low, high, 400)
    fuel = scene.model_dump(mode="json")["spray"]["fuel"]
    n, k = liquid(scene.optics.liquid or fuel).index(um, _LIQUID_K)
    vapour = vapour_band(scene.optics.vapour or fuel).absorption_m2_mol(1e4 / um, _VAPOUR_K)
    optics = {
        "filter_um": list(SECOND_FILTER_UM),
        "wavelength_um": 0.5 * (low + high),
        "n": float(np.mean(n)),
        "k": float(np.mean(k)),
        "vapour_m2_mol": float(np.mean(vapour)),
    }
    return scene.with_(**{f"optics.{key}": value for key, value in optics.items()})


@dataclass(frozen=True)
class Traced:
    """Weights of a scene, and shares of vapour and liquid in the light, (H, W) each."""

    scene: Scene
    weights: Weights
    vapour_share: Floats
    liquid_share: Floats
    reference: Weights

    @property
    def curve(self) -> Curve:
        """Planck's curve in the filter of the scene."""
        return Curve(filter_um=scene_filter(self.scene))

    def surroundings(self, changed_K: Mapping[str, float] = _AS_IT_IS) -> Surroundings:
        """Surroundings with changed temperatures: `wall` of walls and plates, else of a patch."""
        around = Surroundings.from_scene(self.scene)
        wall_K = changed_K.get(WALL, around.wall_temperature_K)
        moved = {**dict.fromkeys(PLATES, wall_K), **changed_K}

        def patch(one: Patch) -> Patch:
            return one.model_copy(update={"temperature_K": moved.get(one.name, one.temperature_K)})

        return replace(
            around, wall_temperature_K=wall_K, patches=tuple(patch(p) for p in around.patches)
        )

    def enclosure(
        self, changed_K: Mapping[str, float] = _AS_IT_IS, *, plate: str | None = None
    ) -> dict[str, float]:
        """Radiances of the walls, the patches of the scene, and of `plate` if named."""
        parts = enclosure(self.surroundings(changed_K), self.curve)
        return {
            name: leaving for name, leaving in parts.items() if name not in PLATES or name == plate
        }

    def scattered(self) -> Scattered:
        """Scattered shares with plates as warm as the walls."""
        spray, bare = (_joined(one, PLATES, into=WALL) for one in (self.weights, self.reference))
        return scattered_by(spray, bare, self.enclosure())

    def maps(
        self, changed_K: Mapping[str, float] = _AS_IT_IS, *, background: Sequence[str] = ()
    ) -> Maps:
        """Plain DIT; parts of the enclosure in `background` follow its temperature."""
        scene = self.scene
        traced, bare = (
            _joined(one, background, into="background") for one in (self.weights, self.reference)
        )
        around = self.surroundings(changed_K)
        return evaluate_radiance(
            traced,
            bare,
            background_temperatures_K=scene.background.temperatures_K,
            surroundings=replace(
                around, patches=tuple(p for p in around.patches if p.name not in background)
            ),
            filter_um=self.curve.filter_um,
            sensor=SensorModel.from_scene(scene),
            shots=scene.plan.shots,
            references=scene.plan.references,
        )


def _joined(weights: Weights, parts: Sequence[str], *, into: str) -> Weights:
    """Weights with parts of the enclosure added to background or walls."""
    images = dict(weights.images)
    for name in parts:
        images[into] = images[into] + images[name]
        if name == WALL:
            images[name] = np.zeros_like(images[name])
        else:
            del images[name]
    return Weights.of(images)


def traced(scene: Scene, device: Device, cache: Path) -> Traced:
    """Traces the scene, the scene with all phases equally bright, and the scene without spray.

    Raises:
        EvaluationError: the scene has several wavelengths.
    """
    spray = make_spray(scene.spray, device, cache=cache)
    found = properties_of(scene, spray, cache=cache)
    if len(found.sources) != 1:
        raise EvaluationError("optics.preset: spectral; the study takes one wavelength (paper)")
    ((points, cells),) = found.sources
    # As bright as the walls, since a trace ends where the rest is invisible.
    unit = float(Curve(filter_um=scene_filter(scene)).radiance(scene.walls.temperature_K))
    unit_points = (
        None if points is None else replace(points, emission_m2=unit * points.absorption_m2)
    )
    unit_cells = [
        replace(
            cell,
            vapour_emission=unit * cell.vapour_absorption,
            droplet_emission=unit * cell.droplet_absorption,
        )
        for cell in cells
    ]
    domain = scene.domain
    frame = Frame.around(centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_m)
    settings = settings_for(scene, found.phases[0])
    every: list[tuple[Any, Any]] = [(points, cells), (unit_points, unit_cells), (None, [])]
    weights = [
        trace(
            build_octree(
                frame, *sources, optical_depth_split=domain.optical_depth_split, device=device
            ),
            scene,
            device,
            settings,
        ).weights
        for sources in every
    ]
    return Traced(
        scene=scene,
        weights=weights[0],
        vapour_share=weights[1].vapour.astype(float) / unit,
        liquid_share=weights[1].liquid.astype(float) / unit,
        reference=weights[2],
    )


def solid_angles(scene: Scene) -> Mapping[str, float]:
    """Solid angles [sr] of the background disc and of each plate, seen from the target.

    They come from 40 000 even directions, with an error of about 1 %.
    """
    step = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    up, turn = 1.0 - 2.0 * step, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    flat = np.sqrt(1.0 - up**2)
    away = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    plates = {patch.name: patch for patch in scene.patches if patch.name in PLATES}
    disc = plates["ring"].model_copy(update={"radius_m": scene.background.radius_m})
    seen = {name: _meets(away, patch, scene.target_m) for name, patch in plates.items()}
    seen["background"] = _meets(away, disc, scene.target_m)
    seen["ring"] &= ~seen["background"]
    return {name: 4.0 * np.pi * float(np.mean(each)) for name, each in seen.items()}


def _meets(away: Floats, disc: Patch, start_m: tuple[float, float, float]) -> NDArray[np.bool_]:
    """True for the lines from a point that meet the front of a disc."""
    normal = np.asarray(disc.facing) / np.linalg.norm(disc.facing)
    to_centre = np.asarray(disc.centre_m) - start_m
    towards = away @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        length = (to_centre @ normal) / towards
        off = np.linalg.norm(length[:, None] * away - to_centre, axis=1)
        return np.asarray((towards < 0.0) & (length > 0.0) & (off <= (disc.radius_m or 0.0)))
