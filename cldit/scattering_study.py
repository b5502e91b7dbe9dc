"""How much better than plain DIT an evaluation is that knows about scattering, and where it fails.

The truth is simulated: of one trace, the temperatures that emit are known in every pixel. It is
then evaluated with models of the spray that are right and that are wrong, and without any.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps
from cldit.dit.scattering import (
    droplet_radiance,
    medium_of_two_walls,
    medium_temperature,
    wall_share,
)
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import build_octree
from cldit.optics.response import scene_filter
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.run.medium import properties_of
from cldit.scene import Scene, parse_scene
from cldit.spray.source import make_spray
from cldit.transport.trace import settings_for, trace

Floats = NDArray[np.float64]
Say = Callable[[str], None]

LEAST_EMISSIVITY = 0.2
WALLS_APART_K = 50.0  # of the second wall temperature below the first
WALL_ERROR_K = 2.0  # by which a wall temperature may be known wrongly


@dataclass(frozen=True)
class Traced:
    """A scene's weights and the shares of what emits, all (H, W) before the background."""

    weights: Weights
    vapour_share: Floats
    liquid_share: Floats
    reference: Weights


@dataclass(frozen=True)
class Row:
    """One way to evaluate: bias and RMS in K against the truth, noise at the scene's shots.

    medium_*: against the temperature of all that emits, pixels of emissivity 0.2 and more.
    droplets_*: against the droplets' own, where they emit more than the vapour.
    told: part of the pixels that get a temperature.
    """

    method: str
    model: str
    medium_bias_K: float
    medium_rms_K: float
    droplets_bias_K: float
    droplets_rms_K: float
    noise_K: float
    told: float


@dataclass(frozen=True)
class Study:
    """rows, and pictures (H, W) of errors in K: of plain DIT, and with models 20 % off.

    wet: part of the pixels in which the droplets emit more than the vapour.
    """

    rows: tuple[Row, ...]
    errors: Mapping[str, Floats]
    wet: float
    scene: Scene


def traced(scene: Scene, device: Device, cache: Path) -> Traced:
    """Two traces: what the scene emits, and what it would if every phase emitted 1.

    Raises:
        EvaluationError: the scene is resolved into several wavelengths.
    """
    spray = make_spray(scene.spray, cache=cache)
    found = properties_of(scene, spray, cache=cache)
    if len(found.sources) != 1:
        raise EvaluationError("optics.preset: spectral; the study takes one wavelength (paper)")
    ((points, cells),) = found.sources
    unit_points = None if points is None else replace(points, emission_m2=points.absorption_m2)
    unit_cells = [
        replace(
            cell,
            vapour_emission=cell.vapour_absorption,
            droplet_emission=cell.droplet_absorption,
        )
        for cell in cells
    ]
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    settings = settings_for(scene, found.phases[0])
    weights = [
        trace(
            build_octree(frame, *sources, optical_depth_split=domain.optical_depth_split),
            scene,
            device,
            settings,
        ).weights
        for sources in ((points, cells), (unit_points, unit_cells), (None, []))
    ]
    return Traced(
        weights=weights[0],
        vapour_share=weights[1].vapour.astype(float),
        liquid_share=weights[1].liquid.astype(float),
        reference=weights[2],
    )


def wrong_models(scene: Scene) -> dict[str, Scene]:
    """The scene, and models of it that are off by what one does not know of a real spray.

    Raises:
        EvaluationError: the scene's spray has no droplet sizes, mass and plumes to change.
    """
    data = scene.model_dump(mode="json")
    spray = data["spray"]
    if not {"droplets", "injected_mass_kg", "plumes"} <= set(spray) or "m_um" not in (
        spray["droplets"] or {}
    ):
        raise EvaluationError(
            f"spray.model: {spray['model']}; the study needs one with plumes, mass and a "
            "Nukiyama-Tanasawa distribution, as gdi has"
        )

    def changed(**parts: Any) -> Scene:
        return parse_scene({**data, **parts})

    def sprayed(**parts: Any) -> Scene:
        return changed(spray={**spray, **parts})

    sizes, mass = spray["droplets"], spray["injected_mass_kg"]
    wider = [
        {**plume, "inclination_deg": plume["inclination_deg"] + 2.0} for plume in spray["plumes"]
    ]
    return {
        "right": scene,
        "droplets 20 % larger": sprayed(droplets={**sizes, "m_um": 1.2 * sizes["m_um"]}),
        "droplets 20 % smaller": sprayed(droplets={**sizes, "m_um": 0.8 * sizes["m_um"]}),
        "20 % more fuel": sprayed(injected_mass_kg=1.2 * mass),
        "20 % less fuel": sprayed(injected_mass_kg=0.8 * mass),
        "plumes 2 deg wider": sprayed(plumes=wider),
        "k 30 % larger": changed(optics={**data["optics"], "k": 1.3 * data["optics"]["k"]}),
    }


