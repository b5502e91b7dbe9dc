"""Finite volumes on the grid of rays: advection and diffusion of the gas in a step.

Fluxes are third order along each axis, in space and time (QUICKEST: B. P. Leonard, Comput. Methods
Appl. Mech. Eng. 19, 59 (1979)), for a CFL number, summed over the axes, below 1. Mass fractions and
enthalpy are limited to the range of their neighbours (total variation diminishing, in Sweby's
region); velocity is not, since the limiter flattens maxima and so widens a jet.

Cells are much finer across the rays than along them, and finest at the tip. So eddies mix
implicitly across, one axis after the other, and explicitly along. Near the tip a part of the
advection across is implicit, too (`split`), so that the step depends on the cells along the rays.
One function computes the fluxes through a row of faces without branches, for vector instructions;
rows are along the radius.
"""

from __future__ import annotations

import numpy as np

from cldit.arrays import Floats
from cldit.spray.numba_typing import compiled


@compiled
def _passing(
    flux: Floats,
    mass: Floats,
    share: Floats,
    step: float,
    bounded: bool,
    far: Floats,
    low: Floats,
    high: Floats,
    beyond: Floats,
    result: Floats,
) -> None:
    """Fluxes (K,) through the faces of a row.

    flux: of mass, kg/s; mass: of the cells at the face, kg; share: diffusive flux per difference
    of the values; bounded: no new extrema. Values far, low | high, beyond on both sides.
    """
    for k in range(result.shape[0]):
        # Both sides are read and computed, so that only selections remain.
        m, heavy, d = flux[k], mass[k], share[k]
        t, x, y, z = far[k], low[k], high[k], beyond[k]
        onward = m >= 0.0
        speed = step * m / heavy
        rise = y - x
        first, second = x - t, z - y
        behind = first if onward else second
        up = x if onward else y
        sign = 1.0 if onward else -1.0
        # Third order in r = behind / rise, within 0, 2 r and 2; half of it, times rise.
        third = rise - (1.0 + abs(speed)) / 3.0 * (rise - behind)
        most = min(2.0 * abs(behind), 2.0 * abs(rise))
        even = behind * rise <= 0.0
        part = 0.5 * min(abs(third), most)
        held = 0.0 if even else (part if rise > 0.0 else -part)
        slope = held if bounded else 0.5 * third
        result[k] = m * (up + (sign - speed) * slope) - d * rise


@compiled
def _mean(one: Floats, other: Floats, result: Floats) -> None:
    for k in range(result.shape[0]):
        result[k] = 0.5 * (one[k] + other[k])


@compiled
def carry(
    value: Floats,
    around: Floats,
    down: Floats,
    outward: Floats,
    mass: Floats,
    exchange: Floats,
    angle: Floats,
    conductance: Floats,
    step: float,
    bounded: bool,
    result: Floats,
) -> None:
    """Adds what the mass fluxes carry in a step, and diffusion along the rays, to `result`.

    Args:
        value: (A, P, R) per mass.
        around, down, outward: (A, P, R) mass fluxes through the lower faces [kg/s]; walls have 0.
        mass: (A, P, R) of the cells.
        exchange: (A, P, R) diffusivity times density.
        angle, conductance: (A, P) and (R,) of the faces across the rays.
        step: length of the step.
        bounded: no new extrema.
        result: (A, P, R) amount of the cells, added to.
    """
    na, nt, nr = value.shape
    heavy, flow, still = np.empty(nr), np.empty(nr), np.zeros(nr)
    line, share = np.empty(nr + 3), np.empty(nr)
    for k in range(na):
        for j in range(nt):
            row = value[k, j]
            # Along the ray: face i is between cells i - 1 and i.
            line[0] = row[0]
            line[1] = row[0]
            for i in range(nr):
                line[i + 2] = row[i]
            line[nr + 2] = row[nr - 1]
            heavy[0] = mass[k, j, 0]
            share[0] = 0.0
            for i in range(1, nr):
                heavy[i] = 0.5 * (mass[k, j, i - 1] + mass[k, j, i])
                share[i] = 0.5 * (exchange[k, j, i - 1] + exchange[k, j, i])
                share[i] *= angle[k, j] * conductance[i]
            _passing(
                outward[k, j],
                heavy,
                share,
                step,
                bounded,
                line[:nr],
                line[1 : nr + 1],
                line[2 : nr + 2],
                line[3 : nr + 3],
                flow,
            )
            for i in range(nr):
                result[k, j, i] += step * flow[i]
            for i in range(nr - 1):
                result[k, j, i] -= step * flow[i + 1]
            if j > 0:
                _mean(mass[k, j - 1], mass[k, j], heavy)
                _passing(
                    down[k, j],
                    heavy,
                    still,
                    step,
                    bounded,
                    value[k, max(j - 2, 0)],
                    value[k, j - 1],
                    row,
                    value[k, min(j + 1, nt - 1)],
                    flow,
                )
                for i in range(nr):
                    result[k, j, i] += step * flow[i]
                    result[k, j - 1, i] -= step * flow[i]
            if k > 0:
                _mean(mass[k - 1, j], mass[k, j], heavy)
                _passing(
                    around[k, j],
                    heavy,
                    still,
                    step,
                    bounded,
                    value[max(k - 2, 0), j],
                    value[k - 1, j],
                    row,
                    value[min(k + 1, na - 1), j],
                    flow,
                )
                for i in range(nr):
                    result[k, j, i] += step * flow[i]
                    result[k - 1, j, i] -= step * flow[i]


