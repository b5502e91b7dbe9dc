"""Gas at low Mach number on a coarse Cartesian grid, with one pressure.

Mass, fuel, enthalpy and momentum have conservation form (`kernels`). One projection per step with
constant coefficients (cosine or Fourier transforms) corrects the mass fluxes such that every cell
keeps the common pressure: their divergence is that of the last step, plus the contributions of the
droplets and of the remaining error. Kinetic energy and molecular diffusion are neglected (Mach
number below 0.3; eddies mix much faster).

Eddies have Prandtl's mixing length, a property of the jets and not of the grid, so that a finer
grid resolves the same flow: l = c x at the distance x from the injector, with which a jet spreads
as measured. Tollmien's solution for it has its half width at 1.24 c^(2/3) x (G. N. Abramovich, The
Theory of Turbulent Jets, 1963). The entrainment of a jet depends only on the density of the
surrounding gas (F. P. Ricou and D. B. Spalding, J. Fluid Mech. 11, 21 (1961)): a heavy jet is
narrower, by sqrt(rho_far/rho), and l shorter, by the power 3/2 of it.

The box is closed, and its pressure follows from its energy; or it is periodic, for tests.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn, irfftn, rfftn

from cldit.errors import SprayError
from cldit.spray.flow import advection, kernels
from cldit.spray.flow.gasjet import HALF_WIDTH
from cldit.spray.flow.mixture import GasMixture

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIXING_LENGTH = (HALF_WIDTH / 1.24) ** 1.5  # of the distance from the injector
TURBULENT_SCHMIDT = 0.7  # and Prandtl number, of a round jet
CFL = 0.7  # summed over the three axes; the scheme is stable below 1
DIFFUSION = 0.1  # largest share of a cell that eddies exchange with each neighbour in a step
EDDY_STEPS = 4  # between two computations of the shear
THREADS = min(os.cpu_count() or 1, 8)


@dataclass(frozen=True)
class FlowGrid:
    """Grid of the gas: `origin_m` (3,) is the lower corner, from the injector's tip."""

    origin_m: Floats
    spacing_m: float
    shape: tuple[int, int, int]
    closed: bool = True

    @property
    def upper_m(self) -> Floats:
        """Upper corner (3,)."""
        return np.asarray(self.origin_m + self.spacing_m * np.array(self.shape))

    @property
    def cell_m3(self) -> float:
        """Volume of a cell."""
        return self.spacing_m**3


