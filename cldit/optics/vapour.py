"""Absorption of fuel vapour around the C-H stretching band, 3 to 3.9 um.

The lines of n-heptane overlap. RadCal fits each 25 1/cm with a Malkmus fine structure of 0.3 to 0.9
at 1 atm in the strong part, proportional to the pressure. At the 0.6 MPa of a spray an optical
depth of 1 then acts as 0.9, mostly due to the shape of the band within 25 1/cm, which the table
here resolves. The spectrum is therefore smooth, without fine structure.

Methane has separate lines, so Beer-Lambert does not apply to their mean. RadCal (Grosshandler 1993)
models each 25 1/cm by Elsasser's band, equal Lorentz lines of half width g at spacing d (Phys. Rev.
54, 126 (1938)):

    k(z) = S sinh(2 pi y) / (cosh(2 pi y) - cos(2 pi z)),   y = g / d,  0 <= z <= 1

with the mean S. With tan(pi z) = T tan(u), T = tanh(pi y), this is k = S (cos^2 u / T + T sin^2 u)
with dz = S / k du / pi: periodic and analytic in u, so equal steps in u converge exponentially.
"""

import csv
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.arrays import Floats
from cldit.constants import STANDARD_ATMOSPHERE_Pa
from cldit.errors import OpticsError
from cldit.io.plain_data import parse_yaml
from cldit.optics.shipped import content, shipped

Status = Literal["measured", "estimate", "user"]

_SAMPLES = 4000  # wavelengths over a filter


@dataclass(frozen=True)
class KDistribution:
    """Absorption within a filter, sorted: (P,) weights, of sum 1, of (P,) rising values.

    The transmission is the sum of weights * exp(-absorption * column), column in mol/m2.
    """

    weights: Floats
    absorption_m2_mol: Floats

    def transmission(self, column_mol_m2: ArrayLike) -> Floats:
        """Mean transmission of columns [mol/m2], any shape."""
        column = np.asarray(column_mol_m2, dtype=float)[..., None]
        return np.asarray(np.exp(-self.absorption_m2_mol * column) @ self.weights)


@dataclass(frozen=True)
class Elsasser:
    """Fine structure g / d = at_atm * (p + self_share * p_own) * sqrt(273 / T) * exp(...).

    The exponent is growth * (T / 273 - 1); pressures in atm.
    """

    at_atm: float
    self_share: float
    growth: float

    def fine_structure(
        self, *, temperature_K: float, pressure_Pa: float, mole_fraction: float
    ) -> float:
        """y, the half width over the spacing of the lines, in a gas with this mole fraction."""
        warm = temperature_K / 273.0
        pressure = pressure_Pa / STANDARD_ATMOSPHERE_Pa * (1 + self.self_share * mole_fraction)
        return float(self.at_atm * pressure * np.exp(self.growth * (warm - 1)) / np.sqrt(warm))


