/* A straight line through the bricks, cell by cell: the way of every ray but those of the sweeps.

   `directory` says where a brick's cells lie (slot >= 0), or which coarse leaf the brick is in
   (-1 - leaf); that, `span` cells along its edge, is crossed in one step. Lengths are in finest
   cells. */
#ifndef WALK_H
#define WALK_H

#include "real.h"

#define BRICK 8
#define BRICK_CELLS 512

/* Where things are stored. Cells outside low..high are empty. */
typedef struct {
    int coarse;      /* address of coarse leaf 0, which is empty space */
    int bricks;      /* along an edge of the cube */
    int4 low, high;
} Grid;

/* A place on the line p + t d, and the cell that lies ahead of it. */
typedef struct {
    real px, py, pz, dx, dy, dz;
    real t;
    int x, y, z;
} Walk;

/* The cell, or coarse leaf, that is being crossed: its bounds, and where the line leaves it. */
typedef struct {
    int address;
    int whole;
    int lx, hx, ly, hy, lz, hz;
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

/* Sets the walk, whose line is given, to where it meets the grid's bounds, or to `start` if that
   lies inside already; 0 where it misses them. */
INLINE int walk_in(Walk *w, const Grid *g, real start)
{
    w->t = most(most(distance_from(w->px, w->dx, g->low.x, g->high.x),
                     distance_from(w->py, w->dy, g->low.y, g->high.y)),
                most(distance_from(w->pz, w->dz, g->low.z, g->high.z), start));
    const real end = least(least(distance_to(w->px, w->dx, g->low.x, g->high.x),
                               distance_to(w->py, w->dy, g->low.y, g->high.y)),
                          distance_to(w->pz, w->dz, g->low.z, g->high.z));
    if (!(w->t < end)) return 0;
    w->x = cell_at(w->px + w->t * w->dx, g->low.x, g->high.x - 1);
    w->y = cell_at(w->py + w->t * w->dy, g->low.y, g->high.y - 1);
    w->z = cell_at(w->pz + w->t * w->dz, g->low.z, g->high.z - 1);
    return 1;
}

INLINE Crossing walk_ahead(
    const Walk *w, const Grid *g, __global const int *directory, __global const int *span)
{
    Crossing c;
    const int slot =
        directory[((w->z / BRICK) * g->bricks + w->y / BRICK) * g->bricks + w->x / BRICK];
    c.whole = slot < 0;
#ifdef EVERY_CELL
    const int mask = 0;
#else
    const int mask = c.whole ? span[-1 - slot] - 1 : 0;
#endif
    c.address = c.whole ? g->coarse - 1 - slot
        : slot * BRICK_CELLS + ((w->z % BRICK) * BRICK + w->y % BRICK) * BRICK + w->x % BRICK;
    c.lx = larger(w->x & ~mask, g->low.x);
    c.hx = smaller((w->x | mask) + 1, g->high.x);
    c.ly = larger(w->y & ~mask, g->low.y);
    c.hy = smaller((w->y | mask) + 1, g->high.y);
    c.lz = larger(w->z & ~mask, g->low.z);
    c.hz = smaller((w->z | mask) + 1, g->high.z);
    c.tx = distance_to(w->px, w->dx, c.lx, c.hx);
    c.ty = distance_to(w->py, w->dy, c.ly, c.hy);
    c.tz = distance_to(w->pz, w->dz, c.lz, c.hz);
    c.next = least(c.tx, least(c.ty, c.tz));
    return c;
}

/* Length of the crossing. */
INLINE real walk_length(const Walk *w, const Crossing *c) { return most(c->next - w->t, R(0)); }

/* Goes on to the next cell; 0 where the line leaves the bounds. */
INLINE int walk_on(Walk *w, const Crossing *c, const Grid *g)
{
    w->t = most(w->t, c->next);
    if (c->next == c->tx) {
        w->x = w->dx > R(0) ? c->hx : c->lx - 1;
        if (w->x < g->low.x || w->x >= g->high.x) return 0;
    } else if (c->whole) {
        w->x = cell_at(w->px + w->t * w->dx, c->lx, c->hx - 1);
    }
    if (c->next == c->ty) {
        w->y = w->dy > R(0) ? c->hy : c->ly - 1;
        if (w->y < g->low.y || w->y >= g->high.y) return 0;
    } else if (c->whole) {
        w->y = cell_at(w->py + w->t * w->dy, c->ly, c->hy - 1);
    }
    if (c->next == c->tz) {
        w->z = w->dz > R(0) ? c->hz : c->lz - 1;
        if (w->z < g->low.z || w->z >= g->high.z) return 0;
    } else if (c->whole) {
        w->z = cell_at(w->pz + w->t * w->dz, c->lz, c->hz - 1);
    }
    return 1;
}

#endif
