"""The rig file of a simulated rig in front of a traced run."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cldit.camera.view import SensorView
from cldit.scene.schema import Scene


def simulated_rig_data(
    scene: Scene,
    run_folder: Path,
    *,
    further_runs: Sequence[Path] = (),
    filters: Mapping[str, Sequence[Path]] | None = None,
) -> dict[str, Any]:
    """Content of the rig file for a traced run.

    The black body accepts all temperatures of the scene, even those that a real one does not.
    `run_folder` has scene.yaml, weights/ and weights_reference/; `further_runs` are of the same
    scene at other times, `filters` those behind each filter of a wheel. A sequence takes no time.
    """
    temperatures_K = scene.background.temperatures_K
    behind = {name: [str(run.resolve()) for run in runs] for name, runs in (filters or {}).items()}
    return {
        "name": f"simulated rig before {scene.name}",
        "clock": {"model": "simulated"},
        "seed": scene.rig.seed,
        "setup": {
            "background_emissivity": scene.background.emissivity,
            "wall_temperature_K": scene.walls.temperature_K,
            "background_surroundings_K": scene.background.surroundings_K,
            "camera_surroundings_K": scene.camera.surroundings_K,
            "windows": [window.model_dump(mode="json") for window in scene.windows],
            "centre_m": [scene.target_m[0], scene.target_m[2]],
            "pixel_m": [float(size) for size in SensorView.from_scene(scene).pixel_m],
        },
        "bench": {
            "driver": "simulated_scene",
            "settings": {
                "run": str(Path(run_folder).resolve()),
                **({"runs": [str(run.resolve()) for run in further_runs]} if further_runs else {}),
                **({"filters": behind} if filters else {}),
            },
        },
        "camera": {"driver": "simulated_camera", "settings": {}},
        **({"filter_wheel": {"driver": "simulated_filter_wheel"}} if filters else {}),
        "background": {
            "driver": "simulated_blackbody",
            "settings": {
                "time_constant_s": scene.rig.background_time_constant_s,
                "start_K": scene.rig.background_start_K,
                "limits_K": [min(253.0, *temperatures_K), max(873.0, *temperatures_K)],
            },
        },
        "trigger": {"driver": "simulated_injector", "settings": {}},
    }
