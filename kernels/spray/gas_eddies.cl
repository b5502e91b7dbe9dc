/* Turbulent viscosity by Prandtl's mixing length, a property of the jets (cldit/spray/flow/gas.py). */

#include "spray/gas_cell.h"

/* Adds the part of one face to the gradient, by the theorem of Gauss. At a wall the velocity has no
   part across it. */
#define ADD_FACE(sign, open, d, table, n, size) { \
    const real ax = (table)[3 * (n)], ay = (table)[3 * (n) + 1], az = (table)[3 * (n) + 2]; \
    const real inverse = R(1) / (ax * ax + ay * ay + az * az + R(1e-30)); \
    const lane_t across = (R(1) - (open)) * (u * ax + v * ay + w * az) * inverse; \
    const lane_t part = R(0.5) * (lane_t)(open), x = READ(velocity + at + (d)); \
    const lane_t y = READ(velocity + at + (d) + cells), z = READ(velocity + at + (d) + 2 * cells); \
    const lane_t fu = (u - across * ax + part * (x - u)) * (size); \
    const lane_t fv = (v - across * ay + part * (y - v)) * (size); \
    const lane_t fw = (w - across * az + part * (z - w)) * (size); \
    uu += sign ax * fu; uv += sign ay * fu; uw += sign az * fu; \
    vu += sign ax * fv; vv += sign ay * fv; vw += sign az * fv; \
    wu += sign ax * fw; wv += sign ay * fw; ww += sign az * fw; \
}

/* Viscosity: the square of the mixing length times the norm of the strain rate, sqrt(2 S S), and times
   (far density / density)^(3/2). exchange: viscosity times density.

   around, downward, outward: vector areas of unit radius of the lower faces. open_below, open_above: 1
   where a row continues, 0 at its ends. square: of the radius of the lower face. */
__kernel void eddies(
    __global const real *restrict velocity, __global const real *restrict density,
    __global real *restrict eddy, __global real *restrict exchange,
    __global const real *restrict around, __global const real *restrict downward,
    __global const real *restrict outward, __global const real *restrict strip,
    __global const real *restrict square, __global const real *restrict mixing_length,
    __global const real *restrict open_below, __global const real *restrict open_above,
    __global const real *restrict angle,
    __global const real *restrict shell, const real far_density, CELL_ARGUMENTS)
{
    CELL
    const lane_t u = READ(velocity + at), v = READ(velocity + at + cells), w = READ(velocity + at + 2 * cells);
    lane_t uu = (lane_t)(R(0)), uv = uu, uw = uu, vu = uu, vv = uu, vw = uu, wu = uu, wv = uu, ww = uu;
    const lane_t side = READ(strip + i);
    ADD_FACE(-, left ? R(1) : R(0), left, around, ray, side)
    ADD_FACE(+, right ? R(1) : R(0), right, around, ray + polars, side)
    const int low = k * (polars + 1) + j;
    ADD_FACE(-, down ? R(1) : R(0), down, downward, low, side)
    ADD_FACE(+, up ? R(1) : R(0), up, downward, low + 1, side)
    ADD_FACE(-, READ(open_below + i), -1, outward, ray, READ(square + i))
    ADD_FACE(+, READ(open_above + i), 1, outward, ray, READ(square + i + 1))
    const lane_t xy = uv + vu, xz = uw + wu, yz = vw + wv;
    const lane_t strain = R(2) * (uu * uu + vv * vv + ww * ww) + xy * xy + xz * xz + yz * yz;
    const lane_t thin = far_density / READ(density + at);
    const lane_t viscosity = sqrt(strain) / VOLUME(angle, shell) * READ(mixing_length + i) * thin * sqrt(thin);
    WRITE(viscosity, eddy + at);
    WRITE(viscosity * READ(density + at), exchange + at);
}