@compiled
def mix(
    fields: Floats,
    mass: Floats,
    flux: Floats,
    exchange: Floats,
    conductance: Floats,
    length: Floats,
    step: float,
    around: bool,
) -> None:
    """Advects and mixes S fields per mass (S, A, P, R) implicitly across the rays, in place.

    Values at faces are central, and upwind where the cell's Peclet number exceeds 2 (the hybrid
    scheme of S. V. Patankar, Numerical Heat Transfer and Fluid Flow, 1980), so no new extrema.

    Args:
        fields: (S, A, P, R).
        mass: (A, P, R) of the cells; what the fluxes change is added.
        flux: (A, P, R) of mass through the lower faces [kg/s]; walls have 0.
        exchange: (A, P, R) diffusivity times density.
        conductance, length: (A, P) and (R,), whose product is area over distance of the lower
            faces.
        step: length of the step.
        around: over the azimuth, else over the polar angle.
    """
    na, nt, nr = mass.shape
    kinds = fields.shape[0]
    lines, count = (nt, na) if around else (na, nt)
    ratio, high, left = np.zeros((count + 1, nr)), np.zeros(nr), np.zeros(nr)
    low, entered, inverse = np.zeros(nr), np.zeros(nr), np.zeros(nr)
    for line in range(lines):
        low[:] = 0.0
        entered[:] = 0.0
        for n in range(count):
            k, j = (n, line) if around else (line, n)
            kn, jn = (k + 1, j) if around else (k, j + 1)
            kp, jp = (max(k - 1, 0), j) if around else (k, max(j - 1, 0))
            heavy, before, after = mass[k, j], ratio[n], ratio[n + 1]
            high[:] = 0.0
            left[:] = 0.0
            if n + 1 < count:
                one, other, passing = exchange[k, j], exchange[kn, jn], flux[kn, jn]
                part = 0.5 * step * conductance[kn, jn]
                for i in range(nr):
                    through = step * passing[i]
                    even = part * length[i] * (one[i] + other[i])
                    high[i] = max(even - 0.5 * through, max(-through, 0.0))
                    left[i] = through
            for i in range(nr):
                inverse[i] = 1.0 / (heavy[i] + low[i] + high[i] - low[i] * before[i])
                after[i] = high[i] * inverse[i]
            for s in range(kinds):
                row, last = fields[s, k, j], fields[s, kp, jp]
                for i in range(nr):
                    row[i] = (heavy[i] * row[i] + low[i] * last[i]) * inverse[i]
            for i in range(nr):
                heavy[i] += entered[i] - left[i]
                entered[i] = left[i]
                low[i] = high[i] + left[i]
        for n in range(count - 2, -1, -1):
            k, j = (n, line) if around else (line, n)
            kn, jn = (k + 1, j) if around else (k, j + 1)
            after = ratio[n + 1]
            for s in range(kinds):
                row, following = fields[s, k, j], fields[s, kn, jn]
                for i in range(nr):
                    row[i] += after[i] * following[i]


@compiled
def split(
    flux: Floats, mass: Floats, step: float, limit: float, share: Floats, explicit: Floats
) -> None:
    """Parts of the fluxes across the rays (2, A, P, R) that an explicit step may carry.

    In a cell that passes on more than `limit` of its mass, only those parts remain explicit with
    which it does not (A. F. Shchepetkin, Ocean Modelling 91, 38 (2015)). `share` (A, P, R) is
    written.
    """
    na, nt, nr = mass.shape
    for k in range(na):
        for j in range(nt):
            kn, jn = min(k + 1, na - 1), min(j + 1, nt - 1)
            last_k, last_j = k + 1 == na, j + 1 == nt
            for i in range(nr):
                a = abs(flux[0, k, j, i])
                b = abs(flux[1, k, j, i])
                c = abs(flux[2, k, j, i])
                a = a if last_k else max(a, abs(flux[0, kn, j, i]))
                b = b if last_j else max(b, abs(flux[1, k, jn, i]))
                c = max(c, abs(flux[2, k, j, i + 1])) if i + 1 < nr else c
                free = limit * mass[k, j, i] - step * c
                share[k, j, i] = min(1.0, max(free, 0.0) / (step * (a + b) + 1e-300))
    for k in range(na):
        for j in range(nt):
            for i in range(nr):
                here = share[k, j, i]
                if k > 0:
                    explicit[0, k, j, i] = flux[0, k, j, i] * min(here, share[k - 1, j, i])
                if j > 0:
                    explicit[1, k, j, i] = flux[1, k, j, i] * min(here, share[k, j - 1, i])


@compiled
def settle(amounts: Floats, mass: Floats, explicit: Floats, flux: Floats, step: float) -> None:
    """Ends an explicit step: cells have their new mass, and amounts become those per mass.

    Args:
        amounts: (S, A, P, R) of the cells.
        mass: (A, P, R) of the cells.
        explicit: (2, A, P, R) fluxes of mass across the rays that were carried; become the rest.
        flux: (3, A, P, R) of mass through the lower faces.
        step: length of the step.
    """
    na, nt, nr = mass.shape
    for k in range(na):
        for j in range(nt):
            heavy, along = mass[k, j], flux[2, k, j]
            for i in range(nr):
                heavy[i] += step * (explicit[0, k, j, i] + explicit[1, k, j, i] + along[i])
            for i in range(nr - 1):
                heavy[i] -= step * along[i + 1]
            if k + 1 < na:
                for i in range(nr):
                    heavy[i] -= step * explicit[0, k + 1, j, i]
            if j + 1 < nt:
                for i in range(nr):
                    heavy[i] -= step * explicit[1, k, j + 1, i]
            for s in range(amounts.shape[0]):
                for i in range(nr):
                    amounts[s, k, j, i] /= heavy[i]
    for a in range(2):
        for k in range(na):
            for j in range(nt):
                for i in range(nr):
                    explicit[a, k, j, i] = flux[a, k, j, i] - explicit[a, k, j, i]
