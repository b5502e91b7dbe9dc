"""Complex refractive indices n - ik of liquid fuels between 2 and 5.6 um.

Shipped liquids are sums of Voigt bands (a Gaussian spread of Lorentz oscillators, as in Brendel
and Bormann, J. Appl. Phys. 71, 1 (1992)), fitted to published tables. With w the Faddeeva function
and z = (v - v_j + i g_j) / (sqrt(2) s_j), a band gives k = h_j Re w and n = -h_j Im w, mirrored at
-v_j: both are one analytic function, so n follows from k by Kramers-Kronig without quadrature.
Transitions outside the table (electrons, bending) add c0 + c1 (v / 3000)^2 + c2 (3000 / v)^2 to n.

At other temperatures than that of the data, k is assumed to scale with the density and n by a
constant dn/dT; these bands have not been measured at the temperatures of a spray.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import OpticsError
from cldit.io.plain_data import parse_yaml
from cldit.optics.shipped import content, shipped

Status = Literal["measured", "estimate", "user"]


@dataclass(frozen=True)
class Bands:
    """A sum of bands with its dependence on temperature.

    bands: (B, 4): height of k, centre, Lorentz half width at half height, Gaussian standard
    deviation, the last three in 1/cm. background: c0, c1, c2.
    """

    bands: Floats
    background: tuple[float, float, float]
    dn_dT_per_K: float
    critical_K: float
    packing: tuple[float, float]  # density ~ packing[0]^-(1 - T / critical)^packing[1]

    def at(self, wavelength_um: Floats) -> tuple[Floats, Floats]:
        """n and k at wavelengths [um], any shape."""
        number = (1e4 / wavelength_um)[..., None]
        height, centre, lorentz, gauss = self.bands.T
        scale = np.sqrt(2.0) * gauss
        band = scipy.special.wofz((number - centre + 1j * lorentz) / scale)
        mirror = scipy.special.wofz((number + centre + 1j * lorentz) / scale)
        response = np.sum(height * (band - mirror), axis=-1)
        # The background's n is c0 + c1 + c2 at 3000 1/cm, about the C-H band.
        ratio = (1e4 / 3000.0 / wavelength_um) ** 2
        c0, c1, c2 = self.background
        return c0 + c1 * ratio + c2 / ratio - response.imag, np.maximum(response.real, 0.0)

    def density_ratio(self, temperature_K: float, reference_K: float) -> float:
        """Density at `temperature_K` over that at `reference_K`, by Rackett's equation."""
        base, power = self.packing
        cold, hot = ((1 - t / self.critical_K) ** power for t in (reference_K, temperature_K))
        return float(base ** (cold - hot))


@dataclass(frozen=True)
class Table:
    """Three columns (N,), wavelengths rising; linear in between."""

    wavelength_um: Floats
    n: Floats
    k: Floats

    def at(self, wavelength_um: Floats) -> tuple[Floats, Floats]:
        """n and k at wavelengths [um], any shape."""
        n = np.interp(wavelength_um, self.wavelength_um, self.n)
        return n, np.interp(wavelength_um, self.wavelength_um, self.k)


@dataclass(frozen=True)
class Liquid:
    """Refractive index of a liquid, with its source and range.

    status: `measured`, `estimate` (derived as the source states) or `user`.
    temperature_K: of the data; None if unknown. fit: error of the bands against the source's table.
    """

    name: str
    source: str
    status: Status
    temperature_K: float | None
    wavelength_um: tuple[float, float]
    temperatures_K: tuple[float, float]
    model: Bands | Table
    fit: str = ""
    licence: str = ""

    def index(self, wavelength_um: ArrayLike, temperature_K: float) -> tuple[Floats, Floats]:
        """n and k, shaped as `wavelength_um`, at `temperature_K`; a user's table is constant."""
        wavelength = np.asarray(wavelength_um, dtype=float)
        low, high = self.wavelength_um
        inside = (wavelength >= low * (1 - 1e-12)) & (wavelength <= high * (1 + 1e-12))
        if not np.all(inside):
            bad = wavelength[~inside].reshape(-1)[0]
            raise OpticsError(
                f"{self.name}: {bad:g} um is outside {low:g}..{high:g} um, the range of its "
                f"refractive index ({self.source})"
            )
        cold, hot = self.temperatures_K
        if not cold <= temperature_K <= hot:
            raise OpticsError(
                f"{self.name}: {temperature_K:g} K is outside {cold:g}..{hot:g} K, where it is "
                "liquid"
            )
        n, k = self.model.at(wavelength)
        if isinstance(self.model, Bands) and self.temperature_K is not None:
            n = n + self.model.dn_dT_per_K * (temperature_K - self.temperature_K)
            k = k * self.model.density_ratio(temperature_K, self.temperature_K)
        return n, k


def liquids() -> tuple[str, ...]:
    """Names of the shipped liquids."""
    return shipped("liquid")


def liquid(name: str) -> Liquid:
    """A shipped liquid: n-heptane (an estimate), n-octane or iso-octane (measured)."""
    if name not in liquids():
        raise OpticsError(
            f"{name}: no refractive index is shipped; allowed: {', '.join(liquids())}, "
            "or a table in a file"
        )
    data: dict[str, Any] = parse_yaml(content(f"liquid-{name}.yaml"), source=name)
    c0, c1, c2 = data["background"]
    density = data["density"]
    model = Bands(
        bands=np.array(data["bands"], dtype=float),
        background=(c0, c1, c2),
        dn_dT_per_K=data["dn_dT_per_K"],
        critical_K=density["critical_K"],
        packing=(density["base"], density["exponent"]),
    )
    low, high = data["wavelength_um"]
    cold, hot = data["temperatures_K"]
    return Liquid(
        name=name,
        source=data["source"],
        status=data["status"],
        temperature_K=data["temperature_K"],
        wavelength_um=(low, high),
        temperatures_K=(cold, hot),
        model=model,
        fit=data["fit"],
        licence=data["licence"],
    )
