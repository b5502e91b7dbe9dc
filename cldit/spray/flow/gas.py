"""Gas at low Mach number on a coarse Cartesian grid: one pressure, density by temperature and fuel.

Mass, fuel, enthalpy and momentum are carried in conservation form (`kernels`). The mass fluxes are
made, by one projection a step with constant coefficients (cosine or Fourier transforms), such that
every cell keeps the common pressure: their divergence is what kept it in the last step, plus what
the droplets just added and what is still amiss. Kinetic energy and molecular diffusion are left out
(Mach number below 0.3; eddies mix much faster).

The box is closed, its pressure follows from its energy; or it is periodic, for tests.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn, irfftn, rfftn

from cldit.errors import SprayError
from cldit.spray.flow import kernels
from cldit.spray.flow.mixture import GasMixture

Floats = NDArray[np.float64]

SMAGORINSKY = 0.15  # of the grid's spacing: the mixing length of eddies that it does not resolve
TURBULENT_SCHMIDT = 0.7  # and Prandtl number: a round jet's
CFL = 0.5  # summed over the three axes


@dataclass(frozen=True)
class Box:
    """Where the gas is: `origin_m` (3,) is the lower corner."""

    origin_m: Floats
    spacing_m: float
    shape: tuple[int, int, int]
    closed: bool = True

    @property
    def upper_m(self) -> Floats:
        return np.asarray(self.origin_m + self.spacing_m * np.array(self.shape))

    @property
    def cell_m3(self) -> float:
        return self.spacing_m**3


class GasFlow:
    """State of the gas; `step` moves it on.

    Attributes are arrays of the box's shape: density, fuel (vapour) kg/m3, enthalpy J/m3 on the
    zero of the mixture, temperature_K; flux (3, ...) kg/(m2 s) through the low faces, velocity
    (3, ...) there; eddy, the turbulent viscosity in m2/s. pressure_Pa is one number.
    """

    def __init__(
        self, box: Box, mixture: GasMixture, *, pressure_Pa: float, temperature_K: float
    ) -> None:
        shape = box.shape
        self.box, self.mixture, self.pressure_Pa = box, mixture, pressure_Pa
        density = pressure_Pa / (mixture.carrier_J_kg_K * temperature_K)
        self.far_density_kg_m3 = density
        self.density, self.fuel = np.full(shape, density), np.zeros(shape)
        self.temperature_K = np.full(shape, temperature_K)
        start = mixture.enthalpy_J_kg(np.zeros(1), np.array([temperature_K]))
        self.enthalpy = np.full(shape, density * start[0])
        self.flux, self.velocity = np.zeros((3, *shape)), np.zeros((3, *shape))
        self.eddy = np.zeros(shape)
        self._kept, self._amiss = np.zeros(shape), np.zeros(shape)
        self._wave = _eigenvalues(box)

    @property
    def share(self) -> Floats:
        """Mass fraction of fuel vapour."""
        return np.asarray(self.fuel / self.density)

    def longest_step_s(self) -> float:
        """By the CFL number; infinite in gas at rest."""
        top = float(np.abs(self.velocity).sum(axis=0).max())
        return CFL * self.box.spacing_m / top if top > 0 else np.inf

    def step(self, step_s: float, *, mass: Floats, enthalpy: Floats, momentum: Floats) -> None:
        """One step after the droplets have given what they gave in it.

        Args:
            mass: of fuel vapour, kg/m3 (X, Y, Z). enthalpy: J/m3 on the mixture's zero.
            momentum: kg m/(s m3) for the faces, (3, X, Y, Z).

        Raises:
            SprayError: the gas left what is possible; the flow could not be followed.
        """
        box, h = self.box, self.box.spacing_m
        self.density = self.density + mass
        self.fuel = self.fuel + mass
        self.enthalpy = self.enthalpy + enthalpy
        now = self._pressures()
        amiss = now / now.mean() - 1

        kernels.velocities(self.flux, self.density, self.velocity)
        kernels.shear(self.velocity, h, box.closed, self.eddy)
        self.eddy *= (SMAGORINSKY * h) ** 2
        viscosity = self.eddy * self.density
        rates = np.zeros_like(self.flux)

        def push(axis: int) -> None:
            kernels.momentum_rates(
                axis,
                self.velocity[axis],
                self.flux,
                self.density,
                viscosity,
                step_s,
                h,
                box.closed,
                rates[axis],
            )

        with ThreadPoolExecutor(2) as pool:
            list(pool.map(push, range(3)))
        flux = self.flux + step_s * rates + momentum
        if box.closed:
            flux[0, 0], flux[1, :, 0], flux[2, :, :, 0] = 0.0, 0.0, 0.0
        wanted = self._kept + self.density * amiss / step_s
        self.flux = self._project(flux, wanted - wanted.mean())

        self._carry(step_s, viscosity / TURBULENT_SCHMIDT)
        after = self._pressures()
        mean = float(after.mean())
        self.enthalpy += mean - self.pressure_Pa  # compression; energy is then conserved
        self.pressure_Pa = mean
        # What the divergence lacked, had it only been known.
        self._kept += self.density * (after / mean - 1) / step_s
        kernels.velocities(self.flux, self.density, self.velocity)

    def _carry(self, step_s: float, exchange: Floats) -> None:
        """Mass, fuel and enthalpy go with the fluxes, fuel and enthalpy also with the eddies."""
        fields = np.stack([self.fuel / self.density, self.enthalpy / self.density])
        rates = np.zeros_like(fields)
        h = self.box.spacing_m
        kernels.scalar_rates(
            fields, self.flux, self.density, exchange, step_s, h, self.box.closed, rates
        )
        out = np.empty_like(self.density)
        kernels.divergence(self.flux, h, out)
        self.density = self.density - step_s * out
        self.fuel += step_s * rates[0]
        self.enthalpy += step_s * rates[1]

    def _pressures(self) -> Floats:
        """Of every cell by itself; and the temperature."""
        if not np.all(self.density > 0):
            raise SprayError(
                "the gas flow of the spray broke down: a cell lost all of its gas; a finer "
                "spray.grid.spacing_m may help"
            )
        self.temperature_K = self.mixture.temperature_K(
            self.fuel / self.density, self.enthalpy / self.density, self.temperature_K
        )
        low, high = float(self.temperature_K.min()), float(self.temperature_K.max())
        if not 100 < low <= high < 1500:
            raise SprayError(
                f"the gas flow of the spray broke down: temperatures from {low:g} to {high:g} K; "
                "a finer spray.grid.spacing_m may help"
            )
        return self.mixture.pressure_Pa(self.density, self.fuel, self.temperature_K)

    def _project(self, flux: Floats, wanted: Floats) -> Floats:
        """The nearest mass fluxes that have the wanted divergence."""
        h = self.box.spacing_m
        amiss = np.empty_like(wanted)
        kernels.divergence(flux, h, amiss)
        amiss -= wanted
        if self.box.closed:
            potential = idctn(dctn(amiss, workers=2) / self._wave, workers=2)
        else:
            potential = irfftn(rfftn(amiss, workers=2) / self._wave, s=self.box.shape, workers=2)
        kernels.subtract_gradient(np.asarray(potential), h, self.box.closed, flux)
        return flux


def _eigenvalues(box: Box) -> Floats:
    """Of the seven-point Laplacian; infinite for the mean, which has no gradient."""
    parts = []
    for axis, count in enumerate(box.shape):
        n = np.arange(count)
        if not box.closed and axis == 2:
            n = n[: count // 2 + 1]
        angle = np.pi * n / (2 * count) if box.closed else np.pi * n / count
        parts.append(-((2 * np.sin(angle) / box.spacing_m) ** 2))
    total = parts[0][:, None, None] + parts[1][None, :, None] + parts[2][None, None, :]
    total[0, 0, 0] = np.inf
    return np.asarray(total)
