"""NumPy twin, in double precision, of the gas on the grid of rays, and devices to compare it with.

Fields have the shape (azimuth, polar angle, radius); vectors one axis more in front.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.buffers import download, upload
from cldit.gpu.device import Device
from cldit.spray.droplet.fluids import fuel_table, gas_table
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.mixture import GasMixture, gas_mixture
from cldit.spray.flow.rays import RayGrid

PRESSURE_Pa, TEMPERATURE_K = 0.6e6, 570.0
JUNK = 3.0  # of padded cells: finite, and of the size of the fields


def pressure_of(gas: GasMixture, density: Floats, fuel: Floats, kelvin: Floats) -> Floats:
    """Pressure from the densities of the mixture and of the vapour in it."""
    return np.asarray(((density - fuel) * gas.carrier_J_kg_K + fuel * gas.vapour_J_kg_K) * kelvin)


def temperature_of(gas: GasMixture, share: Floats, enthalpy_J_kg: Floats) -> Floats:
    """Temperature at an enthalpy, by bisection in the range of the fits."""
    low, high = np.full(share.shape, 150.0), np.full(share.shape, 1200.0)
    for _ in range(60):  # down to rounding
        middle = 0.5 * (low + high)
        above = gas.enthalpy_J_kg(share, middle) > enthalpy_J_kg
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high))


def as_device(device: Device, real: type[np.floating], width: int) -> Device:
    """The device as one of this precision and SIMD width: CPUs have 8, all others 1."""
    kind = "cpu" if width == 8 else "gpu"
    return replace(device, info=replace(device.info, kind=kind, float64=real is np.float64))


def grid_of(kind: str) -> RayGrid:
    """Uneven cells: walls all around, a ring of azimuth, one azimuth, or half a sector."""
    radius = np.asarray(8e-3 * 1.06 ** np.arange(14.0), dtype=np.float64)  # 13 cells in rows of 16
    polar = np.pi / 2 + 0.9 * np.sin(np.linspace(-1.2, 1.2, 8))
    swing = 0.3 * np.sin(np.arange(7.0)) / 7
    around = {
        "walls": (np.linspace(-0.7, 0.6, 7) + 0.2 * swing, 1),
        "ring": (np.linspace(-np.pi, np.pi, 7) + np.where(np.arange(7) % 6, swing, 0.0), 1),
        "round": (np.array([-0.05, 0.05]), 0),
        "sector": (np.linspace(0.0, np.pi / 8, 4), 8),
    }
    azimuth, symmetry = around[kind]
    if kind in ("round", "sector"):
        polar = np.linspace(0.0, 1.9, 8)  # from the axis on
    turn = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [0.1, 1.0, -0.4], [0.3, 0.2, 1.0]]))[0]
    frame = np.asarray(turn * np.sign(np.linalg.det(turn)), dtype=np.float64)
    return RayGrid(frame, radius, polar, azimuth, symmetry)


@cache
def mixture() -> GasMixture:
    """n-heptane and nitrogen."""
    fluids = fuel_table("n-heptane", cache=None), gas_table("nitrogen", cache=None)
    return gas_mixture(*fluids, reference_K=TEMPERATURE_K)


def gas_of(grid: RayGrid, device: Device) -> GasFlow:
    """Gas at rest, in the precision of the device."""
    return GasFlow(
        grid,
        mixture(),
        pressure_Pa=PRESSURE_Pa,
        temperature_K=TEMPERATURE_K,
        device=device,
        real=np.float64 if device.info.float64 else np.float32,
    )


def put(flow: GasFlow, name: str, values: Floats, *, junk: float = JUNK) -> None:
    """Sets all planes of a field, and its padded cells to junk."""
    f, shape = flow.fields, flow.grid.shape
    planes = np.asarray(values).reshape(-1, *shape)
    rows = np.full((len(planes), *shape[:2], f.stride), junk)
    rows[..., : shape[2]] = planes
    guard = np.full((len(planes), (f.cells - rows[0].size) // 2), junk)
    whole = np.concatenate([guard, rows.reshape(len(planes), -1), guard], axis=1)
    flow.arguments[name] = upload(f.device, name, whole.astype(f.real))


def get(flow: GasFlow, name: str, planes: int) -> Floats:
    """All planes of a field (planes, A, P, R)."""
    return np.stack([flow.fields.read(flow.arguments[name], plane) for plane in range(planes)])


def sums_of(flow: GasFlow) -> Floats:
    """The four sums on the device."""
    return download(flow.device, flow.arguments["sums"], np.empty(4, flow.fields.real)).astype(
        float
    )


def launch(flow: GasFlow, file: str, kernel: str, **others: Any) -> None:
    """Runs one kernel on the fields of the gas."""
    flow.fields.bind(f"spray/gas_{file}.cl", kernel, flow.arguments, **others)(
        step=others.get("step", 1.0)
    )


def drawn(flow: GasFlow, *planes: int, low: float = -1.0, high: float = 1.0) -> Floats:
    """Random numbers that the device's precision contains."""
    random = np.random.default_rng(7)
    values = random.uniform(low, high, (*planes, *flow.grid.shape))
    return np.asarray(values.astype(flow.fields.real).astype(float))


