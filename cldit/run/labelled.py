"""A run's images as one labelled data set: coordinates in mm, units, CF names."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.error_maps import TOTAL
from cldit.dit.maps import UNITS, Maps, Reason
from cldit.io.presented import xarray_module
from cldit.radiance.weights import EMITTED, Weights
from cldit.scene import Scene

if TYPE_CHECKING:
    import xarray

AXES = {
    "x": {"units": "mm", "long_name": "across"},
    "z": {"units": "mm", "long_name": "above the tip"},
}
"""Attributes of the coordinates of every labelled image: distances from the injector's tip."""
_LONG = {
    "emissivity": "emissivity of the spray, 1 minus the background's share",
    "apparent_temperature_K": "temperature of a black body that radiates as the spray does",
    "reason": "why a pixel has no value",
    "reduced_chi2": "of the lines over the backgrounds",
    "fit_probability": "that chance alone makes the residuals as large",
    "error_correlation": "of the errors of emissivity and apparent temperature",
}
_STANDARD = {
    "apparent_temperature_K": "brightness_temperature",
    "apparent_temperature_standard_error_K": "brightness_temperature standard_error",
    "reason": "brightness_temperature status_flag",
}
_ERROR_OF = {
    "emissivity": "emissivity_standard_error",
    "apparent_temperature_K": "apparent_temperature_standard_error_K",
}


def labelled(
    scene: Scene,
    maps: Maps,
    *,
    pixel_m: tuple[float, float],
    weights: Weights | None = None,
    error_maps: Mapping[str, NDArray[np.float32]] | None = None,
    emissivity_error_maps: Mapping[str, NDArray[np.float32]] | None = None,
    extra_variables: Mapping[str, tuple[Any, str, str]] | None = None,
    attrs: Mapping[str, str] | None = None,
) -> "xarray.Dataset":
    """Maps, and weights where they are given, over x and z of the plane of the target.

    Args:
        maps: (H, W) on the traced or the sensor's pixels.
        pixel_m: width and height of their pixels in the plane of the target.
        weights: (H, W) of the trace; None omits them.
        error_maps: (H, W) standard error of the simulation's T_app by source, and `total`.
        emissivity_error_maps: likewise of its emissivity.
        extra_variables: as in `labelled_maps`.
        attrs: of the data set, in addition to the scene.

    Returns:
        As `labelled_maps`; raises as it.
    """
    variables: dict[str, Any] = dict(extra_variables or {})
    if weights is not None:
        for name, image in weights.images.items():
            unit = "photons s-1 m-2 sr-1" if name in EMITTED else "1"
            variables[f"weight_{name}"] = (image, unit, f"weight of {name}")
    results = (
        ("simulation_error{}_K", "K", "T_app", error_maps),
        ("emissivity_simulation_error{}", "1", "emissivity", emissivity_error_maps),
    )
    for variable, unit, result, maps_of in results:
        for name, image in (maps_of or {}).items():
            cause = "all sources together" if name == TOTAL else name
            of = "" if name == TOTAL else f"_{name.replace(' ', '_')}"
            about = f"standard error of the simulated {result} by {cause}"
            variables[variable.format(of)] = (image, unit, about)
    target = scene.target_m
    return labelled_maps(
        maps,
        title=scene.name,
        pixel_m=pixel_m,
        centre_m=(target[0], target[2]),
        extra_variables=variables,
        attrs={"scene": json.dumps(scene.model_dump(mode="json")), **(attrs or {})},
    )


def labelled_maps(
    maps: Maps,
    *,
    title: str,
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    extra_variables: Mapping[str, tuple[Any, str, str]] | None = None,
    attrs: Mapping[str, str] | None = None,
) -> "xarray.Dataset":
    """Maps (H, W) over x and z.

    Args:
        pixel_m: width and height of a pixel on the object.
        centre_m: x and z of the image's centre.
        extra_variables: further variables by name: (H, W), unit, and description.
        attrs: of the data set, in addition to title and conventions.

    Returns:
        Variables named like the maps' files, dimensions z (downwards) and x in mm.
    """
    xr = xarray_module()
    coords = image_axes(maps.emissivity.shape, pixel_m=pixel_m, centre_m=centre_m)
    error_names = [name for name in extra_variables or {} if "error" in name]
    variables: dict[str, Any] = {
        name: (("z", "x"), getattr(maps, name), _attributes(name, error_names)) for name in UNITS
    }
    depth = {"units": "1", "long_name": "optical depth of the line of sight, -ln(1 - emissivity)"}
    variables["optical_depth"] = (("z", "x"), maps.optical_depth, depth)
    for name, (image, unit, about) in (extra_variables or {}).items():
        variables[name] = (("z", "x"), image, {"units": unit, "long_name": about})
    attributes = {"Conventions": "CF-1.11", "title": f"cldit: {title}", **(attrs or {})}
    return xr.Dataset(variables, coords, attributes)  # type: ignore[no-any-return]


def image_axes(
    shape: tuple[int, ...], *, pixel_m: tuple[float, float], centre_m: tuple[float, float]
) -> dict[str, tuple[str, NDArray[np.floating], Mapping[str, str]]]:
    """Coordinates x and z (downwards) of images (H, W) for xarray, in mm."""
    height, width = shape
    middle_x, middle_z = (1e3 * length_m for length_m in centre_m)
    across, up = (1e3 * length_m for length_m in pixel_m)
    x = middle_x + (np.arange(width) - (width - 1) / 2) * across
    z = middle_z - (np.arange(height) - (height - 1) / 2) * up
    return {name: (name, places, AXES[name]) for name, places in (("x", x), ("z", z))}


def _attributes(name: str, error_names: Sequence[str]) -> Mapping[str, Any]:
    """CF attributes of a map.

    error_names: further errors, which belong to the temperature or the emissivity.
    """
    attributes: dict[str, Any] = {}
    if name == "reason":
        attributes["flag_values"] = np.array([int(reason) for reason in Reason], np.uint8)
        attributes["flag_meanings"] = " ".join(reason.name.lower() for reason in Reason)
    else:
        attributes["units"] = UNITS[name]
    for value, error in _ERROR_OF.items():
        if name == value:
            of = ("emissivity",) if value == "emissivity" else ("apparent_temp", "simulation")
            terms = [term for term in error_names if term.startswith(of)]
            attributes["ancillary_variables"] = " ".join([error, "reason", *terms])
        if name == error:
            attributes["long_name"] = f"standard error of the {value.removesuffix('_K')}".replace(
                "_", " "
            )
    if name in _LONG:
        attributes["long_name"] = _LONG[name]
    if name in _STANDARD:
        attributes["standard_name"] = _STANDARD[name]
    return attributes
