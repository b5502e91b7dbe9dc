"""Result of every spray model: parcels of droplets, and gas in cells.

Positions are in the project's frame: injector tip at the origin, injector axis -z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.constants import AVOGADRO_PER_MOL
from cldit.errors import SprayError
from cldit.io.origin import FileRead
from cldit.io.presented import Presented, xarray_module
from cldit.spray.extent import Box, Cloud, Extent

if TYPE_CHECKING:
    import xarray


# Root of g^4 = g + 1: the generalised golden ratio of three dimensions (Roberts, 2018).
PLASTIC = 1.2207440846057596
Limits = Mapping[str, tuple[float, float]]
_KELVIN, _PER_METRE = (0.0, 5000.0), (0.0, 1e12)
PARCEL_LIMITS: Limits = {
    "diameter_m": (1e-9, 1e-2),
    "droplets": (0.0, 1e18),
    "temperature_K": _KELVIN,
    "density_kg_m3": (1.0, 1e5),
}
_VAPOUR_LIMITS: Limits = {"number_density_m3": (0.0, 1e32), "temperature_K": _KELVIN}
PRESCRIBED_LIMITS: Limits = {
    "vapour_absorption_per_m": _PER_METRE,
    "droplet_absorption_per_m": _PER_METRE,
    "droplet_scattering_per_m": _PER_METRE,
    "vapour_temperature_K": _KELVIN,
    "droplet_temperature_K": _KELVIN,
}


def _checked(label: str, values: Floats, *, low: float, high: float) -> None:
    if not values.size or low <= values.min() <= values.max() <= high:
        return  # comparisons are false for NaN
    if not np.all(np.isfinite(values)):
        bad = int(np.flatnonzero(~np.isfinite(values).reshape(values.shape[0], -1).all(axis=1))[0])
        raise SprayError(f"{label}: entry {bad} is not finite")
    bad = int(np.argmax((values < low) | (values > high)))
    raise SprayError(
        f"{label}: {values.reshape(-1)[bad]:g} (entry {bad}) is outside {low:g}..{high:g}"
    )


def _check_columns(data: object, label: str, count: int, limits: Limits) -> None:
    """Checks that the columns named in `limits` are (count,) and within their limits."""
    for name, (low, high) in limits.items():
        values = getattr(data, name)
        if values.shape != (count,):
            raise SprayError(f"{label}{name}: shape {values.shape}, expected ({count},)")
        _checked(f"{label}{name}", values, low=low, high=high)


@dataclass(frozen=True)
class Parcels:
    """Parcels of equal droplets.

    position_m (N, 3); diameter_m, droplets (number of real droplets in the parcel), temperature_K
    and density_kg_m3 (N,). extent: distribution of the droplets about the position; None: a point.
    velocity_m_s: (N, 3); None: unknown.
    """

    position_m: Floats
    diameter_m: Floats
    droplets: Floats
    temperature_K: Floats
    density_kg_m3: Floats
    extent: Extent | None = None
    velocity_m_s: Floats | None = None

    def __post_init__(self) -> None:
        count = len(self.position_m)
        if isinstance(self.extent, Cloud) and len(self.extent.covariance_m2) != count:
            raise SprayError(
                f"parcels.extent: {len(self.extent.covariance_m2)} clouds for {count} parcels"
            )
        if self.position_m.shape != (count, 3):
            raise SprayError(f"parcels.position_m: shape {self.position_m.shape}, expected (N, 3)")
        _checked("parcels.position_m", self.position_m, low=-1e3, high=1e3)
        if self.velocity_m_s is not None:
            if self.velocity_m_s.shape != (count, 3):
                shape = self.velocity_m_s.shape
                raise SprayError(f"parcels.velocity_m_s: shape {shape}, expected ({count}, 3)")
            _checked("parcels.velocity_m_s", self.velocity_m_s, low=-1e4, high=1e4)
        _check_columns(self, "parcels.", count, PARCEL_LIMITS)

    @property
    def masses_kg(self) -> Floats:
        """Liquid mass of each parcel (N,), n rho pi d^3 / 6."""
        mass = self.droplets * self.density_kg_m3
        for _ in range(3):  # a power takes ten times as long
            mass *= self.diameter_m
        mass *= np.pi / 6
        return np.asarray(mass)

    @property
    def mass_kg(self) -> float:
        """Liquid mass of all parcels."""
        return float(np.sum(self.masses_kg))

    @property
    def sauter_mean_diameter_m(self) -> float:
        """Sauter mean diameter D32 = sum n d^3 / sum n d^2; NaN without droplets."""
        areas = self.diameter_m**2
        areas *= self.droplets
        area = float(np.sum(areas))
        areas *= self.diameter_m
        return float(np.sum(areas)) / area if area > 0 else np.nan

    @property
    def sampled(self) -> bool:
        """True if the parcels are a sample of the droplets, and not the field itself."""
        return not isinstance(self.extent, Box)

    def take(self, chosen: Mask) -> Parcels:
        """Some of the parcels, chosen (N,)."""
        columns = {name: getattr(self, name)[chosen] for name in ("position_m", *PARCEL_LIMITS)}
        return Parcels(
            **columns,
            extent=None if self.extent is None else self.extent.of(chosen),
            velocity_m_s=None if self.velocity_m_s is None else self.velocity_m_s[chosen],
        )

    def points_m(self) -> Floats:
        """Points (N, 3) at which to draw the parcels; those that share a box fill it uniformly.

        Points in a box are those of a Kronecker sequence with the plastic number, so that the same
        parcels are always drawn at the same points.
        """
        if not isinstance(self.extent, Box):
            return self.position_m
        steps = PLASTIC ** -np.arange(1.0, 4.0)
        place = (0.5 + np.arange(len(self.position_m))[:, None] * steps) % 1.0
        return np.asarray(self.position_m + (place - 0.5) * self.extent.edge_m)


@dataclass(frozen=True)
class Cells:
    """Axis-aligned boxes, lower_m and upper_m (N, 3), that contain the gas.

    `volume_m3` (N,) is the volume of a cell; a cell that is not a box is represented by a box of
    the same volume and centroid.
    """

    lower_m: Floats
    upper_m: Floats

    def __post_init__(self) -> None:
        if self.lower_m.shape != self.upper_m.shape or self.lower_m.shape[1:] != (3,):
            raise SprayError(
                f"cells: corners of shape {self.lower_m.shape} and {self.upper_m.shape}, "
                "expected (N, 3)"
            )
        _checked("cells.lower_m", self.lower_m, low=-1e3, high=1e3)
        _checked("cells.upper_m", self.upper_m, low=-1e3, high=1e3)
        if np.any(self.upper_m <= self.lower_m):
            bad = int(np.argmax(np.any(self.upper_m <= self.lower_m, axis=1)))
            raise SprayError(f"cells: cell {bad} has no volume")

    @classmethod
    def regular(
        cls,
        *,
        origin_m: Floats,
        spacing_m: Floats,
        shape: tuple[int, int, int],
        index: Ints | None = None,
    ) -> Cells:
        """Voxels of a regular grid.

        Args:
            origin_m, spacing_m: (3,) lower corner of the grid, and size of a voxel.
            shape: number of voxels along x, y, z.
            index: (N,) flat indices of the voxels, in C order; None: all.
        """
        if index is None:
            index = np.arange(np.prod(shape), dtype=np.int64)
        corner = np.stack(np.unravel_index(index, shape), axis=1).astype(np.float64)
        # Both faces from the same product, so that those of neighbours are bit-identical.
        lower = origin_m + corner * spacing_m
        return cls(lower, origin_m + (corner + 1.0) * spacing_m)

    @property
    def volume_m3(self) -> Floats:
        """Volumes (N,)."""
        return np.asarray(np.prod(self.upper_m - self.lower_m, axis=1))


@dataclass(frozen=True)
class Vapour:
    """Fuel vapour in cells: number_density_m3 (molecules per m3) and temperature_K, both (N,)."""

    cells: Cells
    number_density_m3: Floats
    temperature_K: Floats
    molar_mass_kg_mol: float

    def __post_init__(self) -> None:
        _check_columns(self, "vapour.", len(self.cells.lower_m), _VAPOUR_LIMITS)

    @property
    def masses_kg(self) -> Floats:
        """Mass of the vapour in each cell (N,)."""
        molecule_kg = self.molar_mass_kg_mol / AVOGADRO_PER_MOL
        return np.asarray(self.number_density_m3 * self.cells.volume_m3 * molecule_kg)

    @property
    def mass_kg(self) -> float:
        """Mass of all vapour."""
        molecule_kg = self.molar_mass_kg_mol / AVOGADRO_PER_MOL
        return float(np.sum(self.number_density_m3 * self.cells.volume_m3) * molecule_kg)


@dataclass(frozen=True)
class Prescribed:
    """Optical coefficients of cells, per metre; all arrays (N,)."""

    cells: Cells
    vapour_absorption_per_m: Floats
    droplet_absorption_per_m: Floats
    droplet_scattering_per_m: Floats
    vapour_temperature_K: Floats
    droplet_temperature_K: Floats

    def __post_init__(self) -> None:
        _check_columns(self, "", len(self.cells.lower_m), PRESCRIBED_LIMITS)


@dataclass(frozen=True)
class Spray(Presented):
    """Result of every spray model and importer; a part that it does not have is None.

    `notes` are figures for the report (name -> value in SI); `remarks` are sentences for the user,
    on assumptions that were necessary. `files`: those that the spray was read from. `fuel`: its
    name, if the source states it; "" leaves it to the scene.
    """

    parcels: Parcels | None = None
    vapour: Vapour | None = None
    prescribed: Prescribed | None = None
    notes: dict[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    files: tuple[FileRead, ...] = ()
    fuel: str = ""

    def __repr__(self) -> str:
        parts = []
        if self.parcels is not None:
            count = len(self.parcels.position_m)
            parts.append(f"{count} parcels of {1e6 * self.parcels.mass_kg:.4g} mg")
        if self.vapour is not None:
            cells = len(self.vapour.temperature_K)
            parts.append(f"{cells} cells with {1e6 * self.vapour.mass_kg:.4g} mg of vapour")
        if self.prescribed is not None:
            parts.append(f"coefficients in {len(self.prescribed.vapour_temperature_K)} cells")
        return f"<Spray: {'; '.join(parts) or 'nothing'}>"

    def to_xarray(self) -> xarray.Dataset:
        """Data set of parcels over `parcel` and gas over `cell`; `to_netcdf`, `to_zarr` write it.

        Raises:
            ClditError: xarray is not installed.
        """
        return _labelled(self)


_AXES = "xyz"


def _labelled(spray: Spray) -> xarray.Dataset:
    """Data set with variables such as parcel_diameter_m and vapour_temperature_K.

    Lengths are in mm, all else in SI units; `cell_x`, `cell_y` and `cell_z` are middles,
    `cell_width_x` and so on edges. Figures of the spray are attributes.
    """
    xr = xarray_module()
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    if (parcels := spray.parcels) is not None:
        _places(coords, "parcel", parcels.position_m)
        for name, unit in zip(PARCEL_LIMITS, ("m", "1", "K", "kg m-3"), strict=True):
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
        for name in PRESCRIBED_LIMITS:
            phase, quantity = name.split("_")[:2]
            kelvin, per_m = _units(f"temperature of the {phase}", "K"), f"{phase}: {quantity}"
            about = kelvin if quantity == "temperature" else _units(per_m, "m-1")
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