@dataclass(frozen=True)
class VapourBand:
    """Absorption of one species, with its source.

    wavenumber_per_cm, temperatures_K: range of validity; below its first row the table is constant.
    number_per_cm (N,): points, linear in between, or the lower edges of bins of `bin_per_cm`.
    rows_K: (T,). table_m2_mol: (T, N).
    """

    species: str
    source: str
    status: Status
    wavenumber_per_cm: tuple[float, float]
    temperatures_K: tuple[float, float]
    number_per_cm: Floats
    rows_K: Floats
    table_m2_mol: Floats
    bin_per_cm: float | None = None
    lines: Elsasser | None = None

    def absorption_m2_mol(self, wavenumber_per_cm: ArrayLike, temperature_K: float) -> Floats:
        """Napierian molar cross section, the mean over lines, shaped as `wavenumber_per_cm`."""
        number = np.asarray(wavenumber_per_cm, dtype=float)
        low, high = self.wavenumber_per_cm
        inside = (number >= low * (1 - 1e-12)) & (number <= high * (1 + 1e-12))
        if not np.all(inside):
            bad = number[~inside].reshape(-1)[0]
            raise OpticsError(
                f"{self.species} vapour: {bad:g} 1/cm is outside {low:g}..{high:g} 1/cm "
                f"({1e4 / high:.4g}..{1e4 / low:.4g} um), the range of {self.source}"
            )
        row = self._row(temperature_K)
        if self.bin_per_cm is None:
            return np.asarray(np.interp(number, self.number_per_cm, row))
        return np.asarray(row[self._bin(number)])

    def area_km_mol(self, temperature_K: float) -> float:
        """Integral of the absorption over the wavenumber."""
        row = self._row(temperature_K) * 1e4
        if self.bin_per_cm is not None:
            return float(np.sum(row) * self.bin_per_cm * 1e-5)
        return float(np.trapezoid(row, self.number_per_cm) * 1e-5)

    def k_distribution(
        self,
        filter_um: tuple[float, float],
        *,
        temperature_K: float,
        pressure_Pa: float,
        points: int,
        mole_fraction: float = 0.0,
    ) -> KDistribution:
        """Absorption within a filter as at most `points` values with weights.

        The mean absorption is exact. Error of the transmission of methane, 3.3 to 3.5 um, optical
        depths of 0.01 to 100, 1 kPa to 10 MPa, 300 to 600 K: 1.7e-2 with 8 points, 2.1e-3 with 16,
        1.6e-4 with 32, 1.1e-5 with 64. The `mole_fraction` is that of the species, which broadens
        its own lines.
        """
        low, high = filter_um
        if not 0 < low < high:
            raise OpticsError(f"filter {low:g}..{high:g} um is empty")
        if not (0 < pressure_Pa < np.inf and 0 <= mole_fraction <= 1 and points >= 1):
            raise OpticsError(
                f"k-distribution: pressure {pressure_Pa:g} Pa, mole fraction {mole_fraction:g}, "
                f"{points} points; allowed: pressures above 0, 0..1, and 1 or more"
            )
        wavelength = low + (high - low) * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        self.absorption_m2_mol([1e4 / low, 1e4 / high], temperature_K)  # refuses what is outside
        share = np.full(_SAMPLES, 1.0 / _SAMPLES)
        if self.lines is None:
            return _grouped(self.absorption_m2_mol(1e4 / wavelength, temperature_K), share, points)
        bins = self._bin(1e4 / wavelength)
        bin_share = np.bincount(bins, share, len(self.number_per_cm))
        used = np.flatnonzero(bin_share)
        mean = self._row(temperature_K)[used]
        y = self.lines.fine_structure(
            temperature_K=temperature_K, pressure_Pa=pressure_Pa, mole_fraction=mole_fraction
        )
        relative, part = _elsasser(y)
        return _grouped(
            np.outer(mean, relative).ravel(), np.outer(bin_share[used], part).ravel(), points
        )

    def _row(self, temperature_K: float) -> Floats:
        low, high = self.temperatures_K
        if not low <= temperature_K <= high:
            raise OpticsError(
                f"{self.species} vapour: {temperature_K:g} K is outside {low:g}..{high:g} K, the "
                f"range of {self.source}"
            )
        place = float(np.interp(temperature_K, self.rows_K, np.arange(len(self.rows_K))))
        below = min(int(place), max(len(self.rows_K) - 2, 0))
        above = min(below + 1, len(self.rows_K) - 1)
        part = place - below
        return np.asarray((1 - part) * self.table_m2_mol[below] + part * self.table_m2_mol[above])

    def _bin(self, number: Floats) -> NDArray[np.intp]:
        place = np.searchsorted(self.number_per_cm, number, side="right") - 1
        return np.clip(place, 0, len(self.number_per_cm) - 1)


def _elsasser(y: float) -> tuple[Floats, Floats]:
    """k / S and shares of the spectrum of Elsasser's band, rising k; sum 1 and mean 1."""
    t = np.tanh(np.pi * y)
    count = int(np.clip(8.0 / t, 64, 65536))
    u = 0.5 * np.pi * (1 - (np.arange(count) + 0.5) / count)
    relative = np.cos(u) ** 2 / t + t * np.sin(u) ** 2
    share = 1.0 / (relative * count)
    return relative, share / share.sum()


