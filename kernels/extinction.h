/* Extinction along the crossing of a cell or coarse leaf, for all rays that traverse the octree, so that
   all methods see the same medium.

   LINEAR_COEFFICIENTS: it varies within a cell as k (1 + g . (p - centre)). So the optical depth of a
   straight segment is exactly that at its middle times its length, and a place of given optical depth
   is the root of a quadratic. Without it k is constant. */
#ifndef EXTINCTION_H
#define EXTINCTION_H

#include "attenuation.h"
#include "octree_traversal.h"

#ifdef LINEAR_COEFFICIENTS
/* Of each stored cell: gradients along x, y, z of the extinction over its mean, of the albedo, and of each
   emitter's source. */
#define CELL_GRADIENTS_ARGUMENT __global const real *cell_gradients,
#define CELL_GRADIENTS cell_gradients,
#define GRADIENTS_OF(table, number) ((table) + (3 * (2 + EMITTERS)) * (size_t)(number))
#else
#define CELL_GRADIENTS_ARGUMENT
#define CELL_GRADIENTS
#define GRADIENTS_OF(table, number) 0
#endif

/* Place of the line at t, from the middle of the cell or leaf. */
INLINE real3 place_in(const Traversal *w, const Crossing *c, real t)
{
    const real half_ = R(0.5) * (c->mask + 1);
    return (real3)(
        w->px + t * w->dx - (w->x & ~c->mask) - half_,
        w->py + t * w->dy - (w->y & ~c->mask) - half_,
        w->pz + t * w->dz - (w->z & ~c->mask) - half_);
}

INLINE real along_gradient(__global const real *gradient, real3 place)
{
    return gradient[0] * place.x + gradient[1] * place.y + gradient[2] * place.z;
}

/* Optical depth per finest cell: where the line enters, and its rise per length. */
typedef struct { real entry, rise; } Extinction;

/* density: the cell's mean. gradient: g along x, y, z, per finest cell; not read where k is constant. */
INLINE Extinction extinction_along(
    real density, __global const real *gradient, const Traversal *w, const Crossing *c)
{
#ifdef LINEAR_COEFFICIENTS
    const Extinction e = {
        density * (R(1) + along_gradient(gradient, place_in(w, c, w->t))),
        density * (gradient[0] * w->dx + gradient[1] * w->dy + gradient[2] * w->dz)};
#else
    const Extinction e = {density, R(0)};
#endif
    return e;
}

INLINE real optical_depth(Extinction e, real length)
{
#ifdef LINEAR_COEFFICIENTS
    return length * (e.entry + R(0.5) * length * e.rise);
#else
    return e.entry * length;
#endif
}

/* Length up to which a ray has lost `part` of the `share` that the whole crossing absorbs. */
INLINE real length_along(real part, real share, Extinction e)
{
#ifdef LINEAR_COEFFICIENTS
    const real t = depth_of(part * share);
    /* e.entry may be 0: then no term cancels. */
    return t > R(0) ? R(2) * t / (e.entry + root(most(e.entry * e.entry + R(2) * e.rise * t, R(0))))
        : R(0);
#else
    return length_at(part, share, e.entry);
#endif
}

#endif
