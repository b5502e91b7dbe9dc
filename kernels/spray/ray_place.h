/* Places of parcels on the grid of rays (cldit/spray/flow/rays.py): the cells around a position, and the
   turn that folds it into the sector of the cells. */
#ifndef RAY_PLACE_H
#define RAY_PLACE_H

#include "spray/gas_cell.h"

/* symmetry: number of equal sectors about the axis; 1: none; 0: the mean flow is round.
   faces: azimuths + 1, polars + 1, radii + 1 numbers; frame: rows are the local axes, followed by cosine
   and sine of the turn of each sector. */
typedef struct {
    int symmetry, ring, azimuths, polars, radii, stride;
    __global const real *faces, *frame;
} Rays;
#define RAYS_ARGUMENTS \
    __global const real *restrict faces, __global const real *restrict frame, const int symmetry, \
    const int ring, const int azimuths, const int polars, const int radii, const int stride
#define RAYS {symmetry, ring, azimuths, polars, radii, stride, faces, frame}

/* cell: index of the lower of the eight cells around a position; jump: to the next ones along azimuth,
   polar angle and radius; part: weight of these. nearest: the cell itself. cosine, sine, sign: of the turn,
   and of the mirrored second axis. inside: within the walls. */
typedef struct {
    int cell, jump[3], nearest, inside;
    real part[3], cosine, sine, sign;
} Place;

/* Angle of (x, y) from -pi to pi, with an error of 2e-8 rad (M. Abramowitz and I. A. Stegun, Handbook of
   Mathematical Functions, 4.4.49). */
INLINE real angle_of(real y, real x)
{
    const real a = size_of(x), b = size_of(y), more = most(a, b), t = least(a, b) / most(more, R(1e-30));
    const real s = t * t;
    real p = R(0.0028662257);
    p = p * s - R(0.0161657367);
    p = p * s + R(0.0429096138);
    p = p * s - R(0.0752896400);
    p = p * s + R(0.1065626393);
    p = p * s - R(0.1420889944);
    p = p * s + R(0.1999355085);
    p = p * s - R(0.3333314528);
    real angle = t + t * s * p;
    angle = b > a ? R(1.57079632679489662) - angle : angle;
    angle = x < R(0) ? R(3.14159265358979324) - angle : angle;
    return y < R(0) ? -angle : angle;
}

/* Finds the cell of x between `count + 1` faces, its lower neighbour on the side of x, and the weight of
   the upper one; returns the cell. */
INLINE int between(__global const real *faces, int count, real x, int *low, int *step, real *part)
{
    int first = 0, last = count;
    while (last - first > 1) {
        const int half_way = (first + last) / 2;
        const int above = faces[half_way] <= x;
        first = above ? half_way : first;
        last = above ? last : half_way;
    }
    const real share = (x - faces[first]) / (faces[first + 1] - faces[first]);
    const real at = least(most((real)first + least(most(share, R(0)), R(1)) - R(0.5), R(0)), (real)(count - 1));
    *low = smaller((int)at, larger(count - 2, 0));
    *step = count > 1;
    *part = at - (real)*low;
    return first;
}

/* Vector in the grid's frame. */
INLINE real3 local_of(real3 v, __global const real *f)
{
    return (real3)(f[0] * v.x + f[1] * v.y + f[2] * v.z, f[3] * v.x + f[4] * v.y + f[5] * v.z,
        f[6] * v.x + f[7] * v.y + f[8] * v.z);
}

