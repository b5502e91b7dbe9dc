/* Sums over the parcels of each cell, in fixed point, as fields per volume. */

#include "spray/gas_cell.h"

/* units: numbers per unit of the sums. copies: of the cells. */
__kernel void as_fields(
    __global long *restrict sums, __global const real *restrict units, __global real *restrict fields,
    __global const real *restrict angle, __global const real *restrict shell,
    const real copies, CELL_ARGUMENTS)
{
    CELL
    __global const long *from = sums + (long)field * cells + at;
    for (int lane = 0; lane < SIMD_WIDTH; ++lane)
        fields[field * cells + at + lane] =
            (real)from[lane] * units[field] / (copies * angle[ray] * shell[i + lane]);
}
