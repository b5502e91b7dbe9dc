/* Octree traversal: a straight line from cell to cell through the bricks (3-D DDA: Amanatides and Woo,
   Eurographics 1987), for all rays but those of the sweeps: images, the final gather (stages 4 and 5 of
   `trace_source`), path tracing.

   `directory` holds a brick's slot of stored cells (>= 0), or -1 - the coarse leaf that the brick lies
   in. A coarse leaf has `span` cells along its edge and is crossed at once. Lengths are in finest
   cells. */
#ifndef OCTREE_TRAVERSAL_H
#define OCTREE_TRAVERSAL_H

#include "real.h"

#define BRICK 8
#define BRICK_CELLS 512

/* Storage of the cells. Cells outside low..high are empty. */
typedef struct {
    int coarse;      /* address of coarse leaf 0, which is empty space */
    int bricks;      /* along an edge of the cube */
    int4 low, high;
} Grid;

/* A place on the line p + t d, and the cell ahead of it. rx, ry, rz: 1 / d, set by traversal_enter. */
typedef struct {
    real px, py, pz, dx, dy, dz;
    real t;
    int x, y, z;
    real rx, ry, rz;
} Traversal;

/* The cell or coarse leaf that is being crossed. fx, fy, fz: its far sides, the lower ones where the
   line runs down. tx, ty, tz: where the line intersects them. next: where it leaves. */
typedef struct {
    int address;
    int mask; /* cells along the edge of a coarse leaf, less one; 0 for a stored cell */
    int fx, fy, fz;
    real tx, ty, tz, next;
} Crossing;

/* Distance along the line to the far side, on one axis, of the box low..high. */
INLINE real distance_to(real place, real slope, real low, real high)
{
    return slope == R(0) ? R(INFINITY) : ((slope > R(0) ? high : low) - place) / slope;
}

/* Distance to the near side; -infinity where the line runs inside the slab, +infinity outside. */
INLINE real distance_from(real place, real slope, real low, real high)
{
    if (slope == R(0)) return place >= low && place < high ? R(-INFINITY) : R(INFINITY);
    return ((slope > R(0) ? low : high) - place) / slope;
}

INLINE int cell_at(real place, int low, int high)
{
    return within(floor_of(place), low, high);
}

/* Sets a traversal, whose line is given, to the place where the line enters the grid's bounds, or to
   `start` if that lies inside. Returns 0 where the line misses them. */
INLINE int traversal_enter(Traversal *w, const Grid *g, real start)
{
    w->t = most(most(distance_from(w->px, w->dx, g->low.x, g->high.x),
                     distance_from(w->py, w->dy, g->low.y, g->high.y)),
                most(distance_from(w->pz, w->dz, g->low.z, g->high.z), start));
    const real end = least(least(distance_to(w->px, w->dx, g->low.x, g->high.x),
                               distance_to(w->py, w->dy, g->low.y, g->high.y)),
                          distance_to(w->pz, w->dz, g->low.z, g->high.z));
    if (!(w->t < end)) return 0;
    w->rx = R(1) / w->dx;
    w->ry = R(1) / w->dy;
    w->rz = R(1) / w->dz;
    w->x = cell_at(w->px + w->t * w->dx, g->low.x, g->high.x - 1);
    w->y = cell_at(w->py + w->t * w->dy, g->low.y, g->high.y - 1);
    w->z = cell_at(w->pz + w->t * w->dz, g->low.z, g->high.z - 1);
    return 1;
}

/* Far side of the cell or coarse leaf that a coordinate lies in. */
INLINE int far_side(int cell, int mask, real slope, int low, int high)
{
    return slope < R(0) ? larger(cell & ~mask, low) : smaller((cell | mask) + 1, high);
}

