"""Conversion of a spray to a labelled data set: parcels, and the gas in its cells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cldit.arrays import Floats
from cldit.io.presented import xarray_module
from cldit.spray.result import Cells, Spray

if TYPE_CHECKING:
    import xarray

_AXES = "xyz"


def labelled_spray(spray: Spray) -> xarray.Dataset:
    """Data set of parcels over `parcel` and gas over `cell`; lengths in mm, all else in SI units.

    Variables are such as parcel_diameter_m and vapour_temperature_K; `cell_x`, `cell_y` and
    `cell_z` are middles, `cell_width_x` and so on edges. Figures of the spray are attributes.
    Raises ClditError if xarray is not installed.
    """
    xr = xarray_module()
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    if (parcels := spray.parcels) is not None:
        _places(coords, "parcel", parcels.position_m)
        for name, unit in (
            ("diameter_m", "m"),
            ("droplets", "1"),
            ("temperature_K", "K"),
            ("density_kg_m3", "kg m-3"),
        ):
            about = _units(f"{name.partition('_')[0]} of a parcel", unit)
            variables[f"parcel_{name}"] = ("parcel", getattr(parcels, name), about)
        if parcels.velocity_m_s is not None:
            for number, axis in enumerate(_AXES):
                about = _units(f"velocity of a parcel along {axis}", "m s-1")
                along = parcels.velocity_m_s[:, number]
                variables[f"parcel_velocity_{axis}"] = ("parcel", along, about)
    gas = spray.vapour or spray.prescribed
    if gas is not None:
        _boxes(coords, variables, gas.cells)
    if (vapour := spray.vapour) is not None:
        density = vapour.number_density_m3
        variables["vapour_number_density_m3"] = ("cell", density, _units("number density", "m-3"))
        warm = _units("temperature of the gas", "K") | {"standard_name": "air_temperature"}
        variables["vapour_temperature_K"] = ("cell", vapour.temperature_K, warm)
    if (prescribed := spray.prescribed) is not None:
        for name in ("vapour_absorption", "droplet_absorption", "droplet_scattering"):
            values = getattr(prescribed, f"{name}_per_m")
            variables[f"{name}_per_m"] = ("cell", values, _units(name.replace("_", ": "), "m-1"))
        for name in ("vapour_temperature_K", "droplet_temperature_K"):
            about = _units(f"temperature of the {name.partition('_')[0]}", "K")
            variables[name] = ("cell", getattr(prescribed, name), about)
    attrs: dict[str, Any] = {"Conventions": "CF-1.11", "title": "cldit: spray", **spray.notes}
    if spray.vapour is not None:
        attrs["vapour_molar_mass_kg_mol"] = spray.vapour.molar_mass_kg_mol
    if spray.remarks:
        attrs["remarks"] = "\n".join(spray.remarks)
    return xr.Dataset(variables, coords, attrs)  # type: ignore[no-any-return]


def _units(name: str, unit: str) -> dict[str, str]:
    return {"units": unit, "long_name": name}


def _places(coords: dict[str, Any], dimension: str, position_m: Floats) -> None:
    for number, axis in enumerate(_AXES):
        about = {"units": "mm", "long_name": f"{axis}, from the injector's tip"}
        coords[f"{dimension}_{axis}"] = (dimension, 1e3 * position_m[:, number], about)


def _boxes(coords: dict[str, Any], variables: dict[str, Any], cells: Cells) -> None:
    _places(coords, "cell", (cells.lower_m + cells.upper_m) / 2.0)
    for number, axis in enumerate(_AXES):
        edge = 1e3 * (cells.upper_m - cells.lower_m)[:, number]
        about = {"units": "mm", "long_name": f"edge of the cell along {axis}"}
        variables[f"cell_width_{axis}"] = ("cell", edge, about)
