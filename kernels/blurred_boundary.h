/* The boundary as the forward peak of the phase function blurs it, in the final sweeps and the final
   gather (stages 3 and 5 of `trace_source`; cldit/transport/discrete_ordinates/blurred_boundary.py).

   BLURRED_BOUNDARY, the places along a side of its maps: radiance starts from the blurred boundary. What
   the boundary has beyond that, the excess, is carried beside it, and all of the extinction attenuates it.
   Excesses of all components sum to 0, so the wall's is not carried. */
#ifndef BLURRED_BOUNDARY_H
#define BLURRED_BOUNDARY_H

#include "components.h"
#include "real.h"

#ifdef BLURRED_BOUNDARY
#define EXCESSES (BOUNDARIES - 1)
#define EXCESS_OF(k) ((k) == 0 ? BACKGROUND : (k) + WALL) /* component of excess number k */

/* A map of BLURRED_BOUNDARY x BLURRED_BOUNDARY places at (a, b), in places, by bilinear interpolation; a
   place beyond its sides is that on the side. */
INLINE real in_map(__global const real *map, real a, real b)
{
    const real last = R(BLURRED_BOUNDARY - 1);
    const real x = most(R(0), least(a, last)), y = most(R(0), least(b, last));
    const int column = within((int)x, 0, BLURRED_BOUNDARY - 2);
    const int row = within((int)y, 0, BLURRED_BOUNDARY - 2);
    __global const real *at = map + row * BLURRED_BOUNDARY + column;
    const real right = x - column, down = y - row;
    const real upper = at[0] + right * (at[1] - at[0]);
    const real lower_ = at[BLURRED_BOUNDARY] + right * (at[BLURRED_BOUNDARY + 1] - at[BLURRED_BOUNDARY]);
    return upper + down * (lower_ - upper);
}

#else
#define EXCESSES 0
#endif

/* Numbers of a ray, and of stored radiance. */
#define RAY_PLANES (COMPONENTS + EXCESSES)

#endif
