/* Which direction of a set: the nearest to another, or the one at a share of what all bring. */
#ifndef DIRECTIONS_H
#define DIRECTIONS_H

#include "real.h"

#ifndef FACE
#error "FACE: entries of the table of directions along a side"
#endif

/* Entry of the table of nearest directions: the sphere on an octahedron, unfolded to a square
   (Cigolle et al., J. Computer Graphics Techniques 3, 2014). */
INLINE int direction_near(real3 d)
{
    const real sum = fabs(d.x) + fabs(d.y) + fabs(d.z);
    real u = d.x / sum, v = d.y / sum;
    if (d.z < R(0)) {
        const real w = (R(1) - fabs(v)) * copysign(R(1), u);
        v = (R(1) - fabs(u)) * copysign(R(1), v);
        u = w;
    }
    const int i = clamp((int)((u + R(1)) * (FACE / R(2))), 0, FACE - 1);
    const int j = clamp((int)((v + R(1)) * (FACE / R(2))), 0, FACE - 1);
    return j * FACE + i;
}

/* Number of the direction at which the cumulative share reaches u. */
INLINE int direction_at(
    real u, __global const real4 *directions, __global const int *start, int count)
{
    int number = start[min((int)(u * count), count - 1)];
    while (number > 0 && directions[number - 1].w > u) --number; /* by rounding alone */
    while (number < count - 1 && directions[number].w <= u) ++number;
    return number;
}

#endif
