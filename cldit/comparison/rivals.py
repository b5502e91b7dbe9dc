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
from cldit.run.ensemble import INJECTIONS, NOMINAL, member_folder
from cldit.scene import Scene
from cldit.scene.delays import spray_time_s
from cldit.scene.keys import coarsened
from cldit.scene.scatter import member, members_of, nominal
from cldit.scene.spray import LagrangianSpray

_DRAWS = 6  # of the unknowns
Trace = Callable[[Scene, Run | None], Run]
"""Runs a scene, with the resolution of another run if there is one."""


def in_band(scene: Scene, optics: Scene) -> Scene:
    """A scene seen through the filter of another one, with the optical properties there."""
    transport = scene.transport.model_copy(update={"phase": optics.transport.phase})
    return scene.model_copy(update={"optics": optics.optics, "transport": transport})


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


def rivals_of(
    one: Run,
    other: Run,
    trace: Trace,
    *,
    band: str = "",
    unknowns: Sequence[Unknown] = (),
    least_emissivity: float = 0.2,
) -> Rivals:
    """Two models in the pixels of the sensor that see at least this emissivity of the first one.

    `trace` makes, of the first one, a run with another value of each unknown, some with drawn
    values of all of them and, if it states no error, one with wider cells.
    """
    scene, count = nominal(one.scene), members_of(one.scene)
    base, members = one, list[Run]()
    if count > 1:
        assert one.folder is not None
        base = open_run(one.folder / NOMINAL)
        members = [open_run(member_folder(one.folder, n + 1)) for n in range(count)]
    draws = drawn(one.scene, unknowns, _DRAWS, seed=1)
    subject = Subject.of(
        one.scene, one.quadrature, one.spectral, one.reference, least_emissivity=least_emissivity
    )

    def seen(run: Run) -> Subject:
        return subject.of_model(run.scene, run.quadrature, run.spectral, run.reference)

    view = SensorView.from_scene(one.scene)
    errors = {
        name: np.array([view.image(image).reshape(-1)[subject.places] for image in images])
        for name, images in _errors(one).items()
    }
    wider = coarsened(scene, 2.0)
    return Rivals(
        scene=one.scene,
        model=subject,
        rival=seen(other),
        about=seen(base),
        unknowns={
            each.key: seen(trace(scene.with_(**each.values(1.0)), base)) for each in unknowns
        },
        draws=[(sizes, seen(trace(of, base))) for sizes, of in draws],
        members=[seen(run) for run in members],
        coarser=[seen(trace(wider, None))] if not errors and wider != scene else [],
        errors=errors,
        delay_s=spray_time_s(one.scene),
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
        for one, size in zip(unknowns, sizes, strict=True):
            values |= one.values(float(size))
        other = scene.with_(**values)
        scenes.append((sizes, member(other, number + 1) if varied else nominal(other)))
    return scenes


def _errors(run: Run) -> dict[str, tuple[Floats, Floats]]:
    """Errors (H, W) of T_app and emissivity that a run states, by source.

    Omitted physics is the models' own, and the scatter of injections is counted as such.
    """
    found: dict[str, tuple[Floats, Floats]] = {}
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
        found[f"{cause.name} of the simulation"] = kelvin, emissivity
    return found
