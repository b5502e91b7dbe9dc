"""A jet of gas alone, as the flow's eddies make it: against what is measured of round jets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.spray.flow.gas import FlowGrid, GasFlow
from cldit.spray.flow.mixture import GasMixture

Floats = NDArray[np.float64]

THRUST_N = 0.3  # as of a plume of the ECN's Spray G
_SOURCE_m = 8e-3  # below the injector's place: there the jet gets its momentum and its width
_END_s = 1.5e-3
_ACROSS_m, _BELOW_m = 36e-3, 56e-3


@dataclass(frozen=True)
class FreeJet:
    """At distances x (N,) from where the jet would begin: half width over x, mass flux over
    sqrt(rho thrust) x, speed on the axis times x over sqrt(thrust / rho), where rho is that of the
    gas around, and density on the axis over it."""

    distance_m: tuple[float, ...]
    half_width: tuple[float, ...]
    entrainment: tuple[float, ...]
    decay: tuple[float, ...]
    density: tuple[float, ...]


def free_jet(
    mixture: GasMixture,
    *,
    spacing_m: float,
    fuel_kg_s: float = 0.0,
    distances_m: tuple[float, ...] = (20e-3, 25e-3, 30e-3),
) -> FreeJet:
    """Nitrogen of 0.6 MPa, pushed by `THRUST_N` from 8 mm on, with or without cold fuel vapour."""
    count = round(_ACROSS_m / spacing_m)
    origin = np.array([-0.5 * count * spacing_m] * 2 + [-_BELOW_m])
    box = FlowGrid(origin, spacing_m, (count, count, round((_BELOW_m + 4e-3) / spacing_m)))
    flow = GasFlow(box, mixture, pressure_Pa=0.6e6, temperature_K=573.0)
    x = origin[0] + (np.arange(count) + 0.5) * spacing_m
    z = origin[2] + np.arange(box.shape[2]) * spacing_m  # low faces
    aside = np.hypot(*np.meshgrid(x, x, indexing="ij"))
    wide = np.exp(-0.5 * (aside / (0.07 * _SOURCE_m)) ** 2)

    def source(height: Floats) -> Floats:
        along = np.exp(-0.5 * ((height + _SOURCE_m) / 1e-3) ** 2)
        shape = wide[:, :, None] * along
        return np.asarray(shape / (shape.sum() * box.cell_m3))

    push, feed = source(z), source(z + 0.5 * spacing_m)
    time, still = 0.0, np.zeros((3, *box.shape))
    while time < _END_s:
        step = min(flow.longest_step_s(), 5e-6)
        momentum, mass = still.copy(), feed * fuel_kg_s * step
        momentum[2] = -push * THRUST_N * step
        flow.step(step, mass=mass, enthalpy=-9e5 * mass, momentum=momentum)
        time += step
    around = flow.far_density_kg_m3
    rows: list[tuple[float, float, float, float]] = []
    for distance in distances_m:
        k = round((-distance - origin[2]) / spacing_m)  # the face at that height
        speed = -flow.velocity[2, :, :, k]
        middle = slice(count // 2 - 1, count // 2 + 1)
        line = speed[:, middle].mean(axis=1)[count // 2 :]
        top = float(speed.max())
        half = float(np.interp(-0.5 * top, -line, x[count // 2 :]))
        down = np.where((speed > 0) & (aside < 0.35 * distance), -flow.flux[2, :, :, k], 0.0)
        flux = float(down.sum()) * spacing_m**2
        rows.append(
            (
                half / distance,
                flux / (float(np.sqrt(around * THRUST_N)) * distance),
                top * distance / float(np.sqrt(THRUST_N / around)),
                float(flow.density[middle, middle, k].mean()) / around,
            )
        )
    return FreeJet(distances_m, *(tuple(column) for column in zip(*rows, strict=True)))
