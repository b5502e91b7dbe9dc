"""Finely resolved optical properties of a spray over a filter, from which nodes are made.

Samples are narrow intervals of the filter. For a vapour with narrower lines, every interval is
divided by a k-distribution, whose groups are assumed to be the same lines at every temperature
(correlated k).
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.constants import STANDARD_ATMOSPHERE_Pa
from cldit.optics.liquid import Liquid, liquid
from cldit.optics.liquid_table import read_liquid_table
from cldit.optics.response import Filter, edges_um
from cldit.optics.vapour import KDistribution, VapourBand, vapour_band
from cldit.optics.xsc import read_xsc
from cldit.scene.schema import Scene
from cldit.spray.result import Spray

_STEP_per_cm = 2.0  # a sixth of the narrowest bands of n-heptane, liquid and vapour


def fuel_of(scene: Scene, spray: Spray) -> str:
    """Name of the fuel: that of the spray, else that of the scene."""
    return spray.fuel or getattr(scene.spray, "fuel", "n-heptane")


def liquid_of(scene: Scene, spray: Spray) -> Liquid | None:
    """Liquid that the scene names, or the spray's fuel; None without parcels."""
    if spray.parcels is None or not len(spray.parcels.diameter_m):
        return None
    name = scene.optics.liquid or fuel_of(scene, spray)
    path = Path(name)
    return read_liquid_table(path) if path.suffix else liquid(name)


def vapour_of(scene: Scene, spray: Spray) -> VapourBand | None:
    """Vapour that the scene names, or the spray's fuel; None without vapour."""
    if spray.vapour is None or not len(spray.vapour.number_density_m3):
        return None
    name, area = scene.optics.vapour or fuel_of(scene, spray), scene.optics.vapour_area_km_mol
    path = Path(name)
    return read_xsc(path) if path.suffix else vapour_band(name, area_km_mol=area)


@dataclass(frozen=True)
class Spectrum:
    """S samples of J intervals.

    edges_um (J + 1,); interval (S,): that of a sample; part (S,): its share of that interval.
    vapour_K (M,), vapour_m2_mol (M, S); liquid_K (P,), n and k (P, S). M, P = 0 without the phase.
    """

    edges_um: Floats
    interval: NDArray[np.intp]
    part: Floats
    vapour_K: Floats
    vapour_m2_mol: Floats
    liquid_K: Floats
    n: Floats
    k: Floats

    @property
    def middles_um(self) -> Floats:
        """(S,) middle wavelength of every sample's interval."""
        return np.asarray((self.edges_um[1:] + self.edges_um[:-1])[self.interval] / 2.0)

    def members(self, group: NDArray[np.intp], count: int) -> Floats:
        """(count, J) share of each interval that belongs to each group of samples (S,)."""
        out = np.zeros((count, len(self.edges_um) - 1))
        np.add.at(out, (group, self.interval), self.part)
        return np.asarray(out / out.sum(axis=0))

    @classmethod
    def of(cls, scene: Scene, spray: Spray, filter_um: Filter) -> "Spectrum":
        """Spectrum over `filter_um` of the scene's substances at the spray's temperatures."""
        substance, band = liquid_of(scene, spray), vapour_of(scene, spray)
        edges = _edges(filter_um, band)
        count = len(edges) - 1
        interval, part = np.arange(count), np.ones(count)
        vapour_K, vapour = np.zeros(0), np.zeros((0, count))
        if band is not None and spray.vapour is not None:
            present_K = spray.vapour.temperature_K[spray.vapour.number_density_m3 > 0]
            # Absorption is linear between five temperatures of the vapour.
            vapour_K = _knots(present_K, 5)
            pressure = getattr(
                getattr(scene.spray, "ambient", None), "pressure_Pa", STANDARD_ATMOSPHERE_Pa
            )
            interval, part, vapour = _vapour(band, edges, vapour_K, pressure)
        liquid_K = np.zeros(0)
        n = k = np.zeros((0, len(part)))
        if substance is not None and spray.parcels is not None:
            present_K = spray.parcels.temperature_K[spray.parcels.droplets > 0]
            # k follows the density, 0.15 %/K and nearly straight: two ends suffice.
            wide = present_K.size and np.ptp(present_K) > 5.0
            liquid_K = _knots(present_K, 2 if wide else 1)
            middles = (edges[1:] + edges[:-1]) / 2.0
            index = [substance.index(middles, float(each_K)) for each_K in liquid_K]
            n, k = (np.array(rows)[:, interval] for rows in zip(*index, strict=True))
        return cls(edges, interval, part, vapour_K, vapour, liquid_K, n, k)


