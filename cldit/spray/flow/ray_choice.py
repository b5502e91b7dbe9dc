"""Choice of the grid of rays for an injector."""

from __future__ import annotations

import math

import numpy as np

from cldit.arrays import Floats
from cldit.constants import GAS_CONSTANT_J_mol_K
from cldit.errors import SprayError
from cldit.scene.spray import LagrangianSpray, Plume
from cldit.spray.cone.jet import NABER_SIEBERS, Jet
from cldit.spray.cone.nozzle import plume_axis
from cldit.spray.flow.injector import Injection
from cldit.spray.flow.rays import RayGrid

SPACING_AT_m = 25e-3  # distance at which a cell across the rays has the scene's spacing
NOSE_m = 1e-3  # radius of the tip, in which there is no gas
MOST_CELLS = 2e7
DEPTH_KEY = "spray.box.depth_m"
_LEAST_DEPTH_m = 5e-3  # the shortest reach of a plume, see `_reach_m`
# Cell along the ray. Near the tip equal plumes touch: their gas is the same with half of it, not
# with twice.
_SHORTEST_m = 0.25e-3
_BESIDE = 0.35  # angle beside a plume with fine cells; its edge is at half of it
_GROWTH = 1.12  # of cells beyond
_BEHIND = np.radians(115.0)  # of the injector's axis, up to where there is gas
_POLE = np.radians(15.0)
_NEAREST_POLE = np.radians(3.0)
_FIRST_TIME_S = 1.25e-3  # up to which all times have one domain; later ones double it
_FEWEST = 3  # cells between planes of symmetry


def symmetry(plumes: tuple[Plume, ...]) -> int:
    """Number of equal plumes at equal angles about the injector's axis; 0: one axis; else 1."""
    axes = np.array([plume_axis(plume) for plume in plumes])
    if np.allclose(axes, axes[0], atol=1e-6):
        return 0
    azimuth_deg, count = plumes[0].azimuth_deg, len(plumes)
    turn = np.sort([(plume.azimuth_deg - azimuth_deg + 1e-6) % 360 for plume in plumes])
    turned = [plume.model_copy(update={"azimuth_deg": azimuth_deg}) for plume in plumes]
    same = all(plume == plumes[0] for plume in turned)
    even = np.allclose(turn, 360 / count * np.arange(count), atol=1e-4)
    return count if same and even else 1


def ray_grid(spec: LagrangianSpray, injection: Injection, *, gas_kg_mol: float) -> RayGrid:
    """Grid for the plumes of `spec` in a gas of this molar mass.

    Raises SprayError if there are too many cells.
    """
    h = spec.box.cell_m / SPACING_AT_m
    axes = injection.axes
    kind, axis = symmetry(spec.plumes), axes[0]
    if spec.droplets is None and kind == 1:  # jets on the axis of equal ones
        aside = tuple(plume for plume in spec.plumes if plume.inclination_deg > 0)
        kind, axis = symmetry(aside) or 1, plume_axis(aside[0])
    reach_m, far_m = _reach_m(spec, injection, gas_kg_mol)
    if kind == 0:
        return round_grid(axes[0], spacing_m=spec.box.cell_m, reach_m=reach_m, far_m=far_m)
    radius = _radii(h, reach_m, far_m)
    if kind > 1:
        down = np.array([0.0, 0.0, -1.0])
        lean = float(np.arccos(axis @ down))
        low = max(lean - _BESIDE, 0.0) if kind == len(axes) else 0.0
        polar = _fine(low, lean + _BESIDE, h, 0.0, max(_BEHIND, lean + 0.4))
        count = max(_FEWEST, int(np.ceil(np.pi / kind * np.sin(lean) / h)))
        azimuth = np.linspace(0.0, np.pi / kind, count + 1)
        return _checked(RayGrid(_frame(down, axis), radius, polar, azimuth, kind), spec)
    down = np.array([0.0, 0.0, -1.0])
    leans = np.arccos(np.clip(axes @ down, -1.0, 1.0))
    # Plumes beside a pole on the injector's axis.
    if leans.min() >= np.radians(15.0):
        # A full circle of azimuth, in which every plume flows along a line of the grid.
        low, high = max(float(leans.min()) - _BESIDE, 0.0), float(leans.max()) + _BESIDE
        polar = _fine(low, high, h, 0.0, max(_BEHIND, high + 0.05))
        count = int(np.ceil(2 * np.pi * np.sin(min(float(leans.max()), np.pi / 2)) / h))
        azimuth = np.linspace(-np.pi, np.pi, max(count, _FEWEST) + 1)
        return _checked(RayGrid(_frame(down), radius, polar, azimuth, 1), spec)
    # The pole across the injector's axis that is farthest from all plumes.
    turns = np.radians(np.arange(0.0, 180.0, 5.0))
    poles = np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=1)
    pole = poles[np.argmin(np.abs(poles @ axes.T).max(axis=1))]
    frame = _frame(pole, np.array([0.0, 0.0, -1.0]))
    local = axes @ frame.T
    polar = np.arccos(local[:, 2])
    azimuth = np.arctan2(local[:, 1], local[:, 0])
    low, high = float(polar.min()), float(polar.max())
    nearest = min(low, np.pi - high)
    if nearest < _NEAREST_POLE + 0.1:
        raise SprayError(
            "spray.plumes: no direction across the injector's axis is 9 degrees away from all "
            "plumes; allowed: smaller inclinations"
        )
    edge = max(min(_POLE, nearest - _BESIDE), _NEAREST_POLE)
    polar = _fine(low - _BESIDE, high + _BESIDE, h, edge, np.pi - edge)
    side = _fine(azimuth.min() - _BESIDE, azimuth.max() + _BESIDE, h, -_BEHIND, _BEHIND)
    return _checked(RayGrid(frame, radius, polar, side, 1), spec)


