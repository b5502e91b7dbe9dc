/* Sums over the parcels of each cell, in fixed point, as fields per volume. */

#include "gas_cell.h"

/* A parcel represents droplets around it. So what it gives to its cell is spread along the ray by as much as
   linear weights would, a variance of 1/12 of a cell squared beside that of its place in the cell; the rest
   of its extent, across the rays, is `mix_across`. copies: of the cells. */
__kernel void as_fields(
    __global long *restrict sums, __global const real *restrict units, __global real *restrict fields,
    __global const real *restrict angle, __global const real *restrict shell,
    __global const real *restrict open_below, __global const real *restrict open_above, const real copies,
    const int azimuths, const int cells)
{
    CELL(azimuths, 0)
    __global const long *from = sums + (long)field * cells + at;
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        const real here = (real)from[lane];
        const real below = open_below[i + lane] * ((real)from[lane - 1] - here);
        const real above = open_above[i + lane] * ((real)from[lane + 1] - here);
        const real whole = here + R(1.0 / 24.0) * (below + above);
        fields[field * cells + at + lane] = whole * units[field] / (copies * angle[ray] * shell[i + lane]);
    }
}