class GasFlow:
    """State of the gas, which `step` advances.

    Attributes are arrays of the box's shape: density, fuel (vapour) kg/m3, enthalpy J/m3 on the
    zero of the mixture, temperature_K; flux (3, ...) kg/(m2 s) through the lower faces, velocity
    (3, ...) there; eddy, the turbulent viscosity in m2/s. pressure_Pa is one number.
    """

    def __init__(
        self, box: FlowGrid, mixture: GasMixture, *, pressure_Pa: float, temperature_K: float
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
        self._mixing_m2, self._diffusing = MIXING_LENGTH**2 * _square_distance_m2(box), 0.0
        self._kept, self._amiss = np.zeros(shape), np.zeros(shape)
        self._wave = _eigenvalues(box)
        self._top, self._steps, self._moving = 0.0, 0, (0, shape[0])
        self._low, self._high = np.zeros(3, dtype=np.int64), np.array(shape)
        self._pushed, self._middle = np.zeros((3, *shape)), np.zeros((3, *shape))

    @property
    def share(self) -> Floats:
        """Mass fraction of fuel vapour."""
        return np.asarray(self.fuel / self.density)

    def longest_step_s(self) -> float:
        """Longest step by the CFL number and by the mixing of eddies; infinite in gas at rest."""
        h = self.box.spacing_m
        flowing = CFL * h / self._top if self._top > 0 else np.inf
        return min(flowing, DIFFUSION * h**2 / self._diffusing if self._diffusing > 0 else np.inf)

    def step(self, step_s: float, *, mass: Floats, enthalpy: Floats, momentum: Floats) -> None:
        """Advances the gas by a step, with the sources of the droplets in it.

        Args:
            step_s: length of the step.
            mass: (X, Y, Z) of fuel vapour [kg/m3].
            enthalpy: (X, Y, Z) on the mixture's zero [J/m3].
            momentum: (3, X, Y, Z) for the faces [kg/(s m2)].

        Raises:
            SprayError: the gas is in an impossible state; the flow cannot be computed.
        """
        self.density = self.density + mass
        self.fuel = self.fuel + mass
        self.enthalpy = self.enthalpy + enthalpy
        changed = np.flatnonzero(enthalpy)
        amiss = self._amiss
        amiss.reshape(-1)[changed] = self._pressures(changed) / self.pressure_Pa - 1

        kernels.velocities(self.flux, self.density, self.velocity)
        self._bounds()
        with ThreadPoolExecutor(THREADS) as pool:
            self._eddies(pool)
            viscosity = self.eddy * self.density
            flux = self._push(step_s, viscosity, momentum, pool)
            wanted = self._kept + self.density * amiss / step_s
            self._project(flux, wanted - wanted.mean())
            self._carry(step_s, viscosity / TURBULENT_SCHMIDT, pool)
            after = self._pressures(None, pool)
        mean = float(after.mean())
        self.enthalpy += mean - self.pressure_Pa  # compression, which conserves energy
        self.pressure_Pa = mean
        # Error of the divergence.
        self._amiss = after / mean - 1
        self._kept += self.density * self._amiss / step_s
        kernels.velocities(self.flux, self.density, self.velocity)
        self._bounds()

    def _slabs(self, low: int, high: int) -> list[tuple[int, int]]:
        """Slabs of the first axis, one for each thread."""
        cuts = np.linspace(low, high, min(THREADS, max(high - low, 1)) + 1).astype(int).tolist()
        return list(pairwise(cuts))

    def _eddies(self, pool: ThreadPoolExecutor) -> None:
        self._steps += 1
        if self._steps % EDDY_STEPS != 1:
            return
        h = self.box.spacing_m
        kernels.centred(self.velocity, self._middle)

        def shear(slab: tuple[int, int]) -> None:
            kernels.shear(self._middle, h, self.box.closed, *slab, self.eddy)

        list(pool.map(shear, self._slabs(*self._moving)))
        self.eddy *= self._mixing_m2 * (self.far_density_kg_m3 / self.density) ** 1.5
        self._diffusing = float(self.eddy.max()) / TURBULENT_SCHMIDT

    def _push(
        self, step_s: float, viscosity: Floats, momentum: Floats, pool: ThreadPoolExecutor
    ) -> Floats:
        """Mass fluxes after advection, eddies and momentum of the droplets, not yet projected."""
        box, (low, high) = self.box, self._moving
        pushed = self._pushed
        for still in (slice(0, low), slice(high, None)):
            np.add(self.flux[:, still], momentum[:, still], out=pushed[:, still])

        def push(work: tuple[int, tuple[int, int]]) -> None:
            axis, slab = work
            advection.push(
                axis,
                self.velocity[axis],
                self.flux,
                self.density,
                viscosity,
                momentum[axis],
                step_s,
                box.spacing_m,
                box.closed,
                *slab,
                pushed[axis],
            )

        list(pool.map(push, product(range(3), self._slabs(low, high))))
        if box.closed:
            pushed[0, 0], pushed[1, :, 0], pushed[2, :, :, 0] = 0.0, 0.0, 0.0
        self.flux, self._pushed = pushed, self.flux
        return pushed

    def _bounds(self) -> None:
        """Determines the fastest gas, and the moving cells along the first axis."""
        self._top = kernels.busy(self.velocity, self._low, self._high)
        count = self.box.shape[0]
        if self.box.closed:
            low, high = max(int(self._low[0]) - 2, 0), min(int(self._high[0]) + 2, count)
            self._moving = (low, max(low, high))
        else:
            self._moving = (0, count)

    def _carry(self, step_s: float, exchange: Floats, pool: ThreadPoolExecutor) -> None:
        """Transports mass, fuel and enthalpy by the fluxes, fuel and enthalpy also by eddies."""
        fields = np.stack([self.fuel / self.density, self.enthalpy / self.density])
        change = np.zeros_like(fields)
        h, closed = self.box.spacing_m, self.box.closed

        def carry(slab: tuple[int, int]) -> None:
            advection.carry(
                fields, self.flux, self.density, exchange, step_s, h, closed, *slab, change
            )

        list(pool.map(carry, self._slabs(0, self.box.shape[0])))
        out = np.empty_like(self.density)
        kernels.divergence(self.flux, h, out)
        out *= step_s
        self.density -= out
        self.fuel += change[0]
        self.enthalpy += change[1]

    def _pressures(self, chosen: Ints | None, pool: ThreadPoolExecutor | None = None) -> Floats:
        """Pressure of each single cell, or of those chosen (flat); also sets temperatures."""
        every = slice(None) if chosen is None else chosen
        density, fuel = self.density.reshape(-1)[every], self.fuel.reshape(-1)[every]
        if not density.min(initial=1.0) > 0:
            raise SprayError(
                "the gas flow of the spray is unstable: a cell has lost its gas; a finer "
                "spray.box.spacing_m may help"
            )
        heat, warm = self.enthalpy.reshape(-1)[every], self.temperature_K.reshape(-1)
        found, pressure = warm[every].copy(), np.empty_like(density)

        def solve(part: slice) -> None:
            rho, y = density[part], fuel[part] / density[part]
            found[part] = self.mixture.temperature_K(y, heat[part] / rho, found[part])
            pressure[part] = self.mixture.pressure_Pa(
                density=rho, fuel=fuel[part], temperature_K=found[part]
            )

        if pool is None:
            solve(slice(None))
        else:
            list(pool.map(solve, [slice(*slab) for slab in self._slabs(0, len(density))]))
        low, high = float(found.min(initial=300.0)), float(found.max(initial=300.0))
        if not 100 < low <= high < 1500:
            raise SprayError(
                f"the gas flow of the spray is unstable: temperatures from {low:g} to {high:g} K; "
                "a finer spray.box.spacing_m may help"
            )
        warm[every] = found
        return pressure.reshape(self.box.shape) if chosen is None else pressure

    def _project(self, flux: Floats, wanted: Floats) -> None:
        """Projects the mass fluxes on the nearest ones of the wanted divergence."""
        h = self.box.spacing_m
        amiss = np.empty_like(wanted)
        kernels.divergence(flux, h, amiss)
        amiss -= wanted
        if self.box.closed:
            potential = idctn(
                dctn(amiss, workers=THREADS, overwrite_x=True) / self._wave,
                workers=THREADS,
                overwrite_x=True,
            )
        else:
            potential = irfftn(
                rfftn(amiss, workers=THREADS) / self._wave, s=self.box.shape, workers=THREADS
            )
        kernels.subtract_gradient(np.asarray(potential), h, self.box.closed, flux)


def _square_distance_m2(box: FlowGrid) -> Floats:
    """Square distance of the cells' middles from the injector's tip, of the box's shape."""
    middles = [
        low + (np.arange(count) + 0.5) * box.spacing_m
        for low, count in zip(box.origin_m, box.shape, strict=True)
    ]
    return np.asarray(sum(each**2 for each in np.meshgrid(*middles, indexing="ij")))


def _eigenvalues(box: FlowGrid) -> Floats:
    """Eigenvalues of the seven-point Laplacian; infinite for the mean, which has no gradient."""
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
