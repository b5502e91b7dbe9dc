"""Two models of a spray, as signals of the same pixels, with all that changes these."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cldit.accuracy.error_maps import TOTAL
from cldit.accuracy.errors import OMISSION
from cldit.arrays import Floats
from cldit.camera.view import SensorView
from cldit.comparison.unknowns import Unknown
from cldit.dit.separation import Rivals
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.run import Run, open_run
from cldit.run.ensemble import INJECTIONS, NOMINAL
from cldit.scene import Scene
from cldit.scene.delays import spray_time_s
from cldit.scene.keys import coarsened
from cldit.scene.scatter import member, members_of, nominal
from cldit.scene.spray import LagrangianSpray

_DRAWS = 12  # of the unknowns, with each model
Trace = Callable[[Scene, Run | None], Run]
"""Runs a scene, with the resolution of another run if there is one."""


def in_band(scene: Scene, optics: Scene) -> Scene:
    """A scene seen through the filter of another one, with the optical properties there."""
    transport = scene.transport.model_copy(update={"phase": optics.transport.phase})
    return scene.model_copy(update={"optics": optics.optics, "transport": transport})


def check_rivals(scene: Scene, rival_scene: Scene) -> None:
    """Raises EvaluationError if the sensors of two scenes see different places."""
    view, rival_view = (SensorView.from_scene(seen) for seen in (scene, rival_scene))
    for key, name in (
        ("field_m", "camera.field_m"),
        ("centre_m", "camera.target_m"),
        ("pixels", "camera.sensor.pixels"),
    ):
        values = getattr(view, key), getattr(rival_view, key)
        if values[0] != values[1]:
            raise EvaluationError(
                f"{name}: {values[0]} in {scene.name}, {values[1]} in {rival_scene.name}; "
                "allowed: scenes whose sensors see the same places, with any other keys"
            )


def rivals_of(
    model: Run,
    rival: Run,
    trace: Trace,
    *,
    band: str = "",
    unknowns: Sequence[Unknown] = (),
    least_emissivity: float = 0.2,
) -> Rivals:
    """Two models in the pixels of the sensor that see at least this emissivity of the first one.

    `trace` makes, of both, runs with drawn values of all unknowns; of the first one, a run with
    another value of each unknown and, if it states no error, one with wider cells.
    """
    scene, base = nominal(model.scene), model
    if members_of(model.scene) > 1:
        assert model.folder is not None
        base = open_run(model.folder / NOMINAL)
    pairs = zip(
        drawn(model.scene, unknowns, _DRAWS, seed=1),
        drawn(rival.scene, [item.of_scene(rival.scene) for item in unknowns], _DRAWS, seed=1),
        strict=False,  # none of a model that does not vary
    )
    traced = (model.scene, model.quadrature, model.spectral, model.reference)
    subject = Subject.of(*traced, least_emissivity=least_emissivity)

    def seen(run: Run) -> Subject:
        return subject.of_model(run.scene, run.quadrature, run.spectral, run.reference)

    view = SensorView.from_scene(model.scene)
    errors = {
        name: np.array([view.image(image).reshape(-1)[subject.places] for image in images])
        for name, images in _errors(model).items()
    }
    wider = coarsened(scene, 2.0)
    return Rivals(
        scene=model.scene,
        model=subject,
        rival=seen(rival),
        about=seen(base),
        unknowns={
            item.key: seen(trace(scene.with_(**item.values(1.0)), base)) for item in unknowns
        },
        draws=[
            (sizes, seen(trace(sample, base)), seen(trace(rival_sample, base)))
            for (sizes, sample), (_, rival_sample) in pairs
        ],
        coarser=[seen(trace(wider, None))] if not errors and wider != scene else [],
        errors=errors,
        delay_s=spray_time_s(model.scene),
        band=band,
    )


def drawn(
    scene: Scene, unknowns: Sequence[Unknown], count: int, *, seed: int
) -> list[tuple[Floats, Scene]]:
    """Single injections with values of the unknowns from their priors, and these in deviations.

    None without unknowns, if injections do not differ.
    """
    varied = bool(scene.spray.scatter.traced) or isinstance(scene.spray, LagrangianSpray)
    rng = np.random.default_rng(seed)
    scenes = []
    for number in range(count if varied or unknowns else 0):
        sizes = rng.standard_normal(len(unknowns))
        values: dict[str, float] = {"spray.scatter.seed": int(rng.integers(2**31))}
        for unknown, size in zip(unknowns, sizes, strict=True):
            values |= unknown.values(float(size))
        sample = scene.with_(**values)
        scenes.append((sizes, member(sample, number + 1) if varied else nominal(sample)))
    return scenes


def _errors(run: Run) -> dict[str, tuple[Floats, Floats]]:
    """Errors (H, W) of T_app and emissivity that a run states, by source.

    Omitted physics is the models' own, and the scatter of injections is counted as such.
    """
    errors: dict[str, tuple[Floats, Floats]] = {}
    for cause in () if run.errors is None else run.errors.causes:
        if cause.error_K is None or cause.shared_by == OMISSION:
            continue
        if cause.name in (TOTAL, INJECTIONS):
            continue
        shape = run.maps.emissivity.shape
        of_K = run.error_maps.get(cause.name, np.full(shape, cause.error_K, np.float32))
        of_e = run.emissivity_error_maps.get(
            cause.name, np.full(shape, cause.emissivity or 0.0, np.float32)
        )
        kelvin, emissivity = (np.nan_to_num(image).astype(float) for image in (of_K, of_e))
        errors[f"{cause.name} of the simulation"] = kelvin, emissivity
    return errors
