/* Emission and albedo that are linear in a cell, for path tracing and branching (LINEAR_COEFFICIENTS). Without
   it they are constant, and nothing is added. */
#ifndef LINEAR_CELL_H
#define LINEAR_CELL_H

#include "components.h"
#include "extinction.h"

#ifdef LINEAR_COEFFICIENTS
/* Mean place of what reaches the beginning of a crossing of optical depth t from within it, nearer than its
   middle. share: absorbed(t). */
INLINE real3 mean_place(const Traversal *w, const Crossing *c, real t, real share)
{
    const real nearer =
        share > R(0) ? t * rising(t, share, mean_transmission(t, share)) / share : R(0);
    return place_in(w, c, R(0.5) * (w->t + c->next) - nearer * (c->next - w->t));
}

/* Adds what the emission at `place` is above that in the middle. */
INLINE void add_emission_gradient(real *sum, real taken, __global const real *gradients, real3 place)
{
    for (int e = 0; e < EMITTERS; ++e)
        sum[BOUNDARIES + e] += taken * along_gradient(gradients + 6 + 3 * e, place);
}

INLINE real albedo_at(real albedo, __global const real *gradients, real3 place)
{
    return albedo + along_gradient(gradients + 3, place);
}
#endif

#endif
