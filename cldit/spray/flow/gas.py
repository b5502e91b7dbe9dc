"""Gas at low Mach number on the grid of rays, with one pressure.

Mass, fuel, enthalpy and momentum have conservation form. One projection per step corrects the mass
fluxes of the faces such that every cell keeps the common pressure: their divergence is that of the
last step, plus the contributions of the droplets and of the remaining error. The operator is
separable, and is solved directly. Molecular diffusion is neglected (eddies mix much faster), and so
is kinetic energy (Mach number below 0.3), except in jets of gas: their enthalpy is that of gas at
rest, and a mixture moves with its share of the momentum of the jet. Shocks are not resolved.

A step is a fixed list of kernels without a read by the host. Transport is explicit and of third
order up to a CFL number, and implicit beyond (kernels/spray: gas_transport.cl, gas_mixing.cl), so
that the step does not depend on the small cells near the tip.

Eddies have Prandtl's mixing length, a property of the jets and not of the grid, so that a finer
grid resolves the same flow: l = c x at the distance x from the injector, with which a jet spreads
as measured. Tollmien's solution for it has its half width at 1.24 c^(2/3) x (G. N. Abramovich, The
Theory of Turbulent Jets, 1963). The entrainment of a jet depends only on the density of the
surrounding gas (F. P. Ricou and D. B. Spalding, J. Fluid Mech. 11, 21 (1961)): a heavy jet is
narrower, by sqrt(rho_far/rho), and l shorter, by the power 3/2 of it.

The domain is closed, and its pressure follows from its energy.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.gpu.program import Launch
from cldit.spray.flow.mixture import GasMixture
from cldit.spray.flow.projection import Projection
from cldit.spray.flow.ray_fields import Mixing, RayFields
from cldit.spray.flow.rays import RayGrid

HALF_WIDTH = 0.085  # of a free jet, over the distance
MIXING_LENGTH = (HALF_WIDTH / 1.24) ** 1.5  # of the distance from the injector
TURBULENT_SCHMIDT = 0.7  # and Prandtl number, of a round jet
MOST_EXPLICIT = 0.7  # CFL number of explicit fluxes, summed over the axes; they are stable below 1
ALONG_EXPLICIT = 0.5  # the same along the rays
DIFFUSED_EXPLICIT = 0.125  # share of a cell's mass that explicit diffusion exchanges at a face


class UnstableGas(SprayError):
    """The gas is faster than what drives it, so that its steps are too long."""


class GasFlow:
    """State of the gas on a device, which `step` advances.

    arguments: those of kernels by name. Among them is the state, which `read` copies: density, fuel
    (vapour) kg/m3, enthalpy J/m3 on the zero of the mixture, temperature K; velocity (3 planes) in
    the grid's frame; eddy, the turbulent viscosity in m2/s; and amounts (5 planes), the sources of
    a step per volume: mass, enthalpy, momentum.
    fastest_m_s: of what drives the gas; `check` refuses a gas that is faster.
    jet_speed_m_s: of jets of gas, whose enthalpy is that at rest; 0: there are none.
    """

    def __init__(
        self,
        grid: RayGrid,
        mixture: GasMixture,
        *,
        pressure_Pa: float,
        temperature_K: float,
        device: Device,
        mixing_length: float = MIXING_LENGTH,
        fastest_m_s: float = 1e3,
        jet_speed_m_s: float = 0.0,
        real: type[np.floating] = np.float32,
    ) -> None:
        self.fastest_m_s = fastest_m_s
        self.grid, self.mixture, self.device = grid, mixture, device
        self.fields = fields = RayFields(grid, device, real)
        self.far_density_kg_m3 = pressure_Pa / (mixture.carrier_J_kg_K * temperature_K)
        start = float(mixture.enthalpy_J_kg(np.zeros(1), np.array([temperature_K]))[0])
        density = self.far_density_kg_m3
        self.fuel, self.amounts = fields.plane("fuel"), fields.plane("amounts", 5)
        self._solve, self.mixing = Projection(fields), Mixing(fields)
        self.sums = fields.table("sums", np.array([pressure_Pa, pressure_Pa, 0.0, 0.0]))
        self.arguments = self._tables(mixing_length) | {
            "density": fields.plane("density", value=density),
            "enthalpy": fields.plane("enthalpy", value=density * start),
            "temperature": fields.plane("temperature", value=temperature_K),
            "fuel": self.fuel,
            "amounts": self.amounts,
            "common": self.sums,
            "sums": self.sums,
            "far_density": density,
            "jet_speed": jet_speed_m_s,
            "step": 1.0,
            "part": 1.0,
            "azimuths": grid.shape[0],
            "polars": grid.shape[1],
            "stride": fields.stride,
            "periodic": int(grid.ring),
            "cells": fields.cells,
        }
        planes = {"velocity": 3, "flux": 3, "force": 3, "share": 2, "explicit_flux": 3, "rest": 3}
        planes |= {"eddy": 1, "diffusion": 2, "fluxes": 9, "values": 2}
        planes |= dict.fromkeys(("exchange", "mass", "carried", "after", "kept", "amiss"), 1)
        planes |= dict.fromkeys(("rise", "potential", "own"), 1)
        self.arguments |= {name: fields.plane(name, count) for name, count in planes.items()}
        self._source_pressure = self._bind("sources", "source_pressure")
        self._steps = self._launches()

    def _tables(self, mixing_length: float) -> dict[str, Any]:
        """Tables of the geometry and of the mixture, by the names of kernels' arguments."""
        grid, fields, gas = self.grid, self.fields, self.mixture
        radii, radius = grid.shape[2], grid.radius_m
        shell = np.diff(radius**3) / 3
        ratio = np.concatenate([[1.0], shell[1:] / shell[:-1]])
        place = np.arange(radii)
        azimuthal, downward, outward = grid.areas
        gases: list[Any] = [
            [gas.reference_K, gas.carrier_J_kg_K, gas.vapour_J_kg_K],
            gas.carrier,
            gas.vapour,
        ]
        tables = {
            "angle": grid.angle,
            "around": azimuthal,
            "downward": downward,
            "outward": outward,
            "conductance_around": grid.conductance[0],
            "conductance_down": grid.conductance[1],
            "mixture": np.concatenate(gases),
        }
        rows = {
            "strip": grid.strip_m2,
            "square": radius**2,
            "length": grid.strip_m2 / grid.middle[2],
            "conductance": grid.conductance[2],
            "open_below": place > 0,
            "open_second": place > 1,
            "open_above": place + 1 < radii,
            "inside": place >= 0,
            "mixing_length": (mixing_length * grid.middle[2]) ** 2,
        }
        ones = {"shell": shell, "shell_ratio": ratio}
        return (
            {name: fields.table(name, table) for name, table in tables.items()}
            | {name: fields.row(name, row) for name, row in rows.items()}
            | {name: fields.row(name, row, padded=1.0) for name, row in ones.items()}
        )

    def _bind(self, name: str, kernel: str, **arguments: Any) -> Launch:
        return self.fields.bind(f"spray/gas_{name}.cl", kernel, self.arguments, **arguments)

    def _launches(self) -> list[Launch]:
        """Kernels of a step in order."""
        arguments, volume_m3 = self.arguments, float(self.grid.volume_m3.sum())
        potential = arguments["potential"]
        return [
            self._bind("sources", "receive"),
            self._bind("eddies", "eddies"),
            *self._transport(
                arguments["velocity"], 3, updated=arguments["carried"], mixing=1.0, bounded=0
            ),
            self._bind("projection", "mass_fluxes", mass=arguments["carried"]),
            self._bind("projection", "imbalance"),
            self._add_up(potential, 2, 1.0),
            self._bind("projection", "balance", whole=volume_m3),
            *self._solve.launches(potential),
            self._bind("projection", "correct"),
            self._bind("state", "per_mass"),
            *self._transport(
                arguments["values"],
                2,
                updated=arguments["after"],
                mixing=1 / TURBULENT_SCHMIDT,
                bounded=1,
            ),
            self._bind("state", "finish"),
            self._add_up(arguments["own"], 0, 1.0 / volume_m3),
            self._bind("state", "compress"),
        ]

    def _transport(
        self, values: Any, kinds: int, *, updated: Any, mixing: float, bounded: int
    ) -> list[Launch]:
        """Kernels that carry fields per mass in a step; `after` becomes the mass of the cells."""
        arguments, rest = self.arguments, self.arguments["rest"]
        exchange = (arguments["exchange"], arguments["exchange"])

        common = {"values": values, "after": updated, "bounded": bounded, "mixing": mixing}
        common |= {"limit": MOST_EXPLICIT, "limit_along": ALONG_EXPLICIT}
        common |= {"most_diffused": DIFFUSED_EXPLICIT}

        def bind(kernel: str, fields: int) -> Launch:
            return self._bind("transport", kernel, kinds=fields, **common)

        return [
            bind("shares", 1),
            bind("divide", 1),
            bind("face_fluxes", kinds),
            bind("settle_mass", 1),
            bind("settle", kinds),
            *self.mixing.launches(
                values, kinds, mass=updated, flux=rest, exchange=exchange, factor=mixing
            ),
            self.mixing.along(
                values, kinds, mass=updated, flux=rest, diffusions=arguments["diffusion"]
            ),
        ]

    def _add_up(self, plane: Any, place: int, scale: float) -> Launch:
        azimuths, polars, radii = self.grid.shape
        size = {"rays": azimuths * polars, "radii": radii, "stride": self.fields.stride}
        arguments = {"plane": plane, "sums": self.sums, "place": place, "scale": scale, **size}
        return self.fields.program("spray/gas_state.cl").bind("add_up", (64,), (64,), arguments)

    @property
    def pressure_Pa(self) -> float:
        """The common pressure."""
        return float(download(self.device, self.sums, np.empty(4, self.fields.real))[0])

    def read(self, name: str) -> Floats:
        """A field, (A, P, R), or (3, A, P, R) of a vector; `share` is the vapour's, by mass."""
        if name == "share":
            return np.asarray(self.read("fuel") / self.read("density"))
        if name in ("velocity", "force"):
            return self.fields.read_planes(self.arguments[name], 3)
        return self.fields.read(self.arguments[name])

    def write(self, name: str, values: Floats, plane: int = 0) -> None:
        """Sets a field, or one of its planes, to values (A, P, R)."""
        self.fields.write(self.arguments[name], values, plane)

    @property
    def fuel_kg(self) -> float:
        """Mass of all vapour, with the copies of the cells."""
        return float(np.sum(self.read("fuel") * self.grid.volume_m3) * self.grid.copies)

    def step(self, time_s: float, *, steps: int = 1) -> None:
        """Advances the gas by a time, with the sources of the whole time in `amounts`."""
        self._source_pressure()
        for _ in range(steps):
            for launch in self._steps:
                launch(step=time_s / steps, part=1.0 / steps)

    def check(self) -> None:
        """Raises UnstableGas if the gas is in an impossible state; reads from the device."""
        fastest = float(np.abs(self.read("velocity")).max())
        if not fastest <= self.fastest_m_s:
            raise UnstableGas(
                f"the gas flow of the spray is unstable: a speed of {fastest:g} m/s, where its "
                f"liquid has {self.fastest_m_s:g} m/s at most; a finer spray.box.spacing_m may help"
            )
