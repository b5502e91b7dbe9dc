"""The scene of each of several injections, whose differences `spray.scatter` has."""

import math
from typing import Any

import numpy as np

from cldit.errors import SceneError
from cldit.scene.schema import Scene
from cldit.scene.spray import Scatter


def members_of(scene: Scene) -> int:
    """Number of injections that a scene's image is the mean of."""
    return scene.spray.scatter.members


def nominal(scene: Scene) -> Scene:
    """The scene without differences between injections that are traced."""
    scatter = Scatter(**scene.spray.scatter.model_dump(include={"optical_depth", "length_m"}))
    return scene.model_copy(update={"spray": scene.spray.model_copy(update={"scatter": scatter})})


def without_scatter(scene: Scene) -> Any:
    """The spray as such, without what differs from injection to injection."""
    return scene.spray.model_copy(update={"scatter": Scatter()})


def member(scene: Scene, number: int) -> Scene:
    """The scene of one injection, `number` 1, 2, ..: the same for any number of members."""
    spray, scatter = scene.spray, scene.spray.scatter
    _check_effects(scene, scatter)
    plain = spray.model_dump(mode="json")
    rng = np.random.default_rng([scatter.seed, number])
    start, duration, mass, fuel = rng.standard_normal(4)
    values: dict[str, Any] = {
        "name": f"{scene.name[:80]}, injection {number}",
        # A later start is an earlier time of the spray.
        "spray.time_s": plain["time_s"] - scatter.start_s * start,
        "spray.injection_duration_s": plain["injection_duration_s"] + scatter.duration_s * duration,
        "spray.injected_mass_kg": plain["injected_mass_kg"] * (1.0 + scatter.mass * mass),
        "spray.fuel_temperature_K": plain["fuel_temperature_K"] + scatter.fuel_temperature_K * fuel,
    }
    for hole, plume in enumerate(plain["plumes"]):
        outward, aside, wider = rng.standard_normal(3)
        turned = _turned(plume, scatter.direction_deg * outward, scatter.direction_deg * aside)
        turned["cone_angle_deg"] = plume["cone_angle_deg"] + scatter.cone_angle_deg * wider
        values |= {f"spray.plumes[{hole}].{key}": value for key, value in turned.items()}
    if spray.model == "lagrangian":
        values["spray.seed"] = int(rng.integers(2**31))
    try:
        return nominal(scene).with_(**values)
    except SceneError as error:
        raise SceneError(
            f"spray.scatter: injection {number} of seed {scatter.seed}: "
            f"{str(error).partition(':')[2].strip()}; allowed: smaller deviations"
        ) from error


def _turned(plume: dict[str, Any], outward_deg: float, aside_deg: float) -> dict[str, float]:
    """Angles of a plume that is turned in the plane of the injector's axis, and across it."""
    if outward_deg == aside_deg == 0.0:
        return {}
    tilt, turn = (math.radians(plume[key]) for key in ("inclination_deg", "azimuth_deg"))
    # Unit vectors of the plume, and along rising inclination and azimuth
    radial = np.array([math.cos(turn), math.sin(turn), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    along = math.sin(tilt) * radial + math.cos(tilt) * down
    outward = math.cos(tilt) * radial - math.sin(tilt) * down
    aside = np.array([-math.sin(turn), math.cos(turn), 0.0])
    x, y, z = along + math.radians(outward_deg) * outward + math.radians(aside_deg) * aside
    return {
        "inclination_deg": math.degrees(math.atan2(math.hypot(x, y), -z)),
        "azimuth_deg": math.degrees(math.atan2(y, x)),
    }


def _check_effects(scene: Scene, scatter: Scatter) -> None:
    """Refuses a number of equal injections, and a deviation without effect."""
    spray = scene.spray
    if not scatter.traced and spray.model != "lagrangian":
        raise SceneError(
            f"spray.scatter.members: {scatter.members} injections without a difference; give "
            "spray.scatter.start_s, mass, .. as well"
        )
    if scatter.duration_s > 0.0 and spray.model == "lagrangian" and spray.rate:
        raise SceneError(
            "spray.scatter.duration_s: has no effect, since spray.rate has the times; allowed: 0"
        )
