/* Which direction of a set: the nearest to another, or the one at a share of what all bring. */
#ifndef DIRECTIONS_H
#define DIRECTIONS_H

#include "real.h"

#ifndef NEAREST_SIDE
#error "NEAREST_SIDE: entries of the table of directions along a side"
#endif

/* Entry of the table of nearest directions: the sphere on an octahedron, unfolded to a square
   (Cigolle et al., J. Computer Graphics Techniques 3, 2014). */
INLINE int direction_near(real3 d)
{
    const real sum = size_of(d.x) + size_of(d.y) + size_of(d.z);
    real u = d.x / sum, v = d.y / sum;
    if (d.z < R(0)) {
        const real w = (R(1) - size_of(v)) * (u < R(0) ? R(-1) : R(1));
        v = (R(1) - size_of(u)) * (v < R(0) ? R(-1) : R(1));
        u = w;
    }
    const int i = within((int)((u + R(1)) * (NEAREST_SIDE / R(2))), 0, NEAREST_SIDE - 1);
    const int j = within((int)((v + R(1)) * (NEAREST_SIDE / R(2))), 0, NEAREST_SIDE - 1);
    return j * NEAREST_SIDE + i;
}

/* Number of the direction at which the cumulative share reaches u. */
INLINE int direction_at(
    real u, __global const real4 *directions, __global const int *start, int count)
{
    int number = start[smaller((int)(u * count), count - 1)];
    while (number > 0 && directions[number - 1].w > u) --number; /* by rounding alone */
    while (number < count - 1 && directions[number].w <= u) ++number;
    return number;
}

#endif
