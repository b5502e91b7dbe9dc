/* What a straight line sees once it has left the medium: the background disc or the walls. */
#ifndef BOUNDARY_H
#define BOUNDARY_H

#include "real.h"

/* BOUNDARY_ENCLOSURE: the background surrounds everything.
   BOUNDARY_DISC: a disc that faces the camera (normal along y) in the plane disc.y. */
#if defined(BOUNDARY_ENCLOSURE) == defined(BOUNDARY_DISC)
#error "define one of BOUNDARY_ENCLOSURE and BOUNDARY_DISC"
#endif

/* 1 where the line from (px, py, pz) along (dx, dy, dz) meets the background, else 0. Only lines
   with dy > 0 meet the disc's front. disc: centre x, y, z and squared radius, in the unit of p. */
INLINE real sees_background(real px, real py, real pz, real dx, real dy, real dz, real4 disc)
{
#ifdef BOUNDARY_ENCLOSURE
    return R(1);
#else
    real s = (disc.y - py) / (dy > R(0) ? dy : R(1));
    real x = px + s * dx - disc.x;
    real z = pz + s * dz - disc.z;
    return (dy > R(0) && x * x + z * z <= disc.w) ? R(1) : R(0);
#endif
}

#endif
