"""A scene that fits a CFD case, as YAML with the reason beside each length and temperature."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.io.plain_data import yaml_line
from cldit.prepare.case_fit import Fuel
from cldit.scene.camera import Camera, Sensor
from cldit.scene.spray import CfdSpray
from cldit.scene.vessel import FINEST
from cldit.spray.result import Spray

_ROOM = 1.15  # of the field and the cube, over what they must contain
_BACKGROUNDS = 6  # temperatures of the black body that are suggested
_SPAN_K = 100.0  # from the coldest background to the hottest, at least
_COLDEST_K = 300.0  # black bodies are heated
_PIXELS = 1000  # along the field's longer side
_OTHER_FUEL = ["optics:", "  preset: spectral  # the constants of `paper` are those of n-heptane"]


def fitted_scene(spec: CfdSpray, spray: Spray, *, name: str) -> str:
    """YAML of a scene called `name` for the spray of a case; `cldit.load_scene` reads it."""
    fuel = Fuel.of(spray)
    low, high = fuel.extent_m()
    high[2], low[2] = max(high[2], 0.0), min(low[2], 0.0)  # with the nozzle
    time = spray.notes.get("time_s")
    at = "" if time is None else f" at {_time(time)}"
    size = f"{1e3 * (high[0] - low[0]):.3g} mm wide and {1e3 * (high[2] - low[2]):.3g} mm long"
    edge_m, centre_m = _cube(spray)
    target_m = (0.0, 0.0, _round(0.5 * (low[2] + high[2]), 1e-4))
    field_m, sensor = _field(low, high, target_m)
    columns, rows = (round(_PIXELS * side / max(field_m)) for side in field_m)
    lines = [
        f"# A scene that fits {spec.file}{at}, to edit.",
        f"# The spray is {size}, but for 0.1 % of the fuel at either end.",
        *_section({"name": name, "description": f"the spray of {spec.file.name}{at}"}, {}),
        *_spray(spec, spray, time),
        "domain:",
        *_section(
            {"edge_m": edge_m, "centre_m": list(centre_m)},
            {"edge_m": "all droplets and all cells with vapour are in this cube"},
            indent="  ",
        ),
        *_leaf(spray, edge_m),
        "camera:",
        *_section(
            {"field_m": field_m, "target_m": list(target_m), "pixels": [columns, rows]},
            {
                "field_m": f"the spray and {100 * (_ROOM - 1):.0f} % of room, in the shape of the "
                "sensor",
                "target_m": "the middle of spray and nozzle",
                "pixels": f"of {1e6 * field_m[0] / columns:.2g} um, as wide as high",
            },
            indent="  ",
        ),
        *sensor,
        "background:",
        *_background(spray, edge_m, centre_m, target_m, field_m),
        *_walls(spray),
        *([] if spray.fuel == "n-heptane" else _OTHER_FUEL),
    ]
    return "\n".join(lines) + "\n"


def _section(values: dict[str, Any], comments: dict[str, str], *, indent: str = "") -> list[str]:
    """Lines of keys with their comments."""
    lines = []
    for key, value in values.items():
        line = f"{indent}{yaml_line({key: value})[1:-1]}"
        lines.append(f"{line}  # {comments[key]}" if key in comments else line)
    return lines


def _spray(spec: CfdSpray, spray: Spray, time: float | None) -> list[str]:
    """The section `spray`: the keys that were given, and the nozzle and axis that were found."""
    section: dict[str, Any] = {"model": "cfd", "file": str(spec.file.resolve())}
    section |= spec.model_dump(mode="json", exclude_unset=True, exclude={"model", "file"})
    if spec.mapping is not None:
        section["mapping"] = str(spec.mapping.resolve())
    comments: dict[str, str] = {}
    imported = spec.file.suffix == ".npz"
    if time is not None and not imported:
        section["time_s"] = time
        comments["time_s"] = "`cldit run .. --times all` takes all"
    axes = [f"{vector}_{axis}" for vector in ("nozzle", "axis") for axis in "xyz"]
    keys = [f"{name}_m" if name.startswith("nozzle") else name for name in axes]
    if not imported and all(key in spray.notes for key in keys):
        place = [_clean(spray.notes[key]) for key in keys]
        for key, value, word in (
            ("nozzle_m", place[:3], "Nozzle"),
            ("axis", place[3:], "Injection axis"),
        ):
            section[key] = value
            remark = next((text for text in spray.remarks if text.startswith(word)), "as given")
            comments[key] = remark.rstrip(".")
    return ["spray:", *_section(section, comments, indent="  ")]


def _cube(spray: Spray) -> tuple[float, tuple[float, float, float]]:
    """Edge and centre of a cube around the nozzle and all contents of the octree."""
    low, high = np.zeros(3), np.zeros(3)
    if spray.parcels is not None:
        low = np.minimum(low, spray.parcels.position_m.min(axis=0))
        high = np.maximum(high, spray.parcels.position_m.max(axis=0))
    if spray.vapour is not None:
        low = np.minimum(low, spray.vapour.cells.lower_m.min(axis=0))
        high = np.maximum(high, spray.vapour.cells.upper_m.max(axis=0))
    middle = [_round(float(coordinate), 1e-4) for coordinate in 0.5 * (low + high)]
    return _up(_ROOM * float((high - low).max()), 1e-3), (middle[0], middle[1], middle[2])


def _field(low: Floats, high: Floats, target_m: Sequence[float]) -> tuple[list[float], list[str]]:
    """Width and height of the field, in the shape of the sensor, and the sensor's lines. The sensor
    is turned for a spray that is longer than wide."""
    half = [
        _ROOM * max(abs(side[axis] - target_m[axis]) for side in (low, high)) for axis in (0, 2)
    ]
    # what is nearer to the camera looks larger
    half = [extent / (1.0 + min(low[1], 0.0) / Camera().distance_m) for extent in half]
    pixels = sorted(Sensor().pixels, reverse=bool(half[0] >= half[1]))
    ratio = pixels[0] / pixels[1]
    height_m = _up(2.0 * max(half[1], half[0] / ratio), 1e-3)
    lines = ["  sensor:"]
    reason = "the camera is turned: the spray is longer than wide"
    if tuple(pixels) == Sensor().pixels:
        reason = "the spray is wider than long"
    lines += _section({"pixels": pixels}, {"pixels": reason}, indent="    ")
    return [round(height_m * ratio, 9), height_m], lines


def _leaf(spray: Spray, edge_m: float) -> list[str]:
    """The finest cells, as a comment: without them, the tolerance determines the cells."""
    if spray.vapour is None or not len(spray.vapour.temperature_K):
        return []
    own_m = float(np.median(np.cbrt(spray.vapour.cells.volume_m3)))
    leaf_m = float(f"{max(own_m / 2, edge_m / FINEST):.2g}")
    return [
        f"  # leaf_edge_m: {leaf_m}  # half of the case's own cells in the spray, "
        f"{1e3 * own_m:.2g} mm; without it,",
        "  # cells are as fine as transport.accuracy_K needs",
    ]


def _background(
    spray: Spray,
    edge_m: float,
    centre_m: Sequence[float],
    target_m: Sequence[float],
    field_m: Sequence[float],
) -> list[str]:
    """The disc behind the whole field, at temperatures around those of the spray."""
    behind_m = centre_m[1] + edge_m / 2 - target_m[1]
    seen = 1.0 + behind_m / Camera().distance_m  # the field is larger there
    aside_m = math.dist((centre_m[0], centre_m[2]), (target_m[0], target_m[2]))
    radius_m = _up(1.02 * (0.5 * math.hypot(*field_m) * seen + aside_m), 1e-3)
    coldest_K, phase = _coldest(spray)
    hottest_K = spray.notes.get("ambient_temperature_K", coldest_K)
    low_K = max(10.0 * math.floor(coldest_K / 10.0 + 1e-6), _COLDEST_K)
    high_K = max(10.0 * math.ceil(hottest_K / 10.0 - 1e-6), low_K + _SPAN_K)
    temperatures = np.round(np.linspace(low_K, high_K, _BACKGROUNDS)).tolist()
    return _section(
        {"radius_m": radius_m, "temperatures_K": temperatures},
        {
            "radius_m": "fills the field",
            "temperatures_K": f"from {phase}, {coldest_K:.0f} K, to the gas outside the jet, "
            f"{hottest_K:.0f} K; set what your black body reaches",
        },
        indent="  ",
    )


def _coldest(spray: Spray) -> tuple[float, str]:
    """The mean temperature of the liquid, or else of the vapour, and its name."""
    parcels, vapour = spray.parcels, spray.vapour
    if parcels is not None and parcels.mass_kg > 0.0:
        return float(np.average(parcels.temperature_K, weights=parcels.masses_kg)), "the droplets"
    assert vapour is not None
    return float(np.average(vapour.temperature_K, weights=vapour.masses_kg)), "the vapour"


def _walls(spray: Spray) -> list[str]:
    """The walls at the temperature of the case, or at that of its gas."""
    if "wall_temperature_K" in spray.notes:
        wall_K, reason = spray.notes["wall_temperature_K"], "the case holds its walls at this"
    elif "ambient_temperature_K" in spray.notes:
        wall_K = spray.notes["ambient_temperature_K"]
        reason = "the gas outside the jet: the case holds its walls at no temperature; set your own"
    else:
        return []  # made by an older version, which did not keep it
    return [
        "walls:",
        *_section({"temperature_K": round(wall_K, 1)}, {"temperature_K": reason}, indent="  "),
    ]


def _time(time: float) -> str:
    return f"{1e3 * time:.6g} ms" if abs(time) < 1.0 else f"{time:.6g}"


def _clean(value: float) -> float:
    """Removes the noise of the last digits, and a negative zero."""
    return float(f"{value:.9g}") + 0.0


def _round(value: float, step: float) -> float:
    return _clean(round(value / step) * step)


def _up(value: float, step: float) -> float:
    return _clean(math.ceil(value / step - 1e-9) * step)
