"""Models of a spray that are wrong in a quantity that is unknown for a real one."""

from __future__ import annotations

from typing import Any

from cldit.errors import EvaluationError
from cldit.scene import Scene, parse_scene

RIGHT = "right"
LARGER = "droplets 20 % larger"


def wrong_models(scene: Scene) -> dict[str, Scene]:
    """The scene and wrong models of it.

    Raises:
        EvaluationError: the scene's spray has no droplet sizes, mass and plumes to change.
    """
    data = scene.model_dump(mode="json")
    spray = data["spray"]
    if not {"droplets", "injected_mass_kg", "plumes"} <= set(spray) or "m_um" not in (
        spray["droplets"] or {}
    ):
        raise EvaluationError(
            f"spray.model: {spray['model']}; allowed: one with plumes, mass and a "
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
        RIGHT: scene,
        LARGER: sprayed(droplets={**sizes, "m_um": 1.2 * sizes["m_um"]}),
        "droplets 20 % smaller": sprayed(droplets={**sizes, "m_um": 0.8 * sizes["m_um"]}),
        "20 % more fuel": sprayed(injected_mass_kg=1.2 * mass),
        "20 % less fuel": sprayed(injected_mass_kg=0.8 * mass),
        "plumes 2 deg wider": sprayed(plumes=wider),
        "k 30 % larger": changed(optics={**data["optics"], "k": 1.3 * data["optics"]["k"]}),
    }
