"""The content that a trace depends on: scenes with the same content share one trace."""

from pathlib import Path
from typing import Any

from cldit.io.content import code_digest, digest, file_content
from cldit.scene import Scene
from cldit.scene.scatter import members_of

# Sources, and keys that only evaluation and rig use. All others count, so that a new key of the
# scene makes a new trace until it is named here.
_LEFT_OUT = (
    "name",
    "description",
    "walls.temperature_K",
    "background.temperatures_K",
    "background.emissivity",
    "background.surroundings_K",
    "camera.surroundings_K",
    "rig",
    "plan",
    "optics.compare_paper",
)
_TRACED_BY = (
    "spray",
    "cfd",
    "medium",
    "optics",
    "transport",
    "radiance",
    "kernels",
    "prepare",
    "accuracy",
    "run",
)


def trace_content(scene: Scene) -> dict[str, Any]:
    """The part of a scene, as plain data, that its trace depends on.

    The temperatures of backgrounds and walls count if wavelengths are chosen for their light, and
    for `path`, which stops at an error in T_app.
    """
    data = scene.model_dump(mode="json")
    # A tabulated efficiency is part of the response in which vapour and droplets emit.
    sensor_keys = ["quantum_efficiency"]
    sensor_keys += [] if scene.camera.lens is None else ["pixels", "pitch_m", "f_number"]
    sensor_keys += [] if scene.camera.exposure == "instant" else ["integration_time_s"]
    sensor = data["camera"]["sensor"]
    data["camera"]["sensor"] = {key: sensor[key] for key in sensor_keys}
    scatter = data["spray"].pop("scatter")
    if members_of(scene) > 1:
        del scatter["optical_depth"], scatter["length_m"]
        data["spray"]["scatter"] = scatter
    bound = scene.optics.preset == "spectral" or scene.transport.method != "source"
    if not bound:
        for patch in data["patches"]:
            del patch["temperature_K"], patch["emissivity"]
    for name in _LEFT_OUT:
        if not (bound and name.endswith(("walls.temperature_K", "temperatures_K"))):
            section, _, key = name.partition(".")
            (data[section] if key else data).pop(key or section)
    return data


def named_files(scene: Scene) -> list[Path]:
    """Files and folders that a scene names: of its spray, and tables of its substances."""
    paths = [getattr(scene.spray, key, None) for key in ("file", "mapping")]
    substances = [scene.optics.liquid, scene.optics.vapour]
    paths += [
        substance for substance in substances if substance is not None and Path(substance).suffix
    ]  # tables
    return [Path(path) for path in paths if path is not None]


def trace_key(scene: Scene) -> str:
    """Digest of `trace_content`, of the files that the scene names, and of the code."""
    files = file_content(named_files(scene))
    return digest(trace_content(scene), files, code_digest(*_TRACED_BY))
