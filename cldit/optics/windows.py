"""Transmission, reflection and emission of plane windows.

Coated windows and other materials follow a measured table; uncoated ones are computed as follows.

Reflections between the two surfaces are added without interference (a window is far thicker than
the coherence length behind any filter), at normal incidence. The light is unpolarised; sapphire is
cut perpendicular to its axis, so that only the ordinary ray occurs.

Refractive index: Sellmeier equations, CaF2 of Malitson (Appl. Opt. 2, 1103, 1963) at 297 K,
sapphire of Malitson and Dodge (ordinary ray, 293 K), as refractiveindex.info tabulates them (CC0).
dn/dT, constant: CaF2 -1.5e-5 /K (294 to 460 K at 1.7 um, from the equations of Zheng, Wang and
Thompson, Opt. Mater. Express 13, 2380, 2023), sapphire 1.4e-5 /K (296 to 470 K, from the equation
for alumina of Harris et al., Opt. Eng. 56, 077103, 2017). 150 K move the transmission by 4e-4 at
most.

Absorption, at room temperature: CaF2 from the k that Crystran publishes (2 to 5.6 um, through
refractiveindex.info, CC0). Sapphire: estimate, the exponential edge of multiphonon absorption,
55222 exp(-5.03 nu / 914) per cm (0.92 per cm at 5 um, 5e-3 per cm at 3.4 um); a hot window absorbs
more than that beyond 4 um.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import SceneError
from cldit.optics.planck import part_radiance
from cldit.optics.response import Filter, edges_um
from cldit.scene.vessel import Window

_PARTS = 64  # into which a filter is divided for the mean over it


@dataclass(frozen=True)
class Pane:
    """Shares of the light that falls on a window; emission = 1 - transmission - reflection."""

    transmission: float = 1.0
    reflection: float = 0.0

    @property
    def emission(self) -> float:
        """Emissivity, by Kirchhoff's law the absorbed share."""
        return max(1.0 - self.transmission - self.reflection, 0.0)


@dataclass(frozen=True)
class Material:
    """Sellmeier terms (B, C in um) at `at_K`, and k; both are known within `range_um`."""

    sellmeier: tuple[tuple[float, float], ...]
    at_K: float
    slope_per_K: float
    range_um: tuple[float, float]
    extinction: Callable[[Floats], Floats]  # k over wavelength_um

    def index(self, wavelength_um: ArrayLike, temperature_K: float) -> Floats:
        """Real part n at `temperature_K`, shaped as `wavelength_um`."""
        square = np.asarray(wavelength_um, float) ** 2
        terms = sum(b * square / (square - c * c) for b, c in self.sellmeier)
        return np.asarray(np.sqrt(1.0 + terms) + self.slope_per_K * (temperature_K - self.at_K))


# k of CaF2 over the wavelength in um, by Crystran, see above
_FLUORITE = np.array([
    (2.0, 9.56e-9), (2.5, 0.0), (4.7, 0.0), (4.75, 8.6e-9), (4.8, 2.14e-8), (4.9, 5.17e-8),
    (5.0, 7.62e-8), (5.1, 9.08e-8), (5.2, 9.57e-8), (5.4, 9.61e-8), (5.5, 9.72e-8), (5.6, 1.04e-7),
]).T  # fmt: skip


def _sapphire_k(wavelength_um: Floats) -> Floats:
    per_cm = 55222.0 * np.exp(-5.03 * 1e4 / (914.0 * wavelength_um))
    return np.asarray(per_cm * 1e-4 * wavelength_um / (4.0 * np.pi))


MATERIALS = {
    "CaF2": Material(
        sellmeier=((0.5675888, 0.050263605), (0.4710914, 0.1003909), (3.8484723, 34.649040)),
        at_K=297.0,
        slope_per_K=-1.5e-5,
        range_um=(2.0, 5.6),
        extinction=lambda wavelength_um: np.asarray(np.interp(wavelength_um, *_FLUORITE)),
    ),
    "sapphire": Material(
        sellmeier=((1.4313493, 0.0726631), (0.65054713, 0.1193242), (5.3414021, 18.028251)),
        at_K=293.0,
        slope_per_K=1.4e-5,
        range_um=(2.0, 5.0),
        extinction=_sapphire_k,
    ),
}


