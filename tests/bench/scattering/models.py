"""Models of a spray that are wrong in a quantity that is unknown for a real one."""

from __future__ import annotations

from cldit.errors import EvaluationError
from cldit.scene import Scene

RIGHT = "right"
LARGER = "droplets 20 % larger"


def wrong_models(scene: Scene) -> dict[str, Scene]:
    """The scene and wrong models of it.

    Raises:
        EvaluationError: the scene's spray has no droplet sizes, mass and plumes to change.
    """
    spray = scene.model_dump(mode="json")["spray"]
    if not {"droplets", "injected_mass_kg", "plumes"} <= set(spray) or "m_um" not in (
        spray["droplets"] or {}
    ):
        raise EvaluationError(
            f"spray.model: {spray['model']}; allowed: one with plumes, mass and a "
            "Nukiyama-Tanasawa distribution, as gdi has"
        )
    size_um, mass_kg = spray["droplets"]["m_um"], spray["injected_mass_kg"]
    changes: dict[str, dict[str, float]] = {
        RIGHT: {},
        LARGER: {"spray.droplets.m_um": 1.2 * size_um},
        "droplets 20 % smaller": {"spray.droplets.m_um": 0.8 * size_um},
        "20 % more fuel": {"spray.injected_mass_kg": 1.2 * mass_kg},
        "20 % less fuel": {"spray.injected_mass_kg": 0.8 * mass_kg},
        "plumes 2 deg wider": {
            f"spray.plumes[{number}].inclination_deg": plume["inclination_deg"] + 2.0
            for number, plume in enumerate(spray["plumes"])
        },
        "k 30 % larger": {"optics.k": 1.3 * scene.optics.k},
    }
    return {name: scene.with_(**each) for name, each in changes.items()}
