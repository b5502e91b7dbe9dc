"""Delays of pictures after the start of injection, and the scene at such a delay."""

from __future__ import annotations

from cldit.errors import SceneError
from cldit.scene.schema import Scene

SAME_s = 1e-6
"""Delays closer than this are one."""


def delay_text(delay_s: float) -> str:
    """A delay as people and folders name it: `0.95 ms`."""
    return f"{1e3 * delay_s:.9g} ms"


def delay_folder(delay_s: float) -> str:
    """Name of the folder of what belongs to one of several delays: `delay_0.95ms`."""
    return f"delay_{delay_text(delay_s).replace(' ', '')}"


def spray_time_s(scene: Scene) -> float | None:
    """The time after the start of injection that a scene's spray shows; None where it has none."""
    time_s: float | None = getattr(scene.spray, "time_s", None)
    return time_s


def scene_at(scene: Scene, delay_s: float) -> Scene:
    """The scene with its spray as it is at `delay_s`; a CFD case's clock starts with injection.

    Raises:
        SceneError: the spray's model has one time only.
    """
    if "time_s" not in type(scene.spray).model_fields:
        raise SceneError(
            f"plan.delays_s: spray.model {scene.spray.model} has one time only; allowed are cone, "
            "lagrangian and cfd, or no delays_s"
        )
    spray = scene.spray.model_copy(update={"time_s": delay_s})
    return scene.model_copy(update={"spray": spray})


def alone(scene: Scene) -> Scene:
    """A scene at its spray's own time, without the plan's delays."""
    return scene.model_copy(update={"plan": scene.plan.model_copy(update={"delays_s": ()})})
