"""Gas at low Mach number on the grid of rays, with one pressure.

Mass, fuel, enthalpy and momentum have conservation form (`advection`). One projection per step
corrects the mass fluxes of the faces such that every cell keeps the common pressure: their
divergence is that of the last step, plus the contributions of the droplets and of the remaining
error. The operator is separable, and is solved directly. Kinetic energy and molecular diffusion
are neglected (Mach number below 0.3; eddies mix much faster).

Eddies have Prandtl's mixing length, a property of the jets and not of the grid, so that a finer
grid resolves the same flow: l = c x at the distance x from the injector, with which a jet spreads
as measured. Tollmien's solution for it has its half width at 1.24 c^(2/3) x (G. N. Abramovich, The
Theory of Turbulent Jets, 1963). The entrainment of a jet depends only on the density of the
surrounding gas (F. P. Ricou and D. B. Spalding, J. Fluid Mech. 11, 21 (1961)): a heavy jet is
narrower, by sqrt(rho_far/rho), and l shorter, by the power 3/2 of it.

The domain is closed, and its pressure follows from its energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.spray.flow import advection, kernels
from cldit.spray.flow.mixture import GasMixture
from cldit.spray.flow.projection import Projection
from cldit.spray.flow.rays import RayGrid

HALF_WIDTH = 0.085  # of a free jet, over the distance
MIXING_LENGTH = (HALF_WIDTH / 1.24) ** 1.5  # of the distance from the injector
TURBULENT_SCHMIDT = 0.7  # and Prandtl number, of a round jet
CFL = 0.5  # along the rays, which sets the step
MOST_EXPLICIT = 0.7  # CFL number of explicit fluxes, summed over the axes; they are stable below 1
EDDY_STEPS = 4  # between two computations of the shear
_FIRST_STEP_S = 1e-7
_FASTEST_M_S = 1e3  # no spray has gas faster than its liquid
_NOTHING = 1e-18  # of the largest source: less than the rounding of their sum
_RISE = 1.3  # of the step, at most: sources accelerate the gas within one


@dataclass(frozen=True)
class _Sources:
    """Sources per volume, of the grid's shape: mass, enthalpy, momentum (5, ...); and what they add
    to the pressure of a cell, over the pressure."""

    amounts: Floats
    rise: Floats


class GasFlow:
    """State of the gas, which `step` advances.

    Attributes are arrays of the grid's shape: density, fuel (vapour) kg/m3, enthalpy J/m3 on the
    zero of the mixture, temperature_K; velocity (3, ...) in the grid's frame; flux (3, ...) kg/s
    through the lower faces; eddy, the turbulent viscosity in m2/s. pressure_Pa is one number.
    pushed_N_s: momentum (3,) that the walls have given to the gas, in the grid's frame.
    """

    def __init__(
        self, grid: RayGrid, mixture: GasMixture, *, pressure_Pa: float, temperature_K: float
    ) -> None:
        shape = grid.shape
        self.grid, self.mixture, self.pressure_Pa = grid, mixture, pressure_Pa
        density = pressure_Pa / (mixture.carrier_J_kg_K * temperature_K)
        self.far_density_kg_m3 = density
        self.density, self.fuel = np.full(shape, density), np.zeros(shape)
        self.temperature_K = np.full(shape, temperature_K)
        start = mixture.enthalpy_J_kg(np.zeros(1), np.array([temperature_K]))
        self.enthalpy = np.full(shape, density * start[0])
        self.velocity, self.flux = np.zeros((3, *shape)), np.zeros((3, *shape))
        self.eddy, self.pushed_N_s = np.zeros(shape), np.zeros(3)
        self._mixing_m2 = (MIXING_LENGTH * grid.middle[2]) ** 2
        self._kept, self._amiss = np.zeros(shape), np.zeros(shape)
        self.solve = Projection(grid)
        self._share, self._explicit = np.zeros(shape), np.zeros((2, *shape))
        self._length = grid.strip_m2 / grid.middle[2]
        self._square = grid.radius_m**2
        self._steps, self._last_s = 0, _FIRST_STEP_S

    @property
    def share(self) -> Floats:
        """Mass fraction of fuel vapour."""
        return np.asarray(self.fuel / self.density)

    @property
    def fuel_kg(self) -> float:
        """Mass of all vapour, with the copies of the cells."""
        return float(np.sum(self.fuel * self.grid.volume_m3) * self.grid.copies)

    def proceed(self, time_s: float, *, mass: Floats, enthalpy: Floats, momentum: Floats) -> None:
        """Advances the gas by a time in steps of its own, with sources that are even in it.

        The sources are those of the whole time, as for `step`.
        """
        sources, left = self._sources(mass, enthalpy, momentum), time_s
        while left > 1e-9 * time_s:
            top = kernels.renewal(self.flux, self.density * self.grid.volume_m3)
            free = min(CFL / top if top > 0 else np.inf, _RISE * self._last_s)
            self._last_s = left / math.ceil(left / free)
            self._step(self._last_s, sources, self._last_s / time_s)
            left -= self._last_s
        fastest = float(np.abs(self.velocity).max())
        if not fastest < _FASTEST_M_S:
            raise SprayError(
                f"the gas flow of the spray is unstable: a speed of {fastest:g} m/s; a finer "
                "spray.box.spacing_m may help"
            )

    def step(self, step_s: float, *, mass: Floats, enthalpy: Floats, momentum: Floats) -> None:
        """Advances the gas by a step, with the sources of the droplets in it.

        Args:
            step_s: length of the step.
            mass: of fuel vapour [kg/m3], of the grid's shape.
            enthalpy: on the mixture's zero [J/m3].
            momentum: (3, ...) in the grid's frame [kg/(s m2)].

        Raises:
            SprayError: the gas is in an impossible state; the flow cannot be computed.
        """
        self._step(step_s, self._sources(mass, enthalpy, momentum), 1.0)

    def _sources(self, mass: Floats, enthalpy: Floats, momentum: Floats) -> _Sources:
        """Sources with their pressure, which is linear in small parts of them."""
        amounts, rise = np.concatenate([mass[None], enthalpy[None], momentum]), np.zeros(mass.size)
        size = np.abs(amounts[:2]).reshape(2, -1)
        some = size > _NOTHING * size.max(axis=1, keepdims=True)
        cells = np.flatnonzero(some.any(axis=0))
        state = (self.density + mass, self.fuel + mass, self.enthalpy + enthalpy)
        density, fuel, heat = (each.reshape(-1)[cells] for each in state)
        guess_K = self.temperature_K.reshape(-1)[cells]
        _, pressure = self._equilibrium(density, fuel, heat, guess_K)
        rise[cells] = pressure / self.pressure_Pa - 1 - self._amiss.reshape(-1)[cells]
        return _Sources(amounts, rise.reshape(mass.shape))

    def _step(self, step_s: float, sources: _Sources, part: float) -> None:
        grid = self.grid
        volume = grid.volume_m3
        kernels.receive(
            sources.amounts, part, self.density, self.fuel, self.enthalpy, self.velocity
        )
        self._amiss += part * sources.rise
        self._eddies()
        viscosity = self.eddy * self.density

        weight = self.density * volume
        self.velocity = self._transported(self.velocity, weight, viscosity, step_s, bounded=False)
        moving = self.velocity * (weight / volume)
        kernels.fluxes(moving, grid.areas, grid.strip_m2, self._square, self.flux)
        wanted = self._kept + self.density * self._amiss / step_s
        force = self._project((wanted - np.average(wanted, weights=volume)) * volume)
        self.pushed_N_s += force.sum(axis=(1, 2, 3))

        exchange = viscosity / TURBULENT_SCHMIDT
        weight = self.density * volume
        fields = np.stack([self.fuel / self.density, self.enthalpy / self.density])
        fields = self._transported(fields, weight, exchange, step_s, bounded=True)
        kernels.finish(weight, volume, fields, force, self.density, moving)
        (self.fuel, self.enthalpy), self.velocity = fields, moving
        self.temperature_K, after = self._equilibrium(
            self.density, self.fuel, self.enthalpy, self.temperature_K
        )
        mean = float(np.average(after, weights=volume))
        self.enthalpy += mean - self.pressure_Pa  # compression, which conserves energy
        self.pressure_Pa = mean
        # Error of the divergence.
        self._amiss = after / mean - 1
        self._kept += self.density * self._amiss / step_s

    def _eddies(self) -> None:
        self._steps += 1
        if self._steps % EDDY_STEPS != 1:
            return
        grid = self.grid
        kernels.shear(
            self.velocity, grid.areas, grid.strip_m2, self._square, grid.volume_m3, self.eddy
        )
        self.eddy *= self._mixing_m2 * (self.far_density_kg_m3 / self.density) ** 1.5

    def _transported(
        self,
        fields: Floats,
        weight: Floats,
        exchange: Floats,
        step_s: float,
        *,
        bounded: bool,
    ) -> Floats:
        """Fields per mass (S, A, P, R) after advection and diffusion by the fluxes in a step.

        `weight`, the mass of the cells, becomes that after the step.
        """
        grid, explicit, amounts = self.grid, self._explicit, fields * weight
        advection.split(self.flux, weight, step_s, MOST_EXPLICIT, self._share, explicit)
        for field, amount in zip(fields, amounts, strict=True):
            advection.carry(
                field,
                explicit[0],
                explicit[1],
                self.flux[2],
                weight,
                exchange,
                grid.angle,
                grid.conductance[2],
                step_s,
                bounded,
                amount,
            )
        advection.settle(amounts, weight, explicit, self.flux, step_s)
        around, down, _ = grid.conductance
        advection.mix(amounts, weight, explicit[1], exchange, down, self._length, step_s, False)
        if weight.shape[0] > 1:
            advection.mix(
                amounts, weight, explicit[0], exchange, around, self._length, step_s, True
            )
        return amounts

    def _equilibrium(
        self, density: Floats, fuel: Floats, enthalpy: Floats, guess_K: Floats
    ) -> tuple[Floats, Floats]:
        """Temperature and pressure of single cells, any shape."""
        if not density.min(initial=1.0) > 0:
            raise SprayError(
                "the gas flow of the spray is unstable: a cell has lost its gas; a finer "
                "spray.box.spacing_m may help"
            )
        found = self.mixture.temperature_K(fuel / density, enthalpy / density, guess_K)
        low, high = float(found.min(initial=300.0)), float(found.max(initial=300.0))
        if not 100 < low <= high < 1500:
            raise SprayError(
                f"the gas flow of the spray is unstable: temperatures from {low:g} to {high:g} K; "
                "a finer spray.box.spacing_m may help"
            )
        return found, self.mixture.pressure_Pa(density=density, fuel=fuel, temperature_K=found)

    def _project(self, wanted: Floats) -> Floats:
        """Gives the mass fluxes the wanted outflow [kg/s]; returns the force on each cell [N s]."""
        grid = self.grid
        amiss = np.empty(grid.shape)
        kernels.outflow(self.flux[0], self.flux[1], self.flux[2], amiss)
        amiss -= wanted
        potential = self.solve(amiss)
        force = np.empty((3, *grid.shape))
        kernels.correct(
            potential,
            grid.areas,
            grid.conductance,
            grid.angle,
            grid.strip_m2,
            self._length,
            self._square,
            self.flux,
            force,
        )
        return force