INLINE Place place_of(real3 position, const Rays *rays)
{
    Place at;
    const real3 p = local_of(position, rays->frame);
    const real flat = root(p.x * p.x + p.y * p.y), far = root(flat * flat + p.z * p.z);
    const real polar = angle_of(flat, p.z);
    real azimuth = angle_of(p.y, p.x);
    at.cosine = R(1);
    at.sine = R(0);
    at.sign = R(1);
    if (rays->symmetry == 0) {
        const real inverse = R(1) / most(flat, R(1e-30));
        at.cosine = flat > R(1e-30) ? p.x * inverse : R(1);
        at.sine = flat > R(1e-30) ? p.y * inverse : R(0);
        azimuth = R(0);
    } else if (rays->symmetry > 1) {
        const real sector = R(6.28318530717958648) / (real)rays->symmetry;
        const int turn = floor_of(azimuth / sector + R(0.5));
        __global const real *turned = rays->frame + 9 + 2 * (turn < 0 ? turn + rays->symmetry : turn);
        at.cosine = turned[0];
        at.sine = turned[1];
        azimuth -= sector * (real)turn;
        at.sign = azimuth < R(0) ? R(-1) : R(1);
        azimuth = size_of(azimuth);
    }
    __global const real *around = rays->faces, *down = around + rays->azimuths + 1;
    __global const real *along = down + rays->polars + 1;
    int k, j, i, step;
    const int cell_k = between(around, rays->azimuths, azimuth, &k, &step, &at.part[0]);
    const int layer = rays->polars * rays->stride;
    at.jump[0] = step * layer;
    if (rays->ring) { /* the first and the last cell are neighbours */
        const real here = R(0.5) * (around[cell_k] + around[cell_k + 1]);
        if (cell_k == 0 && azimuth < here || cell_k == rays->azimuths - 1 && azimuth > here) {
            const real gap = R(6.28318530717958648) - R(0.5) * (around[rays->azimuths] + around[rays->azimuths - 1])
                + R(0.5) * (around[0] + around[1]);
            const real beyond = cell_k == 0 ? (here - azimuth) / gap : R(1) - (azimuth - here) / gap;
            k = rays->azimuths - 1;
            at.jump[0] = -k * layer;
            at.part[0] = R(1) - beyond;
        }
    }
    const int cell_j = between(down, rays->polars, polar, &j, &step, &at.part[1]);
    at.jump[1] = step * rays->stride;
    const int cell_i = between(along, rays->radii, far, &i, &step, &at.part[2]);
    at.jump[2] = step;
    at.cell = GUARD + (k * rays->polars + j) * rays->stride + i;
    at.nearest = GUARD + (cell_k * rays->polars + cell_j) * rays->stride + cell_i;
    at.inside = far < along[rays->radii] && polar >= down[0] && polar <= down[rays->polars]
        && (rays->symmetry != 1 || rays->ring || azimuth >= around[0] && azimuth <= around[rays->azimuths]);
    return at;
}

/* Value of a field, linear between the middles of the cells. */
INLINE real gathered(__global const GAS_REAL *field, const Place *at)
{
    const int a = at->cell, b = a + at->jump[0], j = at->jump[1], i = at->jump[2];
    const real u = at->part[0], v = at->part[1], w = at->part[2];
    const real s = (R(1) - w) * (real)field[a] + w * (real)field[a + i];
    const real t = (R(1) - w) * (real)field[a + j] + w * (real)field[a + j + i];
    const real p = (R(1) - w) * (real)field[b] + w * (real)field[b + i];
    const real q = (R(1) - w) * (real)field[b + j] + w * (real)field[b + j + i];
    return (R(1) - u) * ((R(1) - v) * s + v * t) + u * ((R(1) - v) * p + v * q);
}

/* The same for eight fields whose values are beside each other. */
INLINE real8 all_gathered(__global const real8 *fields, const Place *at)
{
    const int a = at->cell, b = a + at->jump[0], j = at->jump[1], i = at->jump[2];
    const real u = at->part[0], v = at->part[1], w = at->part[2];
    const real8 s = fields[a] + w * (fields[a + i] - fields[a]);
    const real8 t = fields[a + j] + w * (fields[a + j + i] - fields[a + j]);
    const real8 p = fields[b] + w * (fields[b + i] - fields[b]);
    const real8 q = fields[b + j] + w * (fields[b + j + i] - fields[b + j]);
    const real8 low = s + v * (t - s), high = p + v * (q - p);
    return low + u * (high - low);
}

/* Vector turned with its position into the sector. The part across cancels in a round mean. */
INLINE real3 folded(real3 v, const Place *at, const Rays *rays)
{
    const real3 p = local_of(v, rays->frame);
    const real across = rays->symmetry == 0 ? R(0) : at->sign * (at->cosine * p.y - at->sine * p.x);
    return (real3)(at->cosine * p.x + at->sine * p.y, across, p.z);
}

/* Its inverse. */
INLINE real3 unfolded(real3 v, const Place *at, const Rays *rays)
{
    __global const real *f = rays->frame;
    const real y = at->sign * v.y, a = at->cosine * v.x - at->sine * y;
    const real b = at->sine * v.x + at->cosine * y;
    return (real3)(f[0] * a + f[3] * b + f[6] * v.z, f[1] * a + f[4] * b + f[7] * v.z,
        f[2] * a + f[5] * b + f[8] * v.z);
}

#endif