def slab(
    n: ArrayLike, k: ArrayLike, *, wavelength_um: ArrayLike, thickness_m: float
) -> tuple[Floats, Floats]:
    """Transmission and reflection of a plane slab in air.

    With r = |(m - 1) / (m + 1)|^2 of one surface and a = exp(-4 pi k d / wavelength) of one
    passage, the reflections between the surfaces add up to geometric series:
    T = (1 - r)^2 a / (1 - r^2 a^2), R = r (1 + a T).

    The index n - ik, the wavelength in vacuum and both results have the same shape.
    """
    n, k = np.asarray(n, float), np.asarray(k, float)
    surface = ((n - 1.0) ** 2 + k * k) / ((n + 1.0) ** 2 + k * k)
    passage = np.exp(-4.0 * np.pi * k * thickness_m / (np.asarray(wavelength_um, float) * 1e-6))
    transmission = (1.0 - surface) ** 2 * passage / (1.0 - (surface * passage) ** 2)
    return transmission, surface * (1.0 + passage * transmission)


def window_shares(window: Window, wavelength_um: ArrayLike) -> tuple[Floats, Floats]:
    """Transmission and reflection of `window` at `wavelength_um`, any shape."""
    wavelength = np.asarray(wavelength_um, float)
    if window.material is None:
        return _tabled(window, wavelength)
    material = MATERIALS[window.material]
    low, high = material.range_um
    if wavelength.size and not (wavelength.min() >= low and wavelength.max() <= high):
        raise SceneError(
            f"windows: {window.material} is known from {low:g} to {high:g} um, the filter covers "
            f"{wavelength.min():g} to {wavelength.max():g} um"
        )
    return slab(
        material.index(wavelength, window.temperature_K),
        material.extinction(wavelength),
        wavelength_um=wavelength,
        thickness_m=window.thickness_m,
    )


def _tabled(window: Window, wavelength_um: Floats) -> tuple[Floats, Floats]:
    shares = []
    for name, curve in (("transmission", window.transmission), ("reflection", window.reflection)):
        known_um, share = np.array(curve, float).T
        if wavelength_um.size and not (
            wavelength_um.min() >= known_um[0] and wavelength_um.max() <= known_um[-1]
        ):
            raise SceneError(
                f"windows: {name} of the {window.side} window is given from {known_um[0]:g} to "
                f"{known_um[-1]:g} um, the filter covers {wavelength_um.min():g} to "
                f"{wavelength_um.max():g} um"
            )
        shares.append(np.asarray(np.interp(wavelength_um, known_um, share)))
    return shares[0], shares[1]


def band_pane(window: Window, filter_um: Filter, *, reference_K: float) -> Pane:
    """Means over a filter for light of a black body at `reference_K`."""
    return band_panes(window, filter_um, reference_K=np.array([reference_K]))[0]


def band_panes(window: Window, filter_um: Filter, *, reference_K: Floats) -> tuple[Pane, ...]:
    """N means over a filter, for light of black bodies at `reference_K` (N,)."""
    low, high = edges_um(filter_um)
    edges = np.linspace(low, high, _PARTS + 1)
    middles = (edges[1:] + edges[:-1]) / 2.0
    light = np.array(
        [
            part_radiance(reference_K, filter_um=filter_um, low_um=float(a), high_um=float(b))
            for a, b in pairwise(edges)
        ]
    )
    window_shares(window, edges)  # refuses a filter beyond the data
    return tuple(mean_pane(window, middles, spectrum) for spectrum in light.T)


def mean_pane(window: Window, wavelength_um: Floats, light: Floats) -> Pane:
    """Means over wavelengths (N,) with the weights `light` (N,)."""
    transmission, reflection = window_shares(window, wavelength_um)
    share = light / light.sum()
    return Pane(float(share @ transmission), float(share @ reflection))
