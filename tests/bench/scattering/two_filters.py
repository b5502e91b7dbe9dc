"""Temperature of droplets from two filters in which they absorb differently.

Each filter i gives an emissivity and an apparent temperature, in which the share omega_i of the
walls' light depends on the albedo of the droplets. For a Sauter mean diameter d the albedo follows
from n and k of the liquid. The spray along a line of sight is modelled as a uniform slab that
scatters isotropically, with walls of one temperature. Its optical depth follows from the
emissivity, and by reciprocity the absorbed share of a normally incident ray equals the share of its
own emission in the radiance that leaves it normally,

    epsilon_i - w_wall,i = A(tau_i, albedo_i(d)),    tau_i = -ln(1 - epsilon_i).

Each filter thus gives a temperature for every d, and the result is the d at which both agree. The
share g of scattered light counts as not scattered (similarity: van de Hulst 1980, chapter 14). The
method needs no model of the spray, but n and k in both filters, no absorption by vapour, and
optical properties that differ between the filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.special import expn, gammaincinv

from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.dit.scattering import LEAST_OWN, apparent
from cldit.optics.mie import efficiencies

Floats = NDArray[np.float64]

DIAMETERS_UM = tuple(np.geomspace(3.0, 40.0, 28).tolist())
_THICKEST = 12.0  # larger depths have the same emissivity
_LAYERS = 64
_QUANTILES = gammaincinv(6.0, (np.arange(48) + 0.5) / 48)  # scipy.stats loads for half a second
_SURE = 2.0  # standard errors within which the two temperatures agree


@dataclass(frozen=True)
class Band:
    """Maps in one filter, and the refractive index of the liquid. isotropic: droplets scatter
    isotropically, as in the paper; otherwise scattering is reduced by 1 - g."""

    maps: Maps
    curve: Curve
    wavelength_um: float
    n: float
    k: float
    isotropic: bool = False

    def albedos(self, diameters_um: ArrayLike) -> Floats:
        """Albedos (D,) of droplets with Sauter mean diameters `diameters_um` (D,).

        Sizes follow the paper's first distribution, a gamma distribution of shape 4, so that cross
        sections have one of shape 6. Its width averages the resonances of single sizes.
        """
        size = np.asarray(diameters_um, dtype=float)[:, None] / 6.0 * _QUANTILES
        found = efficiencies(n=self.n, k=self.k, x=np.pi * size.ravel() / self.wavelength_um)
        aside = found.scattering * (1.0 if self.isotropic else 1.0 - found.asymmetry)
        scattered, absorbed = (
            np.mean(each.reshape(size.shape), axis=1) for each in (aside, found.absorption)
        )
        return np.asarray(scattered / (scattered + absorbed))


@dataclass(frozen=True)
class SlabTemperature:
    """Temperature and size of droplets, (H, W) each, NaN without a result.

    low_K, high_K: range over all diameters at which both filters agree within two standard errors,
    and two standard errors about the temperature.
    """

    temperature_K: Floats
    standard_error_K: Floats
    diameter_um: Floats
    low_K: Floats
    high_K: Floats


def absorbed(depth: float, albedo: float) -> float:
    """Share of a normally incident ray that a slab of optical `depth` absorbs; isotropic `albedo`.

    Solves S(t) = albedo (exp(-t) + integral S(t') E1(|t - t'|) / 2 dt') with S constant in each of
    64 layers and the kernel integrated exactly (Milne; Chandrasekhar 1950, chapter 1).
    """
    # Layers are thin at the faces, where the source is steep.
    edges = 0.5 * depth * (1.0 - np.cos(np.pi * np.arange(_LAYERS + 1) / _LAYERS))
    wide = np.diff(edges)
    apart = np.abs(edges[:, None] - edges[None, :])
    e3 = expn(3, apart)
    # Mean over layer i of half the integral of E1 over layer j: second differences of E3.
    second = e3[1:, 1:] - e3[1:, :-1] - e3[:-1, 1:] + e3[:-1, :-1]
    kernel = -0.5 * second / wide[:, None]
    np.fill_diagonal(kernel, 1.0 - (0.5 - expn(3, wide)) / wide)
    direct = -np.diff(np.exp(-edges)) / wide
    source = np.linalg.solve(np.eye(_LAYERS) - albedo * kernel, direct)
    return float((1.0 - albedo) * source @ wide)


@cache
def _own_table() -> RegularGridInterpolator:
    """Absorbed over extinguished light of a slab, as a function of depth and sqrt(1 - albedo)."""
    depths = np.expm1(np.linspace(np.log1p(0.01), np.log1p(_THICKEST), 20))
    roots = np.linspace(0.0, 1.0, 21)
    own = [[absorbed(t, 1.0 - r * r) / -np.expm1(-t) for r in roots] for t in depths]
    return RegularGridInterpolator((np.log1p(depths), roots), np.array(own))


def own_share(depth: ArrayLike, albedo: ArrayLike) -> Floats:
    """A / (1 - exp(-depth)) of `absorbed`, to 0.3 %, any shape, with depths clipped to 0.01..12."""
    depth, albedo = np.broadcast_arrays(depth, albedo)
    table = _own_table()
    low, high = table.grid[0][[0, -1]]
    known = np.isfinite(depth)
    log = np.clip(np.log1p(np.where(known, depth, 0.0)), low, high)
    return np.where(known, table((log, np.sqrt(1.0 - albedo))), np.nan)


def one_filter(
    band: Band, *, diameter_um: float, wall_temperature_K: float
) -> tuple[Floats, Floats]:
    """Temperature and its standard error, (H, W), from one filter with a known mean diameter."""
    temperature_K, error = _over_sizes(band, np.array([diameter_um]), wall_temperature_K)
    return temperature_K[..., 0], error[..., 0]


def _over_sizes(band: Band, diameters_um: Floats, wall_temperature_K: float) -> tuple[Floats, ...]:
    """Temperature and its standard error for each diameter, (H, W, D)."""
    depth = -np.log(np.clip(1.0 - band.maps.emissivity.astype(float), 1e-9, 1.0))
    own = own_share(depth[..., None], band.albedos(diameters_um))
    radiance, error = (each[..., None] for each in apparent(band.maps, band.curve))
    wall = float(band.curve.radiance(wall_temperature_K))
    medium = (radiance - (1.0 - own) * wall) / own
    with np.errstate(invalid="ignore"):
        medium = np.where((own >= LEAST_OWN) & (medium > 0.0), medium, np.nan)
    return band.curve.temperature(medium), error / own * band.curve.temperature_slope(medium)


def two_filters(bands: tuple[Band, Band], *, wall_temperature_K: float) -> SlabTemperature:
    """Temperature and size of droplets at which two filters agree.

    Pixels have no result if the filters agree at no size of 3 to 40 um within two standard errors.
    """
    sizes = np.array(DIAMETERS_UM)
    curves = [_over_sizes(band, sizes, wall_temperature_K) for band in bands]
    (one, one_error), (other, other_error) = curves
    apart = one - other
    with np.errstate(divide="ignore", invalid="ignore"):
        agree = np.abs(apart) <= _SURE * np.hypot(one_error, other_error)
        crossed = apart[..., :-1] * apart[..., 1:] <= 0.0
    meets = crossed.any(axis=-1)
    at = crossed.argmax(axis=-1)[..., None]

    def at_meeting(values: Floats) -> Floats:
        return np.where(meets, np.take_along_axis(values, at, axis=-1)[..., 0], np.nan)

    first, rises = at_meeting(one[..., :-1]), [at_meeting(np.diff(each)) for each in (one, other)]
    errors = [at_meeting(each[..., :-1]) for each in (one_error, other_error)]
    with np.errstate(divide="ignore", invalid="ignore"):
        # Of T where one + rise d meets other + rise d, d between 0 and 1 of the step in size.
        step = -at_meeting(apart[..., :-1]) / (rises[0] - rises[1])
        temperature_K = first + rises[0] * step
        spread = np.hypot(rises[1] * errors[0], rises[0] * errors[1]) / abs(rises[0] - rises[1])
        diameter = np.exp(np.interp(at[..., 0] + step, np.arange(sizes.size), np.log(sizes)))
    everywhere = np.where(agree, 0.5 * (one + other), np.nan)
    edges = [temperature_K - _SURE * spread, temperature_K + _SURE * spread]
    every = np.concatenate([everywhere, np.stack(edges, axis=-1)], axis=-1)
    low = np.min(np.where(np.isnan(every), np.inf, every), axis=-1)
    high = np.max(np.where(np.isnan(every), -np.inf, every), axis=-1)
    said = np.isfinite(low)
    return SlabTemperature(
        temperature_K=temperature_K,
        standard_error_K=spread,
        diameter_um=np.where(meets, diameter, np.nan),
        low_K=np.where(said, low, np.nan),
        high_K=np.where(said, high, np.nan),
    )