def assert_close(found: Floats, wanted: Floats, real: Any, *, roundings: float = 64) -> None:
    """Equal but for so many roundings of the largest number: the sums of a stencil cancel."""
    assert found.shape == wanted.shape
    largest = float(np.abs(wanted).max())
    assert largest > 0
    assert np.abs(found - wanted).max() <= roundings * np.finfo(real).eps * largest


@dataclass(frozen=True)
class Twin:
    """The stencils in plain NumPy."""

    grid: RayGrid

    def at(self, x: Floats, axis: int, jump: int) -> Floats:
        """Values of the cell so many cells on (A, P, R), of the last cell beyond a wall."""
        count = self.grid.shape[axis]
        index = np.arange(count) + jump
        wraps = axis == 0 and self.grid.ring
        index = index % count if wraps else np.clip(index, 0, count - 1)
        return np.take(x, index, axis=x.ndim - 3 + axis)

    def opened(self, axis: int) -> Floats:
        """1 where the lower face of a cell has another cell below, else 0."""
        out = np.ones(self.grid.shape)
        if not (axis == 0 and self.grid.ring):
            np.moveaxis(out, axis, 0)[0] = 0.0
        return out

    def above(self, flux: Floats, axis: int) -> Floats:
        """Flux through the upper face of each cell, from those of the lower faces."""
        wraps = axis == 0 and self.grid.ring
        out = np.roll(flux, -1, axis=axis)
        if not wraps:
            np.moveaxis(out, axis, 0)[-1] = 0.0
        return out

    def outflow(self, flux: Floats) -> Floats:
        """Sum of the fluxes (3, A, P, R) that leave each cell."""
        return np.asarray(np.sum([self.above(flux[a], a) - flux[a] for a in range(3)], axis=0))

    def face(self, axis: int, side: int) -> Floats:
        """Vector area (3, A, P, R) of the lower (0) or upper (1) faces, along the axis."""
        around, down, outward = self.grid.areas
        strip, square = self.grid.strip_m2, self.grid.radius_m**2
        if axis == 0:
            area, size = (around[1:] if side else around[:-1]), strip
        elif axis == 1:
            area, size = (down[:, 1:] if side else down[:, :-1]), strip
        else:
            area, size = outward, (square[1:] if side else square[:-1])
        return np.moveaxis(area, -1, 0)[..., None] * size

    def conductance(self, axis: int) -> Floats:
        """Area over distance of the lower faces (A, P, R)."""
        around, down, outward = self.grid.conductance
        length = self.grid.strip_m2 / self.grid.middle[2]
        if axis == 2:
            return np.asarray(self.grid.angle[:, :, None] * outward)
        return np.asarray((around, down)[axis][:, :, None] * length)

    def mass_fluxes(self, momentum: Floats) -> Floats:
        """Of the lower faces, from momentum per volume (3, A, P, R)."""
        return np.stack(
            [
                self.opened(a)
                * 0.5
                * np.sum(self.face(a, 0) * (momentum + self.at(momentum, a, -1)), axis=0)
                for a in range(3)
            ]
        )

    def gradient_fluxes(self, potential: Floats) -> Floats:
        """Minus the gradient of a potential, times the area of the lower faces."""
        rise = [potential - self.at(potential, a, -1) for a in range(3)]
        return np.stack([-self.conductance(a) * rise[a] for a in range(3)])

    def force(self, potential: Floats) -> Floats:
        """Of the mean potential on the faces of each cell."""
        total = np.zeros((3, *potential.shape))
        for axis in range(3):
            for side, jump in ((0, -1), (1, 1)):
                mean = 0.5 * (potential + self.at(potential, axis, jump))
                total += (1 - 2 * side) * mean * self.face(axis, side)
        return total

    def strain_rate(self, velocity: Floats) -> Floats:
        """sqrt(2 S S), by the theorem of Gauss; no velocity passes a wall."""
        gradient = np.zeros((3, *velocity.shape))  # of component b along a: [a, b]
        for axis in range(3):
            for side, jump in ((0, -1), (1, 1)):
                area = self.face(axis, side)
                part = np.sum(velocity * area, axis=0) / np.sum(area * area, axis=0).clip(1e-300)
                wall = self.opened(axis) == 0 if side == 0 else self.closed_above(axis)
                mean = 0.5 * (velocity + self.at(velocity, axis, jump))
                value = np.where(wall, velocity - part * area, mean)
                gradient += (2 * side - 1) * area[:, None] * value[None]
        strain = 0.5 * (gradient + np.swapaxes(gradient, 0, 1))
        return np.asarray(np.sqrt(2 * np.sum(strain**2, axis=(0, 1))) / self.grid.volume_m3)

    def closed_above(self, axis: int) -> Floats:
        """True where the upper face of a cell is a wall."""
        out = np.zeros(self.grid.shape, dtype=bool)
        if not (axis == 0 and self.grid.ring):
            np.moveaxis(out, axis, 0)[-1] = True
        return out

    def passed_on(self, flux: Floats, axis: int) -> Floats:
        """The larger of all that leaves a cell along an axis, and all that enters."""
        low, high = flux[axis], self.above(flux[axis], axis)
        leaves = np.maximum(high, 0) - np.minimum(low, 0)
        return np.asarray(np.maximum(leaves, np.maximum(low, 0) - np.minimum(high, 0)))

    def carried(
        self, value: Floats, flux: Floats, mass: Floats, along: Floats, step: float, bounded: bool
    ) -> Floats:
        """Fluxes (3, A, P, R) of a field by QUICKEST, limited or not, with diffusion along."""
        out = []
        for axis in range(3):
            low, far = self.at(value, axis, -1), self.at(value, axis, -2)
            beyond, m = self.at(value, axis, 1), flux[axis]
            speed = step * m / (0.5 * (mass + self.at(mass, axis, -1)))
            rise = value - low
            behind = np.where(m >= 0, low - far, beyond - value)
            slope = rise - (1 + np.abs(speed)) / 3 * (rise - behind)
            if bounded:
                most = 2 * np.minimum(np.abs(behind), np.abs(rise))
                size = np.sign(rise) * np.minimum(np.abs(slope), most)
                slope = np.where(behind * rise > 0, size, 0.0)
            up = np.where(m >= 0, low, value)
            part = m * (up + (np.where(m >= 0, 1.0, -1.0) - speed) * 0.5 * slope)
            out.append(part - (along * rise if axis == 2 else 0.0))
        return np.stack(out)

    def mixed(
        self, fields: Floats, mass: Floats, flux: Floats, even: Floats, axis: int
    ) -> tuple[Floats, Floats]:
        """Fields (S, A, P, R) and mass after an implicit step along an axis, by dense matrices.

        flux: of mass through the lower faces in the step; even: exchange of the faces.
        """
        count = self.grid.shape[axis]
        lines = [np.moveaxis(x, x.ndim - 3 + axis, -1) for x in (fields, mass, flux, even)]
        values, heavy, through, mixing = lines
        out, after = values.copy(), heavy.copy()
        first = 0 if axis == 0 and self.grid.ring else 1
        for line in np.ndindex(heavy.shape[:2]):
            matrix = np.diag(heavy[line])
            for n in range(first, count):
                m, below = through[line][n], n - 1
                up = max(mixing[line][n] - 0.5 * m, -m, 0.0)  # weight of the cell above
                matrix[below, below] += up
                matrix[below, n] -= up
                matrix[n, n] += up + m
                matrix[n, below] -= up + m
                after[line][n] += m
                after[line][below] -= m
            right = heavy[line] * values[(slice(None), *line)]
            out[(slice(None), *line)] = np.linalg.solve(matrix, right.T).T
        return np.moveaxis(out, -1, 1 + axis), np.moveaxis(after, -1, axis)
