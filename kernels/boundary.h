/* The boundary that a straight line ends on beyond the medium: background, walls or a patch. All
   methods use it. */
#ifndef BOUNDARY_H
#define BOUNDARY_H

#include "components.h"
#include "real.h"

/* disc: the background, a disc in the plane disc.y that faces the camera (normal along y): centre x, y, z and
   squared radius; infinite: the background surrounds everything. patches, N_PATCHES in front of it or beside it, four rows each: normal and offset of the plane;
   centre, and 1 for a rectangle; unit vectors across and up, over the half-width and half-height. All
   in the unit of the lines. */
typedef struct {
    real4 disc;
#ifdef N_PATCHES
    __constant const real4 *patches;
#endif
} Boundary;

#ifdef N_PATCHES
#define BOUNDARY_ARGUMENTS const real4 disc, __constant const real4 *patches
#define BOUNDARY {disc, patches}
#else
#define BOUNDARY_ARGUMENTS const real4 disc
#define BOUNDARY {disc}
#endif

/* 1 where the line from (px, py, pz) along (dx, dy, dz) intersects the background, else 0. Only lines
   with dy > 0 intersect the disc's front. disc: as in Boundary. */
INLINE real sees_background(real px, real py, real pz, real dx, real dy, real dz, real4 disc)
{
    real s = (disc.y - py) / (dy > R(0) ? dy : R(1));
    real x = px + s * dx - disc.x;
    real z = pz + s * dz - disc.z;
    return disc.w == R(INFINITY) || (dy > R(0) && x * x + z * z <= disc.w) ? R(1) : R(0);
}

INLINE real along(real4 a, real x, real y, real z) { return a.x * x + a.y * y + a.z * z; }

/* The component whose radiance reaches p along the line p + t d, t >= from. In one plane the background
   comes first, then the patches in their order: at equal distances `<` keeps the first. */
INLINE int boundary_seen(
    real px, real py, real pz, real dx, real dy, real dz, real from, const Boundary *b)
{
    int seen = sees_background(px, py, pz, dx, dy, dz, b->disc) > R(0) ? BACKGROUND : WALL;
#ifdef N_PATCHES
    real nearest = R(INFINITY);
    if (seen == BACKGROUND && b->disc.w < R(INFINITY)) nearest = (b->disc.y - py) / dy;
    for (int k = 0; k < N_PATCHES; ++k) {
        const real4 plane = b->patches[4 * k], centre = b->patches[4 * k + 1];
        const real against = -along(plane, dx, dy, dz);
        if (!(against > R(0))) continue;
        const real s = (along(plane, px, py, pz) - plane.w) / against;
        if (!(s >= from && s < nearest)) continue;
        const real x = px + s * dx - centre.x;
        const real y = py + s * dy - centre.y;
        const real z = pz + s * dz - centre.z;
        const real u = size_of(along(b->patches[4 * k + 2], x, y, z));
        const real v = size_of(along(b->patches[4 * k + 3], x, y, z));
        if (centre.w > R(0) ? most(u, v) <= R(1) : u * u + v * v <= R(1)) {
            nearest = s;
            seen = BOUNDARIES - N_PATCHES + k;
        }
    }
#endif
    return seen;
}

#endif
