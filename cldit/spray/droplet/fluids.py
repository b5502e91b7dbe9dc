"""Fuels and carrier gases as fast tables, built once and kept on disk."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cldit.errors import SprayError
from cldit.spray.droplet.curves import Curves, Floats, curves
from cldit.spray.droplet.substances import (
    Columns,
    fuel_columns,
    gas_columns,
)

_FORM = "fluid table 1"


@dataclass(frozen=True)
class Gas:
    """A carrier gas: ideal, with cp, conductivity, viscosity and enthalpy in `vapour`."""

    name: str
    molar_mass_kg_mol: float
    diffusion_volume: float
    critical_K: float
    critical_Pa: float
    vapour: Curves


@dataclass(frozen=True)
class Fuel(Gas):
    """A fuel: its dilute vapour, and its liquid at saturation.

    Between its grid points a table is within 1e-5 of what it was built from. `liquid` ends at
    0.98 of the critical temperature (530.4 K for n-heptane).
    """

    liquid: Curves

    @property
    def highest_Pa(self) -> float:
        """Up to here a droplet can boil within the table."""
        return float(np.exp(self.liquid.one("ln_psat", self.liquid.high_K)))

    def saturation_Pa(self, temperature_K: ArrayLike) -> Floats:
        return np.asarray(np.exp(self.liquid.one("ln_psat", temperature_K)))

    def boiling_K(self, pressure_Pa: ArrayLike) -> Floats:
        """Temperature at which the liquid boils, by bisection; within the table."""
        wanted = np.log(np.asarray(pressure_Pa, dtype=float))
        low = np.full(wanted.shape, self.liquid.low_K)
        high = np.full(wanted.shape, self.liquid.high_K)
        for _ in range(48):  # 500 K down to rounding
            middle = 0.5 * (low + high)
            above = self.liquid.one("ln_psat", middle) > wanted
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.asarray(0.5 * (low + high))

    def diameter_m(self, mass_kg: ArrayLike, temperature_K: ArrayLike) -> Floats:
        """Of a droplet."""
        volume = np.asarray(mass_kg) / self.liquid.one("density", temperature_K)
        return np.asarray(np.cbrt(6 / np.pi * volume))

    def mass_kg(self, diameter_m: ArrayLike, temperature_K: ArrayLike) -> Floats:
        """Of a droplet."""
        d = np.asarray(diameter_m, dtype=float)
        return np.asarray(np.pi / 6 * d**3 * self.liquid.one("density", temperature_K))


def diffusivity_m2_s(
    fuel: Fuel, gas: Gas, *, temperature_K: ArrayLike, pressure_Pa: ArrayLike
) -> Floats:
    """Fuller, Ensley and Giddings, J. Phys. Chem. 73, 3679 (1969), dilute binary mixture."""
    mass = 2e3 / (1 / fuel.molar_mass_kg_mol + 1 / gas.molar_mass_kg_mol)
    size = np.cbrt(fuel.diffusion_volume) + np.cbrt(gas.diffusion_volume)
    # The published 0.00143 is for cm2/s and bar.
    factor = 0.00143e-4 * 1e5 / (np.sqrt(mass) * size * size)
    t = np.asarray(temperature_K, dtype=float)
    return np.asarray(factor * t**1.75 / np.asarray(pressure_Pa))


def fuel_table(name: str, *, cache: Path | None) -> Fuel:
    """The fuel of this name: iso-octane, or a fluid of CoolProp made of C, H and O.

    Args:
        cache: folder in which tables are kept by content, made if need be; None keeps nothing.

    Raises:
        SprayError: the fuel is not known, or lacks what evaporation needs.
    """
    return _fuel(name, _kept(f"fuel {name.casefold()}", lambda: fuel_columns(name), cache))


def gas_table(name: str, *, cache: Path | None) -> Gas:
    """The carrier gas of this name, one of `substances.GASES`; else as `fuel_table`."""
    columns = _kept(f"gas {name.casefold()}", lambda: gas_columns(name), cache)
    return Gas(name=name, **columns.constants, vapour=curves(columns.vapour_K, columns.vapour))


def _fuel(name: str, columns: Columns) -> Fuel:
    return Fuel(
        name=name,
        **columns.constants,
        vapour=curves(columns.vapour_K, columns.vapour),
        liquid=curves(columns.liquid_K, columns.liquid),
    )


def check_conditions(fuel: Fuel, *, temperature_K: float, gas_K: float, pressure_Pa: float) -> None:
    """Raises SprayError unless a droplet and its gas are within the table."""
    low, high = fuel.liquid.low_K, fuel.liquid.high_K
    if not low <= temperature_K <= high:
        above = "supercritical or close to it" if temperature_K > high else "frozen"
        raise SprayError(
            f"droplet temperature {temperature_K:g} K: {fuel.name} would be {above}; allowed are "
            f"{low:.0f} to {high:.1f} K"
        )
    if not 100.0 <= gas_K <= fuel.vapour.high_K:
        raise SprayError(
            f"gas temperature {gas_K:g} K: allowed are 100 to {fuel.vapour.high_K:.0f} K"
        )
    if not 1e3 <= pressure_Pa <= fuel.highest_Pa:
        raise SprayError(
            f"pressure {pressure_Pa:g} Pa: allowed are 1 kPa to {fuel.highest_Pa / 1e6:.3f} MPa, "
            f"below the critical pressure of {fuel.name}, {fuel.critical_Pa / 1e6:.2f} MPa"
        )


def _kept(text: str, build: Callable[[], Columns], cache: Path | None) -> Columns:
    if cache is None:
        return build()
    text = f"{_FORM} {version('CoolProp')} {text}"
    path = Path(cache) / f"fluid-{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"
    found = _read(path, text)
    if found is None:
        found = build()
        _write(path, text, found)
    return found


def _read(path: Path, text: str) -> Columns | None:
    """What `_write` kept; None where there is nothing, or nothing that can be trusted."""
    groups: dict[str, dict[str, Floats]] = {"constants": {}, "liquid": {}, "vapour": {}}
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            if str(file["text"]) != text:
                return None
            for key in file.files:
                group, _, name = key.partition(".")
                if name:
                    groups[group][name] = np.asarray(file[key], dtype=float)
            grids = np.asarray(file["liquid_K"]), np.asarray(file["vapour_K"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    values = [v for group in groups.values() for v in group.values()]
    if not all(np.all(np.isfinite(v)) for v in values):
        return None
    constants = {name: float(value) for name, value in groups["constants"].items()}
    return Columns(constants, grids[0], groups["liquid"], grids[1], groups["vapour"])


def _write(path: Path, text: str, columns: Columns) -> None:
    """Appears whole or not at all; a folder that cannot be written costs only the time."""
    arrays: dict[str, Floats] = {"liquid_K": columns.liquid_K, "vapour_K": columns.vapour_K}
    arrays |= {f"constants.{name}": np.asarray(v) for name, v in columns.constants.items()}
    for group, values in (("liquid", columns.liquid), ("vapour", columns.vapour)):
        arrays |= {f"{group}.{name}": value for name, value in values.items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, suffix=".part")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, text=np.asarray(text), **arrays)  # type: ignore[arg-type]
        os.replace(part, path)
    except OSError:
        Path(part).unlink(missing_ok=True)
