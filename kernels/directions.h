/* Lookup of ordinates: the nearest to a direction, or by the cumulative weight (final gather, stage 5 of
   `trace_source`). */
#ifndef DIRECTIONS_H
#define DIRECTIONS_H

#include "real.h"

#ifndef NEAREST_SIDE
#error "NEAREST_SIDE: entries of the table of nearest ordinates along a side of an octant"
#endif

/* Entry of the table of nearest ordinates, [octant][NEAREST_SIDE][NEAREST_SIDE]. An octant of the sphere
   is a face of the octahedron (Cigolle et al., J. Computer Graphics Techniques 3, 2014), projected along
   z. Every entry belongs to one octant; the plane between two belongs to the lower one, as in path
   segments and sweeps. */
INLINE int direction_near(real3 d)
{
    const real x = size_of(d.x), y = size_of(d.y), z = size_of(d.z);
    const real scale = NEAREST_SIDE / (x + y + z);
    const int i = smaller((int)(x * scale), NEAREST_SIDE - 1);
    const int j = smaller((int)(y * scale), NEAREST_SIDE - 1);
    const int octant = (d.x > R(0)) + 2 * (d.y > R(0)) + 4 * (d.z > R(0));
    return (octant * NEAREST_SIDE + j) * NEAREST_SIDE + i;
}

/* Number of the ordinate at which the cumulative weight, `directions[].w`, reaches u. */
INLINE int direction_at(
    real u, __global const real4 *directions, __global const int *start, int count)
{
    int number = start[smaller((int)(u * count), count - 1)];
    while (number > 0 && directions[number - 1].w > u) --number; /* by rounding alone */
    while (number < count - 1 && directions[number].w <= u) ++number;
    return number;
}

#endif