def _knots(temperature_K: Floats, count: int) -> Floats:
    """Temperatures that span those given; one if they differ by less than 1 K."""
    if not temperature_K.size:
        return np.array([300.0])
    low, high = float(temperature_K.min()), float(temperature_K.max())
    if count < 2 or high - low < 1.0:
        return np.array([(low + high) / 2.0])
    return np.linspace(low, high, count)


def _edges(filter_um: Filter, vapour: VapourBand | None) -> Floats:
    """Rising wavelengths; equal steps of wavenumber, or the bins of a vapour with lines."""
    low, high = edges_um(filter_um)
    low_per_cm, high_per_cm = 1e4 / high, 1e4 / low
    if vapour is not None and vapour.lines is not None:
        bounds = vapour.number_per_cm[
            (vapour.number_per_cm > low_per_cm) & (vapour.number_per_cm < high_per_cm)
        ]
        number = np.array([low_per_cm, *bounds, high_per_cm])
    else:
        # 400 samples are 800 1/cm at that step; wider filters have wider steps.
        count = int(np.clip(np.ceil((high_per_cm - low_per_cm) / _STEP_per_cm), 16, 400))
        number = np.linspace(low_per_cm, high_per_cm, count + 1)
    edges = 1e4 / number[::-1]
    edges[0], edges[-1] = low, high
    return np.asarray(edges)


def _vapour(
    band: VapourBand, edges: Floats, temperature_K: Floats, pressure_Pa: float
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Interval (S,), part of it (S,), and absorption (M, S)."""
    if band.lines is None:
        middles = 1e4 / ((edges[1:] + edges[:-1]) / 2.0)
        rows = [band.absorption_m2_mol(middles, float(each_K)) for each_K in temperature_K]
        return np.arange(len(middles)), np.ones(len(middles)), np.array(rows)
    interval: list[int] = []
    part: list[float] = []
    columns: list[Floats] = []
    for number, (low, high) in enumerate(pairwise(edges)):
        # Moved inwards by rounding, so that one bin does not count as two.
        inner = (float(low) * (1.0 + 1e-9), float(high) * (1.0 - 1e-9))
        groups = [
            # 16 groups in every 25 1/cm: 3.5e-3 of transmission at worst.
            band.k_distribution(
                inner, temperature_K=float(each_K), pressure_Pa=pressure_Pa, points=16
            )
            for each_K in temperature_K
        ]
        common = groups[len(groups) // 2].weights
        interval += [number] * len(common)
        part += common.tolist()
        columns += list(np.array([_regrouped(group, common) for group in groups]).T)
    return np.array(interval), np.array(part), np.array(columns).T


def _regrouped(groups: KDistribution, weights: Floats) -> Floats:
    """Mean absorption in groups of other weights, in the same rising order."""
    cumulative = np.concatenate([[0.0], np.cumsum(groups.weights)])
    total = np.concatenate([[0.0], np.cumsum(groups.weights * groups.absorption_m2_mol)])
    bounds = np.concatenate([[0.0], np.cumsum(weights)])
    bounds[-1] = cumulative[-1]
    return np.asarray(np.diff(np.interp(bounds, cumulative, total)) / weights)