def _grouped(k: Floats, share: Floats, points: int) -> KDistribution:
    """Two values for each of points / 2 groups, which preserve its first three moments.

    The density of groups in ln k is the cube root of the spectrum's, which is optimal for one value
    per group (Panter and Dite 1951) and good for two.
    """
    mean = float(k @ share)
    order = np.argsort(k)
    k, share = k[order], share[order]
    if mean <= 0 or points == 1 or k[-1] <= k[0] * (1 + 1e-12):
        return KDistribution(np.ones(1), np.array([mean]))
    groups = points // 2
    # 1e-5 of the mean absorbs 0.1 % where the mean's optical depth is 100.
    log = np.log(np.maximum(k, 1e-5 * mean))
    # Groups are made from 400 classes of ln k.
    held, edges = np.histogram(log, bins=400, weights=share)
    rise = np.concatenate([[0.0], np.cumsum(np.cbrt(held))])
    bounds = np.interp(np.linspace(0, rise[-1], groups + 1)[1:-1], rise, edges)
    group = np.searchsorted(bounds, log)
    weights = np.bincount(group, share, groups)
    filled = np.flatnonzero(weights > 0)
    weights = np.maximum(weights, 1e-300)
    middle = np.bincount(group, share * k, groups) / weights
    off = k - middle[group]
    variance = np.bincount(group, share * off**2, groups) / weights
    spread = np.sqrt(np.maximum(variance, 0.0))
    third = np.bincount(group, share * off**3, groups) / weights
    flat = spread <= 1e-9 * middle
    skew = np.where(flat, 0.0, 0.5 * third / np.where(flat, 1.0, spread) ** 3)
    root = np.sqrt(1 + skew**2)
    pairs = [
        (middle + sign * spread * (root + sign * skew), 0.5 * weights * (1 - sign * skew / root))
        for sign in (-1, 1)
    ]
    values = np.maximum(np.concatenate([pair[0][filled] for pair in pairs]), 0.0)
    shares = np.concatenate([pair[1][filled] for pair in pairs])
    order = np.argsort(values)
    return KDistribution(shares[order] / shares.sum(), values[order])


def vapours() -> tuple[str, ...]:
    """Names of the shipped vapours."""
    return shipped("vapour")


def vapour_band(species: str, *, area_km_mol: float | None = None) -> VapourBand:
    """A shipped vapour, one of `vapours()`.

    `n-heptane`: an estimate of the resolved band, of 503 km/mol; RadCal's 761 km/mol is about
    50 % above two other sources. `n-heptane-radcal`: RadCal's bins as published. `methane`. With
    `area_km_mol` all cross sections are scaled to this integral at the table's first temperature.
    """
    if species not in vapours():
        raise OpticsError(
            f"{species}: no vapour absorption is shipped; allowed: {', '.join(vapours())}, or a "
            "file of HITRAN cross sections (.xsc)"
        )
    data: dict[str, Any] = parse_yaml(content(f"vapour-{species}.yaml"), source=species)
    lines = csv.reader(content(f"vapour-{species}.csv").splitlines())
    rows_K = np.array([float(cell) for cell in next(lines)[1:]])
    columns = np.array([[float(cell) for cell in line] for line in lines])
    low, high = data["wavenumber_per_cm"]
    cold, hot = data["temperatures_K"]
    band = VapourBand(
        species=species,
        source=data["source"],
        status=data["status"],
        wavenumber_per_cm=(low, high),
        temperatures_K=(cold, hot),
        number_per_cm=columns[:, 0],
        rows_K=rows_K,
        table_m2_mol=columns[:, 1:].T * 1e-4,
        bin_per_cm=data.get("bin_per_cm"),
        lines=Elsasser(**data["lines"]) if "lines" in data else None,
    )
    if area_km_mol is None:
        return band
    if not 0 < area_km_mol < np.inf:
        raise OpticsError(f"{species}: an area of {area_km_mol:g} km/mol; allowed: above 0")
    factor = area_km_mol / band.area_km_mol(float(rows_K[0]))
    return replace(
        band,
        table_m2_mol=band.table_m2_mol * factor,
        source=f"{band.source}; scaled to {area_km_mol:g} km/mol",
    )
