"""Reference implementations of the kernels in NumPy and double precision.

Attenuation (Beer-Lambert), a sweep along one ordinate, and a line of sight.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from cldit.arrays import Floats
from cldit.transport.boundary import NONE, boundary_seen
from cldit.transport.cells import mean_transmission
from cldit.transport.discrete_ordinates.segments import visible_gradient

# Gauss-Legendre nodes from 0 to 1 and their weights: for smooth functions exact to rounding.
_GAUSS = tuple(
    values / 2 for values in np.polynomial.legendre.leggauss(12) + np.array([[1.0], [0.0]])
)


def moment_to_discrete(unit: Floats) -> Floats:
    """Weights (8, N) of a source's moments but the mean in the source along unit vectors (N, 3)."""
    x, y, z = unit.T
    return np.stack([x, y, z, x * x - z * z, y * y - z * z, x * y, x * z, y * z])


def absorbed(depth: Floats) -> Floats:
    """Absorbed share 1 - exp(-t) along optical depths t of any shape."""
    return np.asarray(-np.expm1(-depth))


def sweep(
    depth: Floats,
    source: Floats,
    *,
    back: Floats,
    weight: float,
    start: Floats,
    centre: Floats,
    radius: float,
    patches: Floats = NONE,
    slope: Floats | None = None,
    gradient: Floats | None = None,
    inflow: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """Sweep along one ordinate, as in kernels/sweep.cl.

    Args:
        depth: (nz, ny, nx) optical depth of a cell's edge.
        source: (C, nz, ny, nx), background first, wall second, then patches.
        back: (3,) unit vector to where the light comes from.
        weight: of the ordinate.
        start: (2,) where rays cross the cells of the first layer, 0 to 1.
        centre, radius, patches: as in `boundary_seen`, in cells.
        slope: (8, C, nz, ny, nx) angular moments of the source, see angular_moments.py.
        gradient: (3, C, nz, ny, nx) spatial gradient of the source along x, y, z, per cell.
        inflow: radiance (C, N) of rays that enter the box at points (N, 3); None: the boundary's.

    Returns:
        (4, C, nz, ny, nx): w (I - S) and, with `gradient`, its moments with the zero-mean basis
        along x, y, z (see discrete_ordinates/segments.py), else 0.
    """
    gradients = np.zeros((3, *source.shape)) if gradient is None else gradient
    more = (
        np.zeros_like(source)
        if slope is None
        else np.tensordot(moment_to_discrete(back[None])[:, 0], slope, axes=1)
    )
    main = int(np.argmax(np.abs(back)))
    axes = {0: (1, 2, 0), 1: (0, 2, 1), 2: (0, 1, 2)}[main]  # u, v, l as x, y, z
    order = [2 - axis for axis in (axes[2], axes[1], axes[0])]  # numpy axes of [l, v, u]
    t_all = depth.transpose(order)
    s_all = (source + more).transpose(0, *(1 + axis for axis in order))
    g_all = gradients.transpose(0, 1, *(2 + axis for axis in order))
    m_all = more.transpose(0, *(1 + axis for axis in order))
    i_minus_s = np.zeros((4, *s_all.shape))
    nl, nv, nu = t_all.shape
    u_run, v_run, l_run = (-back[axis] for axis in axes)
    path_per_layer = 1 / abs(l_run)
    run = path_per_layer * np.array([u_run, v_run])
    v, u = np.meshgrid(np.arange(nv), np.arange(nu), indexing="ij")
    rays = np.zeros((len(source), nv, nu))
    before = np.zeros(2, int)
    for number in range(nl):
        layer = nl - 1 - number if l_run < 0 else number
        # Places in this layer where rays, which are all alike, enter the next cell.
        entry = start + number * run
        cuts = [0.0, 1.0]
        for place, slope in zip(entry, run, strict=True):
            if slope != 0:
                side = np.floor(place) + (1 if slope > 0 else 0)
                cuts.append(min((side - place) / slope, 1.0))
        between = itertools.pairwise(sorted(cuts))
        segments = [(low, high) for low, high in between if high - low > 1e-9]
        level = sum((high - low) * ((entry + (low + high) / 2 * run) % 1) for low, high in segments)
        for low, high in segments:
            shift = np.floor(entry + (low + high) / 2 * run).astype(int)
            shifted = shift - before
            before = shift
            # The array of rays is rolled to follow their cells; rays that wrapped enter anew.
            rays = np.roll(rays, (shifted[1], shifted[0]), axis=(1, 2))
            enters = np.full((nv, nu), number == 0 and low == 0)
            enters |= (shifted[0] > 0) & (u == 0) | (shifted[0] < 0) & (u == nu - 1)
            enters |= (shifted[1] > 0) & (v == 0) | (shifted[1] < 0) & (v == nv - 1)
            point = np.empty((nv * nu, 3))
            for axis, place in zip(axes, (u, v, np.full_like(u, layer)), strict=True):
                point[:, axis] = place.reshape(-1) + 0.5
            if inflow is None:
                lines = np.broadcast_to(back, point.shape)
                seen = boundary_seen(point, lines, centre=centre, radius=radius, patches=patches)
                entering = np.arange(len(rays))[:, None] == seen
            else:
                entering = inflow(point)
            rays[:, enters] = entering.reshape(rays.shape)[:, enters]
            t = t_all[layer] * (path_per_layer * (high - low))
            mean = mean_transmission(t)
            middle = np.empty(3)
            middle[list(axes[:2])] = (entry + (low + high) / 2 * run) % 1 - 0.5
            middle[axes[2]] = ((low + high) / 2 - 0.5) * (1 if l_run > 0 else -1)
            rise = -path_per_layer * (high - low) * np.tensordot(back, g_all[:, :, layer], axes=1)
            linear_part = rise * ((1 + np.exp(-t)) / 2 - mean)
            gap = rays - s_all[:, layer] - np.tensordot(middle, g_all[:, :, layer], axes=1)
            part = gap * mean + m_all[:, layer]
            part -= np.divide(linear_part, t, out=np.zeros_like(part), where=t > 0)
            i_minus_s[0, :, layer] += weight * (high - low) * part
            if gradient is not None:
                mean_place, scale = np.zeros(3), np.ones(3)
                mean_place[list(axes[:2])] = level - 0.5
                scale[list(axes[:2])] = 1 / visible_gradient(run)
                parts = _spatial_moments(
                    rays,
                    t,
                    s_all[:, layer],
                    g_all[:, :, layer],
                    middle=middle,
                    segment=-back * path_per_layer * (high - low),
                    mean_place=mean_place,
                    scale=scale,
                )
                i_minus_s[1:, :, layer] += weight * (high - low) * parts
            rays = rays - gap * absorbed(t) + linear_part
    back_order = np.argsort(order)
    return np.asarray(i_minus_s.transpose(0, 1, *(2 + axis for axis in back_order)))


def _spatial_moments(
    rays: Floats,
    depth: Floats,
    source: Floats,
    gradient: Floats,
    *,
    middle: Floats,
    segment: Floats,
    mean_place: Floats,
    scale: Floats,
) -> Floats:
    """Mean (3, C, nv, nu) of I - S times the basis along x, y, z, over a segment, by quadrature.

    Args:
        rays: (C, nv, nu) radiance at the start.
        depth: (nv, nu) optical depth of the segment.
        source, gradient: (C, nv, nu) and (3, C, nv, nu), as in `sweep`.
        middle, segment: (3,) the segment's middle from the cell's, and its vector, in cells.
        mean_place, scale: (3,); the basis is scale x (place - mean_place).
    """
    middle_source = source + np.tensordot(middle, gradient, axes=1)
    rise = np.tensordot(segment, gradient, axes=1)
    parts = np.zeros((3, *rays.shape))
    for place, share in zip(*_GAUSS, strict=True):
        before, weight = (place * numbers[:, None, None, None] for numbers in _GAUSS)
        emitted = (middle_source + (before - 0.5) * rise) * np.exp(-depth * (place - before))
        light = rays * np.exp(-depth * place) + depth * np.sum(weight * emitted, axis=0)
        over = share * (light - (middle_source + (place - 0.5) * rise))
        basis = scale * (middle + segment * (place - 0.5) - mean_place)
        parts += np.multiply.outer(basis, over)
    return parts


def march(depth: Floats, source: Floats, *, point: Floats, toward: Floats) -> tuple[Floats, float]:
    """Formal solution along a line through a cube of cells.

    Every crossing of a cell face is computed on its own, not from the one before.

    Args:
        depth: (n, n, n) [z, y, x] optical depth of a cell's edge.
        source: (C, n, n, n).
        point, toward: (3,) any point of the line in cells, and its unit vector.

    Returns:
        The radiance (C,), and the line's transmission.
    """
    n = len(depth)
    cuts = []
    for axis in range(3):
        if toward[axis] != 0:
            cuts.append((np.arange(n + 1) - point[axis]) / toward[axis])
    t = np.unique(np.concatenate(cuts))
    middle = point + (t[:-1, None] + np.diff(t)[:, None] / 2) * toward
    inside = np.all((middle > 0) & (middle < n), axis=1)
    x, y, z = np.floor(middle[inside]).astype(int).T
    path = np.diff(t)[inside] * depth[z, y, x]
    before = np.exp(-np.concatenate([[0.0], np.cumsum(path)]))
    taken = before[:-1] * absorbed(path)
    return np.asarray((source[:, z, y, x] * taken).sum(axis=1)), float(before[-1])
