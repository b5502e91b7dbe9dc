"""Delays of recordings after the start of injection, and the scene at a delay."""

from cldit.errors import SceneError
from cldit.scene.schema import Scene

SAME_s = 1e-6  # delays that differ by less are equal


def same_time(time_s: float | None, delay_s: float | None) -> bool:
    """True if both times are known and equal."""
    return time_s is not None and delay_s is not None and abs(time_s - delay_s) < SAME_s


def delay_text(delay_s: float) -> str:
    """Text of a delay: `0.95 ms`."""
    return f"{1e3 * delay_s:.9g} ms"


def delay_folder(delay_s: float) -> str:
    """Folder name of one of several delays: `delay_0.95ms`."""
    return f"delay_{delay_text(delay_s).replace(' ', '')}"


def spray_time_s(scene: Scene) -> float | None:
    """Time of the spray after the start of injection; None for models without time."""
    time_s: float | None = getattr(scene.spray, "time_s", None)
    return time_s


def scene_at(scene: Scene, delay_s: float) -> Scene:
    """The scene with its spray at `delay_s`; time of a CFD case starts with injection."""
    if "time_s" not in type(scene.spray).model_fields:
        raise SceneError(
            f"plan.delays_s: spray.model {scene.spray.model} has no time; allowed: cone, "
            "lagrangian and cfd, or no delays_s"
        )
    spray = scene.spray.model_copy(update={"time_s": delay_s})
    return scene.model_copy(update={"spray": spray})


def without_delays(scene: Scene) -> Scene:
    """The scene without the plan's delays."""
    return scene.model_copy(update={"plan": scene.plan.model_copy(update={"delays_s": ()})})
