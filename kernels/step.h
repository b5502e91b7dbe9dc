/* A straight line through a box of cells that are all stored, one by one. */
#ifndef STEP_H
#define STEP_H

#include "real.h"

/* A line through the box, cell by cell: how far the far sides of the cell are, and how far it is
   from side to side. */
typedef struct {
    int x, y, z;
    real t, tx, ty, tz, dx, dy, dz;
} Step;

INLINE real to_side(real place, int cell, real slope, real across)
{
    const real part = slope > R(0) ? cell + 1 - place : place - cell;
    return slope == R(0) ? R(INFINITY) : most(part, R(0)) * across;
}

INLINE Step step_from(int3 cell, real3 p, real3 d)
{
    Step s = {cell.x, cell.y, cell.z, R(0)};
    s.dx = R(1) / size_of(d.x);
    s.dy = R(1) / size_of(d.y);
    s.dz = R(1) / size_of(d.z);
    s.tx = to_side(p.x, cell.x, d.x, s.dx);
    s.ty = to_side(p.y, cell.y, d.y, s.dy);
    s.tz = to_side(p.z, cell.z, d.z, s.dz);
    return s;
}

INLINE real step_end(const Step *s) { return least(s->tx, least(s->ty, s->tz)); }

/* Through which face the line goes on: 0 to 5, down and up along x, y, z. */
INLINE int step_on(Step *s, real3 d)
{
    s->t = step_end(s);
    if (s->tx <= s->ty && s->tx <= s->tz) {
        const int up = d.x > R(0);
        s->x += up ? 1 : -1;
        s->tx += s->dx;
        return up;
    }
    if (s->ty <= s->tz) {
        const int up = d.y > R(0);
        s->y += up ? 1 : -1;
        s->ty += s->dy;
        return 2 + up;
    }
    const int up = d.z > R(0);
    s->z += up ? 1 : -1;
    s->tz += s->dz;
    return 4 + up;
}

#endif
