"""A jet of gas alone, as the flow's eddies make it: against what is measured of round jets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.gpu.device import Device
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.mixture import GasMixture
from cldit.spray.flow.ray_choice import round_grid

THRUST_N = 0.3  # as of a plume of the ECN's Spray G
_SOURCE_m = 8e-3  # from the injector's place: there the jet gets its momentum and its width
_END_s, _STEP_s = 1.5e-3, 5e-6


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
    device: Device,
    *,
    spacing_m: float,
    fuel_kg_s: float = 0.0,
    distances_m: tuple[float, ...] = (20e-3, 25e-3, 30e-3),
) -> FreeJet:
    """Nitrogen of 0.6 MPa, pushed by `THRUST_N` from 8 mm on, with or without cold fuel vapour."""
    grid = round_grid(np.array([0.0, 0.0, -1.0]), spacing_m=spacing_m, reach_m=80e-3, far_m=80e-3)
    flow = GasFlow(grid, mixture, pressure_Pa=0.6e6, temperature_K=573.0, device=device)
    radius, polar = grid.middle[2], grid.middle[1]
    wide = np.exp(-0.5 * (polar / 0.07) ** 2)
    along = np.exp(-0.5 * ((radius - _SOURCE_m) / 1e-3) ** 2)
    source = np.broadcast_to(wide[:, None] * along, grid.shape)
    source = source / (np.sum(source * grid.volume_m3) * grid.copies)
    mass = source * fuel_kg_s * _STEP_s
    flow.write("amounts", mass, 0)
    flow.write("amounts", -9e5 * mass, 1)
    flow.write("amounts", source * THRUST_N * _STEP_s, 4)  # the grid's third axis is the jet's
    for _ in range(round(_END_s / _STEP_s)):
        flow.step(_STEP_s)
    flow.check()
    density, outward = flow.read("density"), flow.fields.read(flow.arguments["flux"], 2)
    around = flow.far_density_kg_m3
    rows: list[tuple[float, float, float, float]] = []
    for distance in distances_m:
        i = int(np.argmin(np.abs(grid.radius_m - distance)))
        x = float(grid.radius_m[i])
        flux = outward[0, :, i]
        speed = flux / (x**2 * grid.angle[0]) / density[0, :, i - 1 : i + 1].mean(axis=1)
        # On the axis by the parabola through the first two rays.
        first, second = polar[:2] ** 2
        top = float(speed[0] + (speed[0] - speed[1]) * first / (second - first))
        half = float(np.interp(-0.5 * top, -speed, x * np.tan(polar)))
        within = (flux > 0) & (np.tan(polar) < 0.35)
        rows.append(
            (
                half / x,
                float(flux[within].sum()) * grid.copies / (float(np.sqrt(around * THRUST_N)) * x),
                top * x / float(np.sqrt(THRUST_N / around)),
                float(density[0, 0, i]) / around,
            )
        )
    return FreeJet(distances_m, *(tuple(column) for column in zip(*rows, strict=True)))
