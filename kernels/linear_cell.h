/* Emission and albedo that are linear in a cell, for path tracing and branching (LINEAR_COEFFICIENTS). Without
   it they are constant, and nothing is added. Neighbours and edges of cells, from
   which gradients follow. */
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

/* As |g| is 2 at most, a value of |s| up to 3/2 S has 3/4 S in the middle at least, and falls by 3/4 S to a
   corner: to 0, not below. */
#define MOST_IN_CELL R(4.0 / 3.0)

/* corners: x, y, z of each slot's brick. coarse: address of coarse leaf 0. */
#define TREE_ARGUMENTS \
    __global const int *directory, __global const int *span, __global const int4 *corners, \
    const int bricks, const int coarse

/* Edge of a stored cell or coarse leaf, in finest cells. */
INLINE real edge_of(int cell, int coarse, __global const int *span)
{
    return cell < coarse ? R(1) : (real)span[cell - coarse];
}

/* Address of the cell or coarse leaf beside a stored cell; beyond the cube coarse leaf 0, which is empty.
   axis: x, y, z. up: towards its end. */
INLINE int beside(
    int cell, int axis, int up, __global const int *directory, __global const int4 *corners, int bricks,
    int coarse)
{
    int slot = cell / BRICK_CELLS;
    const int own = cell % BRICK_CELLS;
    const int step = axis == 0 ? 1 : axis == 1 ? BRICK : BRICK * BRICK;
    const int at = own / step % BRICK, next = at + 2 * up - 1;
    if (next >= 0 && next < BRICK) return cell + (2 * up - 1) * step;
    const int4 corner = corners[slot];
    const int4 brick = corner + (2 * up - 1) * (int4)(axis == 0, axis == 1, axis == 2, 0);
    if (any(brick < 0) || any(brick >= bricks)) return coarse;
    slot = directory[(brick.z * bricks + brick.y) * bricks + brick.x];
    return slot < 0 ? coarse - 1 - slot : slot * BRICK_CELLS + own + (up ? 1 - BRICK : BRICK - 1) * step;
}

/* Extinction-weighted mean less the middle value of part `number`: 0 the albedo, then the emitters.
   gradients: of the cell, see extinction.h. */
INLINE real excess_of(__global const real *gradients, int number, real edge)
{
    __global const real *own = gradients + 3 * (1 + number);
    return (gradients[0] * own[0] + gradients[1] * own[1] + gradients[2] * own[2]) * edge * edge
        * R(1.0 / 12.0);
}

#endif