def round_grid(axis: Floats, *, spacing_m: float, reach_m: float, far_m: float) -> RayGrid:
    """Grid of one plume, which stays within `reach_m`."""
    h, sector = spacing_m / SPACING_AT_m, np.pi / 64
    polar = _fine(0.0, _BESIDE, h, 0.0, _BEHIND)
    radius = _radii(h, reach_m, far_m)
    return RayGrid(_frame(axis), radius, polar, np.array([-sector, sector]), 0)


def _checked(grid: RayGrid, spec: LagrangianSpray) -> RayGrid:
    cells = float(np.prod(grid.shape))
    if cells > MOST_CELLS:
        minimum = spec.box.cell_m * (cells / MOST_CELLS) ** (1 / 3)
        raise SprayError(
            f"spray.box.spacing_m: {spec.box.cell_m:g} gives {cells:.3g} cells; at least "
            f"{minimum:.2g}"
        )
    return grid


def domain_time_s(spec: LagrangianSpray) -> float:
    """Time for which the domain is large enough; times up to it have the same domain."""
    doubled = max(0, math.ceil(math.log2(spec.time_s / _FIRST_TIME_S)))
    return float(_FIRST_TIME_S * 2.0**doubled)


def _reach_m(spec: LagrangianSpray, injection: Injection, gas_kg_mol: float) -> tuple[float, float]:
    """Distance that the plumes stay within, and radius of the domain: half as far again."""
    ambient = spec.ambient
    gas = ambient.pressure_Pa * gas_kg_mol / (GAS_CONSTANT_J_mol_K * ambient.temperature_K)
    reach = _LEAST_DEPTH_m
    for plume, diameter_m in zip(spec.plumes, injection.jet_diameter_m.tolist(), strict=True):
        if not diameter_m > 0:
            continue
        area = np.pi / 4 * diameter_m**2
        jet = Jet(
            rate_kg_s=area * injection.density_kg_m3 * injection.speed_m_s,
            speed_m_s=injection.speed_m_s,
            half_angle_rad=float(np.radians(plume.cone_angle_deg / 2)),
            fuel_kg_m3=injection.density_kg_m3,
            gas_kg_m3=gas,
            spreading=NABER_SIEBERS,
        )
        reach = max(reach, jet.tip_m(domain_time_s(spec)))
    far_m = 1.6 * reach + _LEAST_DEPTH_m if spec.box.depth_m is None else spec.box.depth_m
    if far_m < _LEAST_DEPTH_m:
        raise SprayError(f"{DEPTH_KEY}: {far_m:g}; allowed: {_LEAST_DEPTH_m:g} and more")
    # Naber and Siebers' penetration; one plume alone in hot, thin gas has 1.12 times it.
    return 1.15 * reach, far_m


def _frame(pole: Floats, towards: Floats | None = None) -> Floats:
    """Local axes: the pole last, and the first one towards `towards`."""
    if towards is None:
        towards = np.eye(3)[np.argmin(np.abs(pole))]
    x_axis = towards - (towards @ pole) * pole
    x_axis /= np.linalg.norm(x_axis)
    return np.array([x_axis, np.cross(pole, x_axis), pole])


def _radii(growth: float, reach_m: float, far_m: float) -> Floats:
    """Faces along the rays, of cells as long as wide; beyond the plumes' reach they grow faster."""
    radii, longer = [NOSE_m], 1.0
    while radii[-1] < far_m:
        longer *= _GROWTH if radii[-1] > reach_m else 1.0
        radii.append(radii[-1] + max(_SHORTEST_m, longer * growth * radii[-1]))
    return np.array(radii)


def _fine(low: float, high: float, step: float, begin: float, end: float) -> Floats:
    """Angles from `begin` to `end`, evenly by `step` between low and high, and growing beyond."""
    low, high = max(low, begin), min(high, end)
    count = max(1, int(np.ceil((high - low) / step)))
    inner = np.linspace(low, high, count + 1)
    step = (high - low) / count
    below = low - _growing(step, low - begin)[::-1]
    return np.concatenate([below, inner, high + _growing(step, end - high)])


def _growing(step: float, length: float) -> Floats:
    """Distances of faces that grow from `step` on and end at `length`."""
    if length <= 1e-9:
        return np.empty(0)
    count = 1
    while step * _GROWTH * (_GROWTH**count - 1) / (_GROWTH - 1) < length:
        count += 1
    widths = _GROWTH ** np.arange(1.0, count + 1)
    return np.asarray(np.cumsum(widths) * (length / widths.sum()))