def scattering_study(
    scene: Scene, device: Device, *, cache: Path, progress: Say | None = None
) -> Study:
    """Evaluates the traced scene in every way.

    Raises:
        EvaluationError: the scene cannot be varied, or has windows or one background.
    """
    if scene.windows or scene.patches:
        raise EvaluationError("windows, patches: the study takes a scene without")
    models: dict[str, Traced] = {}
    for name, model in wrong_models(scene).items():
        if progress is not None:
            progress(f"trace: {name}")
        models[name] = traced(model, device, cache)
    return Study(*_evaluated(scene, models), scene)


def _evaluated(
    scene: Scene, models: Mapping[str, Traced]
) -> tuple[tuple[Row, ...], dict[str, Floats], float]:
    truth = models["right"]
    curve = Curve(filter_um=scene_filter(scene))
    wall_K = scene.walls.temperature_K
    other_K = wall_K - WALLS_APART_K
    sensor = SensorModel.from_scene(scene)
    maps, colder = (_maps(scene, truth, curve, sensor, kelvin) for kelvin in (wall_K, other_K))
    lit = truth.reference.background > 0.999
    here = lit & (maps.emissivity >= LEAST_EMISSIVITY) & np.isfinite(maps.apparent_temperature_K)
    total = truth.weights.vapour.astype(float) + truth.weights.liquid
    share = truth.vapour_share + truth.liquid_share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium_K = curve.temperature(np.where(here, total / share, np.nan))
        liquid = np.where(here & (truth.liquid_share > 0.05), truth.liquid_share, np.nan)
        droplets_K = curve.temperature(truth.weights.liquid / liquid)
    wet = here & (truth.liquid_share > truth.vapour_share) & np.isfinite(droplets_K)

    def row(method: str, model: str, kelvin: Floats, noise_K: Floats | None) -> Row:
        told = here & np.isfinite(kelvin)
        off, drops = (kelvin - medium_K)[told], (kelvin - droplets_K)[wet & told]
        return Row(
            method,
            model,
            *_bias_rms(off),
            *_bias_rms(drops),
            float("nan") if noise_K is None else float(np.nanmedian(noise_K[told])),
            float(told.sum() / here.sum()),
        )

    plain_K = maps.apparent_temperature_K.astype(float)
    rows = [
        row("plain DIT", "none", plain_K, maps.apparent_temperature_standard_error_K.astype(float))
    ]
    for error_K in (0.0, WALL_ERROR_K):
        walls = (wall_K, other_K + error_K)
        two = medium_of_two_walls(maps, colder, wall_temperatures_K=walls, curve=curve)
        model = f"none; walls {wall_K:g} and {other_K:g} K"
        model += f", one {error_K:g} K off" if error_K else ""
        rows.append(row("two walls", model, two.temperature_K, two.standard_error_K))
    for name, model_trace in models.items():
        known = medium_temperature(
            maps,
            wall_share(model_trace.weights, model_trace.reference),
            wall_temperature_K=wall_K,
            curve=curve,
        )
        rows.append(row("scattered share", name, known.temperature_K, known.standard_error_K))
    for name, model_trace in models.items():
        radiance = droplet_radiance(
            maps,
            model_trace.weights,
            model_trace.liquid_share,
            wall_temperature_K=wall_K,
            curve=curve,
        )
        alone = row("droplets alone", name, curve.temperature(radiance), None)
        rows.append(replace(alone, medium_bias_K=float("nan"), medium_rms_K=float("nan")))
    larger = models["droplets 20 % larger"]
    shared = medium_temperature(
        maps, wall_share(larger.weights, larger.reference), wall_temperature_K=wall_K, curve=curve
    )
    alone_K = curve.temperature(
        droplet_radiance(
            maps, larger.weights, larger.liquid_share, wall_temperature_K=wall_K, curve=curve
        )
    )
    errors = {
        "plain DIT - what emits": np.where(here, plain_K - medium_K, np.nan),
        "scattered share, droplets 20 % larger - what emits": np.where(
            here, shared.temperature_K - medium_K, np.nan
        ),
        "plain DIT - droplets": np.where(wet, plain_K - droplets_K, np.nan),
        "droplets alone, 20 % larger - droplets": np.where(wet, alone_K - droplets_K, np.nan),
    }
    return tuple(rows), errors, float(wet.sum() / here.sum())


def _bias_rms(off: Floats) -> tuple[float, float]:
    if off.size == 0:
        return float("nan"), float("nan")
    return float(np.mean(off)), float(np.sqrt(np.mean(off**2)))


def _maps(scene: Scene, truth: Traced, curve: Curve, sensor: SensorModel, wall_K: float) -> Maps:
    around = replace(Surroundings.from_scene(scene), wall_temperature_K=wall_K)
    return evaluate_radiance(
        truth.weights,
        truth.reference,
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=around,
        filter_um=curve.filter_um,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )
