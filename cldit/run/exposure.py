"""Image of an exposure, `camera.exposure: times`: the mean light of several times of the spray.

The times are the Gauss-Legendre nodes of the exposure, which is centred at the spray's own time;
that is the middle node, traced with its error. Its resolution is that of the others.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.accuracy.errors import Cause
from cldit.errors import SceneError
from cldit.run.mean_light import MeanLight
from cldit.run.result import Run
from cldit.scene import Scene
from cldit.scene.delays import scene_at, spray_time_s

EXPOSURE = "exposure times"
_TIMES = 3  # with a middle one; exact for light of fifth order in time


def exposed(scene: Scene) -> bool:
    """True if a scene's image is the mean light of several times of its spray."""
    camera, model = scene.camera, scene.spray.model
    allowed = {
        "times": ("cone", "lagrangian"),
        "smear": ("lagrangian", "cfd"),
        "instant": (model,),
    }[camera.exposure]
    if model not in allowed:
        reason = "no times between those of its files" if model == "cfd" else "no velocities"
        reason = "neither times nor velocities" if model in ("grid", "none") else reason
        alternative = {"cone": "times", "cfd": "smear"}.get(model, "instant")
        raise SceneError(
            f"camera.exposure: {camera.exposure} with spray.model {model}, which has {reason}; "
            f"allowed: {alternative}"
        )
    return camera.exposure == "times"


def exposed_run(
    scene: Scene,
    folder: Path | None,
    like: Run | None,
    *,
    trace: Callable[[Scene, Path | None, Run | None], Run],
) -> Run:
    """The run of the mean light of a scene's exposure.

    `trace` returns the run of one scene in a folder, with the resolution of another run.
    """
    camera = scene.camera
    places, shares = np.polynomial.legendre.leggauss(_TIMES)
    instant = scene.model_copy(update={"camera": camera.model_copy(update={"exposure": "instant"})})
    middle_s = spray_time_s(scene)
    assert middle_s is not None
    middle_run = trace(instant, None, like)

    def time_runs() -> Iterator[Run]:
        for place in places:
            at_s = middle_s + 0.5 * camera.exposure_s * float(place)
            at_middle = abs(place) < 1e-12
            yield middle_run if at_middle else trace(scene_at(instant, at_s), None, middle_run)

    runs = list(time_runs())
    light = MeanLight.of(scene, runs, middle_run, label="times", shares=shares.tolist())
    remark = (
        f"mean light of {len(runs)} times within {1e6 * camera.exposure_s:g} us; figures of the "
        "spray are those of the middle one"
    )
    run = light.run(scene, middle_run, folder, remark)
    errors = run.info.errors
    if errors is None or errors.why:
        return run
    causes = (*errors.causes, _error(scene, runs, middle_run, light, places))
    return replace(run, info=replace(run.info, errors=replace(errors, causes=causes)))


def _error(
    scene: Scene, runs: list[Run], middle_run: Run, light: MeanLight, places: np.ndarray
) -> Cause:
    """Difference from the rule without the middle time, of lower order: an upper bound."""
    outer = [number for number, place in enumerate(places) if abs(place) > 1e-12]
    powers = np.vander(places[outer], increasing=True).T
    integrals = [0.0 if n % 2 else 2.0 / (n + 1) for n in range(len(outer))]
    shares = np.linalg.solve(powers, integrals).tolist()
    outer_runs = [runs[number] for number in outer]
    outer_light = MeanLight.of(scene, outer_runs, middle_run, label="times", shares=shares).maps
    valid = light.maps.has_temperature & outer_light.has_temperature
    rms = []
    for name in ("apparent_temperature_K", "emissivity"):
        difference = (getattr(light.maps, name) - getattr(outer_light, name))[valid].astype(float)
        rms.append(float(np.sqrt(np.mean(difference**2))) if valid.any() else None)
    method = f"mean of {len(runs)} times against {len(outer)} of them, at lower order"
    return Cause(EXPOSURE, rms[0], method, "", at_most=True, emissivity=rms[1])
