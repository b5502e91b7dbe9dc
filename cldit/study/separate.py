"""Two models of a spray, and the measurement that would tell them apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.accuracy.error_maps import TOTAL
from cldit.arrays import Floats
from cldit.camera.view import SensorView
from cldit.comparison.shared import unshared
from cldit.comparison.shown import open_shown
from cldit.dit.design import BlackBody, shot_time_s
from cldit.dit.separation import Rivals, Separation, rivals
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.optics.spectral import Quadrature
from cldit.radiance.weights import Weights
from cldit.run import Run, Say, open_run, simulate
from cldit.run.ensemble import member_folder
from cldit.scene import Scene
from cldit.scene.delays import delay_folder, scene_at, spray_time_s, without_delays


@dataclass(frozen=True)
class Model:
    """The run of one model, and those of its single injections; without any, they do not differ."""

    run: Run
    injections: tuple[Run, ...] = ()


def separate(
    one: Scene,
    other: Scene,
    folder: Path,
    blackbody: BlackBody,
    *,
    delays_s: Sequence[float] = (),
    least_emissivity: float = 0.2,
    device: Device | None = None,
    progress: Say | None = None,
) -> list[Separation]:
    """Fastest plan that separates two models, for each delay; runs are kept in `folder`.

    Without delays, that of the scenes' sprays is taken.
    """
    check_rivals(one, other)
    found = []
    for delay_s in delays_s or (None,):
        models = []
        for name, scene in (("one", one), ("other", other)):
            at = without_delays(scene if delay_s is None else scene_at(scene, delay_s))
            place = folder / name / ("" if delay_s is None else delay_folder(delay_s))
            run = simulate(at, place, device=device, progress=progress)
            count = 0 if run.ensemble is None else run.ensemble.members
            members = tuple(open_run(member_folder(place, n)) for n in range(1, count + 1))
            models.append(Model(run, members))
        found.append(separated(models[0], models[1], blackbody, least_emissivity=least_emissivity))
    return found


def check_rivals(one: Scene, other: Scene) -> None:
    """Raises EvaluationError if the sensors of two scenes see different places."""
    first, second = (SensorView.from_scene(scene) for scene in (one, other))
    for key, name in (
        ("field_m", "camera.field_m"),
        ("centre_m", "camera.target_m"),
        ("pixels", "camera.sensor.pixels"),
    ):
        values = getattr(first, key), getattr(second, key)
        if values[0] != values[1]:
            raise EvaluationError(
                f"{name}: {values[0]} in {one.name}, {values[1]} in {other.name}; allowed: scenes "
                "whose sensors see the same places, with any other keys"
            )


def separated(
    one: Model, other: Model, blackbody: BlackBody, *, least_emissivity: float = 0.2
) -> Separation:
    """The fastest plan that separates two models at the time of their runs."""
    errors_K = dict(_errors(one.run, other.run))
    found = rivals_of(one, other, errors_K=errors_K, least_emissivity=least_emissivity)
    return found.best(blackbody, shot_s=shot_time_s(one.run.scene))


def rivals_of(
    one: Model, other: Model, *, errors_K: Mapping[str, Floats], least_emissivity: float = 0.2
) -> Rivals:
    """Two models in the pixels of the sensor that see at least this emissivity of the first one.

    errors_K has the errors of both simulations by source, (H, W) of the trace.
    """
    scene = one.run.scene
    subject = Subject.of(
        scene,
        one.run.quadrature,
        one.run.spectral,
        one.run.reference,
        least_emissivity=least_emissivity,
    )
    view = SensorView.from_scene(scene)
    return rivals(
        scene,
        subject,
        _model(other.run),
        injections=[_model(each) for each in one.injections],
        errors_K={name: view.image(image) for name, image in errors_K.items()},
        delay_s=spray_time_s(scene),
    )


def _model(run: Run) -> tuple[Scene, Quadrature, tuple[Weights, ...], Weights]:
    return run.scene, run.quadrature, run.spectral, run.reference


def _errors(one: Run, other: Run) -> Iterator[tuple[str, Floats]]:
    """Errors (H, W) of both simulations by source; those that they share count once.

    An error by a key that one of them alone omits is part of the difference.
    """
    parts = unshared(open_shown(one), open_shown(other))
    for run, skipped in ((one, parts.tested), (other, (*parts.tested, *parts.shared))):
        for cause in () if run.errors is None else run.errors.causes:
            if cause.error_K is None or cause.name in (*skipped, TOTAL):
                continue
            shape = run.maps.emissivity.shape
            image = run.error_maps.get(cause.name, np.full(shape, cause.error_K, np.float32))
            yield (
                f"{cause.name} of {'both' if cause.name in parts.shared else run.scene.name}",
                np.nan_to_num(image).astype(float),
            )
