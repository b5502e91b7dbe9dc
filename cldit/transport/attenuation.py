"""The same physics as the kernels, slowly, in NumPy and double precision: what they are held to."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from cldit.transport.angular_moments import moment_to_discrete
from cldit.transport.discrete_ordinates.segments import visible_gradient
from cldit.transport.patches import NONE

Floats = NDArray[np.float64]

# Places from 0 to 1 along a way, and their weights: for smooth functions exact to rounding.
_GAUSS = tuple(
    values / 2 for values in np.polynomial.legendre.leggauss(12) + np.array([[1.0], [0.0]])
)


def absorbed(depth: Floats) -> Floats:
    """1 - exp(-t)."""
    return np.asarray(-np.expm1(-depth))


def mean_transmission(depth: Floats) -> Floats:
    """(1 - exp(-t)) / t, and 1 at t = 0."""
    safe = np.where(depth > 0, depth, 1.0)
    return np.where(depth > 0, -np.expm1(-safe) / safe, 1.0)


def sees_disc(point: Floats, toward: Floats, *, centre: Floats, radius: float) -> NDArray[np.bool_]:
    """Whether lines from points (N, 3) along directions (N, 3) meet a disc that faces -y."""
    forward = toward[:, 1] > 0
    s = (centre[1] - point[:, 1]) / np.where(forward, toward[:, 1], 1.0)
    hit = point + s[:, None] * toward
    across = (hit[:, 0] - centre[0]) ** 2 + (hit[:, 2] - centre[2]) ** 2
    return np.asarray(forward & (across <= radius**2))


def boundary_seen(
    point: Floats,
    toward: Floats,
    *,
    centre: Floats,
    radius: float,
    patches: Floats,
    start: float = 0.0,
) -> NDArray[np.int64]:
    """Component (N,) that lines from points (N, 3) see: 0 the disc, 1 the walls, 2.. the patches.

    patches: (P, 4, 4), see cldit.transport.patches. start: nearest distance that counts.
    """
    s = (centre[1] - point[:, 1]) / np.where(toward[:, 1] > 0, toward[:, 1], 1.0)
    on_disc = sees_disc(point, toward, centre=centre, radius=radius)
    distance = [np.where(on_disc, s, np.inf)]
    for normal, middle, across, up in patches:
        against = -toward @ normal[:3]
        s = (point @ normal[:3] - normal[3]) / np.where(against > 0, against, 1.0)
        inside = point + s[:, None] * toward - middle[:3]
        u, v = np.abs(inside @ across[:3]), np.abs(inside @ up[:3])
        hit = np.maximum(u, v) <= 1 if middle[3] else u**2 + v**2 <= 1
        distance.append(np.where(hit & (against > 0) & (s >= start), s, np.inf))
    nearest = np.argmin(distance, axis=0)  # of equal ones the first
    nothing = np.isinf(np.min(distance, axis=0))
    return np.where(nothing, 1, np.where(nearest == 0, 0, nearest + 1))


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
    across: Floats | None = None,
) -> Floats:
    """Excess that one direction's sweep gives, and that times the lever along x, y, z (see
    discrete_ordinates/segments.py), unless `across` is None: (4, C, nz, ny, nx); see
    kernels/sweep.cl.

    Args:
        depth: (nz, ny, nx) optical depth of a cell's edge.
        source: (C, nz, ny, nx), background first, wall second, then patches.
        back: (3,) unit vector to where the light comes from.
        start: (2,) where rays cross the cells of the first layer, 0 to 1.
        slope: (8, C, nz, ny, nx), the source's moments; see moments.py.
        across: (3, C, nz, ny, nx), by which it changes across a cell along x, y, z.
    """
    changes = np.zeros((3, *source.shape)) if across is None else across
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
    g_all = changes.transpose(0, 1, *(2 + axis for axis in order))
    m_all = more.transpose(0, *(1 + axis for axis in order))
    i_minus_s = np.zeros((4, *s_all.shape))
    nl, nv, nu = t_all.shape
    u_run, v_run, l_run = (-back[axis] for axis in axes)
    stretch = 1 / abs(l_run)
    run = stretch * np.array([u_run, v_run])
    v, u = np.meshgrid(np.arange(nv), np.arange(nu), indexing="ij")
    rays = np.zeros((len(source), nv, nu))
    before = np.zeros(2, int)
    for step in range(nl):
        layer = nl - 1 - step if l_run < 0 else step
        # Where in this layer a ray, all of which are alike, comes to another cell.
        entry = start + step * run
        cuts = [0.0, 1.0]
        for place, slope in zip(entry, run, strict=True):
            if slope != 0:
                side = np.floor(place) + (1 if slope > 0 else 0)
                cuts.append(min((side - place) / slope, 1.0))
        steps = [(low, high) for low, high in itertools.pairwise(sorted(cuts)) if high - low > 1e-9]
        level = sum((high - low) * ((entry + (low + high) / 2 * run) % 1) for low, high in steps)
        for low, high in steps:
            shift = np.floor(entry + (low + high) / 2 * run).astype(int)
            moved = shift - before
            before = shift
            # Rays follow their cells: the array of rays is rolled, and those that wrapped come in
            # anew.
            rays = np.roll(rays, (moved[1], moved[0]), axis=(1, 2))
            enters = np.full((nv, nu), step == 0 and low == 0)
            enters |= (moved[0] > 0) & (u == 0) | (moved[0] < 0) & (u == nu - 1)
            enters |= (moved[1] > 0) & (v == 0) | (moved[1] < 0) & (v == nv - 1)
            point = np.empty((nv * nu, 3))
            for axis, place in zip(axes, (u, v, np.full_like(u, layer)), strict=True):
                point[:, axis] = place.reshape(-1) + 0.5
            lines = np.broadcast_to(back, point.shape)
            seen = boundary_seen(point, lines, centre=centre, radius=radius, patches=patches)
            component = np.arange(len(rays))[:, None, None]
            rays[:, enters] = (component == seen.reshape(nv, nu))[:, enters]
            t = t_all[layer] * (stretch * (high - low))
            mean = mean_transmission(t)
            middle = np.empty(3)
            middle[list(axes[:2])] = (entry + (low + high) / 2 * run) % 1 - 0.5
            middle[axes[2]] = ((low + high) / 2 - 0.5) * (1 if l_run > 0 else -1)
            change = -stretch * (high - low) * np.tensordot(back, g_all[:, :, layer], axes=1)
            more_at_end = change * ((1 + np.exp(-t)) / 2 - mean)
            gap = rays - s_all[:, layer] - np.tensordot(middle, g_all[:, :, layer], axes=1)
            part = gap * mean + m_all[:, layer]
            part -= np.divide(more_at_end, t, out=np.zeros_like(part), where=t > 0)
            i_minus_s[0, :, layer] += weight * (high - low) * part
            if across is not None:
                mean_place, gain = np.zeros(3), np.ones(3)
                mean_place[list(axes[:2])] = level - 0.5
                gain[list(axes[:2])] = 1 / visible_gradient(run)
                parts = _across_cells(
                    rays,
                    t,
                    s_all[:, layer],
                    g_all[:, :, layer],
                    middle=middle,
                    way=-back * stretch * (high - low),
                    mean_place=mean_place,
                    gain=gain,
                )
                i_minus_s[1:, :, layer] += weight * (high - low) * parts
            rays = rays - gap * absorbed(t) + more_at_end
    back_order = np.argsort(order)
    return np.asarray(i_minus_s.transpose(0, 1, *(2 + axis for axis in back_order)))


def _across_cells(
    rays: Floats,
    depth: Floats,
    source: Floats,
    changes: Floats,
    *,
    middle: Floats,
    way: Floats,
    mean_place: Floats,
    gain: Floats,
) -> Floats:
    """(3, C, nv, nu) mean, along rays that enter cells with some light, of what that is more than
    the source, times the lever along x, y, z.

    depth: of the way; source (C, ...), changes (3, C, ...): as in `sweep`; middle, way (3,): the
    way's middle, from the cell's, and the way as a vector, in cells. A lever is the place less
    `mean_place`, both from the cell's middle on, times `gain`.
    """
    middle_source = source + np.tensordot(middle, changes, axes=1)
    rise = np.tensordot(way, changes, axes=1)
    parts = np.zeros((3, *rays.shape))
    for place, share in zip(*_GAUSS, strict=True):
        before, weight = (place * numbers[:, None, None, None] for numbers in _GAUSS)
        moment_to_discrete = (middle_source + (before - 0.5) * rise) * np.exp(
            -depth * (place - before)
        )
        light = rays * np.exp(-depth * place) + depth * np.sum(weight * moment_to_discrete, axis=0)
        over = share * (light - (middle_source + (place - 0.5) * rise))
        basis = gain * (middle + way * (place - 0.5) - mean_place)
        parts += np.multiply.outer(basis, over)
    return parts


def march(depth: Floats, source: Floats, *, point: Floats, toward: Floats) -> tuple[Floats, float]:
    """Light (C,) that a line collects in a dense cube of cells, and what it still transmits.

    Every crossing of a cell face is computed on its own, not stepped from the last.

    Args:
        depth: (n, n, n) [z, y, x] optical depth of a cell's edge; source: (C, n, n, n).
        point, toward: (3,) any point of the line, and its unit direction; in cells.
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
