"""The error of a computed gas's own cells, by the same spray on cells of gas twice as large.

The error falls by first order: T_app of one plume of gdi-flow moves by 18.2, 8.7 and 4.3 K from
4 to 2, to 1 and to 0.5 mm (docs/errors.md). So the step from cells of 2 h to h is the error at h.

Droplets start alike on both, but eddies throw them elsewhere at every step of time, so that what
chance makes of the two sprays is independent: pictures of the same seed are as far apart as those
of different ones. The square of the step holds the square of that error twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.errors import OpticsError, SprayError
from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, PointSource, Sources
from cldit.scene.spray import LagrangianSpray
from cldit.spray.result import Vapour

Floats = NDArray[np.float64]

_LARGER = 2.0
_LARGEST_M = 1e-2  # that a scene may have
_FEWEST = 12  # cells along the gas's fuel, 4 mm of 48: fewer were not seen to follow first order
# What is cut off moves T_app by less than this part of what the spray does: 0.1 K of 100 K.
_MOST_LOST = 1e-3


@dataclass(frozen=True)
class GasGrid:
    """A spray on other cells of gas.

    sources: at the wavelength that is probed; None: there is none. how: what it is, or why there is
    none. fixed: key of the scene that holds the cells; empty: it has none.
    """

    sources: Sources | None
    how: str
    fixed: str = ""


def coarser_gas(
    spec: LagrangianSpray,
    vapour: Vapour,
    cube: Frame,
    sources_of: Callable[[LagrangianSpray], Sources],
) -> GasGrid:
    """The spray on cells of gas twice as large.

    Args:
        spec: of the spray.
        vapour: of the spray.
        cube: that is traced; what lies outside is cut off.
        sources_of: makes a spray, and says what it is to light.

    Returns:
        Its sources, or why none tell the error.
    """
    fixed = "spray.box.spacing_m"
    h_m = spec.box.spacing_m
    larger_m = _LARGER * h_m
    edges_m = vapour.cells.upper_m - vapour.cells.lower_m
    if not np.allclose(edges_m, h_m, rtol=1e-6):
        return GasGrid(None, f"the spray was given, on other cells than {fixed}", fixed)
    long_m = float(np.max(vapour.cells.upper_m.max(axis=0) - vapour.cells.lower_m.min(axis=0)))
    if long_m < (_FEWEST - 1e-6) * larger_m:
        why = (
            f"cells twice as large are {long_m / larger_m:.3g} along the vapour, and tell nothing "
            f"below {_FEWEST}; allowed is a smaller {fixed}"
        )
        return GasGrid(None, why, fixed)
    if larger_m > _LARGEST_M:
        return GasGrid(None, f"cells twice as large are above {_LARGEST_M:g} m", fixed)
    box = spec.box.model_copy(update={"spacing_m": larger_m})
    try:
        sources = sources_of(spec.model_copy(update={"box": box}))
    except (SprayError, OpticsError) as error:
        return GasGrid(None, f"the spray on cells twice as large: {error}", fixed)
    sources, lost = within(cube, sources)
    if lost > _MOST_LOST:
        why = (
            f"{100 * lost:.2g} % of the spray on cells twice as large lies outside the domain; "
            "allowed is a larger domain.edge_m"
        )
        return GasGrid(None, why, fixed)
    how = f"step from cells of gas of {1e3 * larger_m:.3g} to {1e3 * h_m:.3g} mm, by first order"
    return GasGrid(sources, how, fixed)


def within(cube: Frame, sources: Sources) -> tuple[Sources, float]:
    """What of a medium lies in a cube.

    Args:
        cube: of any depth.
        sources: droplets, in points or as clouds, and gas.

    Returns:
        The part inside, and the share of the rest: of the gas's absorption over its volume, or of
        the cross sections of the droplets, whichever is larger.
    """
    points, cells = sources
    low = np.asarray(cube.lower_m)
    high = low + cube.edge_m
    lost = [0.0]
    if points is not None:
        inside = np.all((points.position_m >= low) & (points.position_m <= high), axis=1)
        section = points.absorption_m2 + points.scattering_m2
        lost.append(_share(section, inside.astype(float)))
        points = None if not inside.any() else _chosen(points, inside)
    kept = []
    for each in cells:
        lower, upper = np.maximum(each.lower_m, low), np.minimum(each.upper_m, high)
        whole = np.prod(each.upper_m - each.lower_m, axis=1)
        part = np.prod(np.maximum(upper - lower, 0.0), axis=1) / whole
        optical = each.vapour_absorption + each.droplet_absorption + each.droplet_scattering
        lost.append(_share(optical * whole, part))
        kept.append(_cells(each, lower, upper, part > 0.0))
    return (points, kept), max(lost)


def _share(amount: Floats, inside: Floats) -> float:
    total = float(amount.sum())
    return float(np.sum(amount * (1.0 - inside))) / total if total > 0.0 else 0.0


def _chosen(points: PointSource, chosen: NDArray[np.bool_]) -> PointSource:
    extent = points.extent
    return PointSource(
        position_m=points.position_m[chosen],
        absorption_m2=points.absorption_m2[chosen],
        scattering_m2=points.scattering_m2[chosen],
        emission_m2=points.emission_m2[chosen],
        extent=None if extent is None else extent.of(chosen),
        class_scattering_m2=tuple(one[chosen] for one in points.class_scattering_m2),
    )


def _cells(
    each: CellSource, lower_m: Floats, upper_m: Floats, some: NDArray[np.bool_]
) -> CellSource:
    return CellSource(
        lower_m=lower_m[some],
        upper_m=upper_m[some],
        vapour_absorption=each.vapour_absorption[some],
        vapour_emission=each.vapour_emission[some],
        droplet_absorption=each.droplet_absorption[some],
        droplet_scattering=each.droplet_scattering[some],
        droplet_emission=each.droplet_emission[some],
    )
