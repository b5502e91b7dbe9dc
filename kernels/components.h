/* Components: the parts of the radiance by origin. All go through the same trace. First come those of
   the boundary: background, wall, and N_PATCHES patches of the enclosure; then the
   EMITTERS in the medium: vapour and liquid, where the scene has them. And the limiter of their gradients within cells. */
#ifndef COMPONENTS_H
#define COMPONENTS_H

#include "real.h"

#define BACKGROUND 0
#define WALL 1

#ifdef N_PATCHES
#define BOUNDARIES (2 + N_PATCHES)
#else
#define BOUNDARIES 2
#endif

#ifndef EMITTERS
#define EMITTERS 0
#endif

#define COMPONENTS (BOUNDARIES + EMITTERS)

/* Parts of a ray's sum: the components, and what a medium and an enclosure of radiance 1 add from within
   the medium. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)

/* Factor up to 1 with which a sum of |gradient| along the axes is at most twice the mean. */
INLINE real allowed_share(real steepness, real mean)
{
    return steepness > R(2) * mean ? R(2) * mean / steepness : R(1);
}

/* Limits the gradient [axis][part] of a cell, so that no part is negative anywhere in it.

   The means, `light`, are conserved, as by the slope limiters of finite volumes (van Leer, J. Comput. Phys.
   32, 1979). The excess of a part goes to the others of its group, the first `boundaries` ones from
   outside or those that the medium emits, by their shares of the light. So the sums of both groups keep
   their gradients, which are opposite in an isothermal cavity. If the others cannot take it, all gradients
   of the cell shrink by one factor. */
INLINE void limit_gradient(real *gradient, const real *light, int boundaries, int parts)
{
    real total[2], factor = R(1);
    UNROLL for (int group = 0; group < 2; ++group) {
        const int first = group ? boundaries : 0, end = group ? parts : boundaries;
        real steepness = R(0);
        total[group] = R(0);
        for (int c = first; c < end; ++c) total[group] += most(light[c], R(0));
        for (int axis = 0; axis < 3; ++axis) {
            real sum = R(0);
            for (int c = first; c < end; ++c) sum += gradient[axis * parts + c];
            steepness += size_of(factor * sum);
        }
        factor *= allowed_share(steepness, total[group]);
    }
    for (int n = 0; n < 3 * parts; ++n) gradient[n] *= factor;
    UNROLL for (int group = 0; group < 2; ++group) {
        const int first = group ? boundaries : 0, end = group ? parts : boundaries;
        real missing[3] = {R(0), R(0), R(0)};
        for (int c = first; c < end; ++c) {
            real steepness = R(0);
            for (int axis = 0; axis < 3; ++axis) steepness += size_of(gradient[axis * parts + c]);
            const real share = allowed_share(steepness, most(light[c], R(0)));
            for (int axis = 0; axis < 3; ++axis) {
                const real whole = gradient[axis * parts + c];
                gradient[axis * parts + c] = share * whole;
                missing[axis] += whole - share * whole;
            }
        }
        for (int c = first; c < end; ++c)
            for (int axis = 0; axis < 3; ++axis)
                gradient[axis * parts + c] +=
                    total[group] > R(0) ? missing[axis] * (most(light[c], R(0)) / total[group]) : R(0);
    }
    factor = R(1);
    for (int c = 0; c < parts; ++c) {
        real steepness = R(0);
        for (int axis = 0; axis < 3; ++axis) steepness += size_of(gradient[axis * parts + c]);
        factor = least(factor, allowed_share(steepness, most(light[c], R(0))));
    }
    for (int n = 0; n < 3 * parts; ++n) gradient[n] *= factor;
}

#endif