INLINE Crossing traversal_cell(
    const Traversal *w, const Grid *g, __global const int *directory, __global const int *span)
{
    Crossing c;
    /* Cells are never negative: unsigned, for shifts. */
    const uint x = w->x, y = w->y, z = w->z;
    const int slot = directory[((z / BRICK) * g->bricks + y / BRICK) * g->bricks + x / BRICK];
    c.address = slot * BRICK_CELLS + (int)(((z % BRICK) * BRICK + y % BRICK) * BRICK + x % BRICK);
    c.mask = 0;
    c.fx = w->x + (w->dx < R(0) ? 0 : 1);
    c.fy = w->y + (w->dy < R(0) ? 0 : 1);
    c.fz = w->z + (w->dz < R(0) ? 0 : 1);
    if (slot < 0) {
        c.address = g->coarse - 1 - slot;
        c.mask = span[-1 - slot] - 1;
        c.fx = far_side(w->x, c.mask, w->dx, g->low.x, g->high.x);
        c.fy = far_side(w->y, c.mask, w->dy, g->low.y, g->high.y);
        c.fz = far_side(w->z, c.mask, w->dz, g->low.z, g->high.z);
    }
    /* Where d is 0 the far side is the upper one, which lies above p: infinity. */
    c.tx = (c.fx - w->px) * w->rx;
    c.ty = (c.fy - w->py) * w->ry;
    c.tz = (c.fz - w->pz) * w->rz;
    c.next = least(c.tx, least(c.ty, c.tz));
    return c;
}

/* Bounds of the cell, or of the part of the coarse leaf, that is crossed. */
INLINE void traversal_bounds(const Traversal *w, const Crossing *c, const Grid *g, int4 *low, int4 *high)
{
    const int4 cell = (int4)(w->x, w->y, w->z, 0);
    const int4 inside = (int4)(1, 1, 1, 0);
    *low = max(cell & ~c->mask, g->low) * inside;
    *high = min((cell | c->mask) + 1, g->high) * inside;
}

/* Length of the crossing. */
INLINE real traversal_length(const Traversal *w, const Crossing *c) { return most(c->next - w->t, R(0)); }

/* The cell beyond the far side, where the line crosses it; else the cell within the leaf. */
INLINE int cell_beyond(int cell, int mask, int side, int crosses, real place, real slope, int limit)
{
    const int down = slope < R(0);
    if (crosses) return down ? side - 1 : side;
    if (mask == 0) return cell;
    const int other = down ? (cell | mask) : (cell & ~mask);
    return down ? cell_at(place, side, smaller(other, limit))
        : cell_at(place, larger(other, limit), side - 1);
}

/* Advances to the next cell. Returns 0 where the line leaves the bounds. */
INLINE int traversal_advance(Traversal *w, const Crossing *c, const Grid *g)
{
    w->t = most(w->t, c->next);
    const int mx = c->next == c->tx, my = c->next == c->ty, mz = c->next == c->tz;
    if (c->mask) {
        w->x = cell_beyond(w->x, c->mask, c->fx, mx, w->px + w->t * w->dx, w->dx,
                           w->dx < R(0) ? g->high.x - 1 : g->low.x);
        w->y = cell_beyond(w->y, c->mask, c->fy, my, w->py + w->t * w->dy, w->dy,
                           w->dy < R(0) ? g->high.y - 1 : g->low.y);
        w->z = cell_beyond(w->z, c->mask, c->fz, mz, w->pz + w->t * w->dz, w->dz,
                           w->dz < R(0) ? g->high.z - 1 : g->low.z);
    } else {
        /* No branches: one in three would be taken, at random. */
        w->x += mx ? (w->dx < R(0) ? -1 : 1) : 0;
        w->y += my ? (w->dy < R(0) ? -1 : 1) : 0;
        w->z += mz ? (w->dz < R(0) ? -1 : 1) : 0;
    }
    return w->x >= g->low.x && w->x < g->high.x && w->y >= g->low.y && w->y < g->high.y
        && w->z >= g->low.z && w->z < g->high.z;
}

#endif
