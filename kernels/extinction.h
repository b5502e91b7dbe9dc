/* Extinction along the crossing of a cell or coarse leaf. All rays that traverse the octree take it from
   here, so that all methods see the same medium.

   LINEAR_EXTINCTION: it varies within a cell as k (1 + g . (p - centre)). So the optical depth of a
   straight segment is exactly that at its middle times its length, and a place of given optical depth
   is the root of a quadratic. Without it k is constant. */
#ifndef EXTINCTION_H
#define EXTINCTION_H

#include "attenuation.h"
#include "octree_traversal.h"

#ifdef LINEAR_EXTINCTION
#define EXTINCTION_GRADIENT_ARGUMENT __global const real *extinction_gradient,
#define EXTINCTION_GRADIENT extinction_gradient,
#define GRADIENT_OF(table, number) ((table) + 3 * (size_t)(number))
#else
#define EXTINCTION_GRADIENT_ARGUMENT
#define EXTINCTION_GRADIENT
#define GRADIENT_OF(table, number) 0
#endif

/* Optical depth per finest cell: where the line enters, and its rise per length. */
typedef struct { real entry, rise; } Extinction;

/* density: the cell's mean. gradient: g along x, y, z, per finest cell; not read where k is constant. */
INLINE Extinction extinction_along(
    real density, __global const real *gradient, const Traversal *w, const Crossing *c)
{
#ifdef LINEAR_EXTINCTION
    const real half_ = R(0.5) * (c->mask + 1);
    const real x = w->px + w->t * w->dx - (w->x & ~c->mask) - half_;
    const real y = w->py + w->t * w->dy - (w->y & ~c->mask) - half_;
    const real z = w->pz + w->t * w->dz - (w->z & ~c->mask) - half_;
    const Extinction e = {
        density * (R(1) + gradient[0] * x + gradient[1] * y + gradient[2] * z),
        density * (gradient[0] * w->dx + gradient[1] * w->dy + gradient[2] * w->dz)};
#else
    const Extinction e = {density, R(0)};
#endif
    return e;
}

INLINE real optical_depth(Extinction e, real length)
{
#ifdef LINEAR_EXTINCTION
    return length * (e.entry + R(0.5) * length * e.rise);
#else
    return e.entry * length;
#endif
}

/* Length up to which a ray has lost `part` of the `share` that the whole crossing absorbs. */
INLINE real length_along(real part, real share, Extinction e)
{
#ifdef LINEAR_EXTINCTION
    const real t = depth_of(part * share);
    /* e.entry may be 0: then no term cancels. */
    return t > R(0) ? R(2) * t / (e.entry + root(most(e.entry * e.entry + R(2) * e.rise * t, R(0))))
        : R(0);
#else
    return length_at(part, share, e.entry);
#endif
}

#endif
