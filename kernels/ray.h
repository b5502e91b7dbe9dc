/* The line of sight of a pixel, in units of finest cells from the cube's lower corner. */
#ifndef RAY_H
#define RAY_H

#include "real.h"

#if defined(CAMERA_PINHOLE) == defined(CAMERA_ORTHOGRAPHIC)
#error "define one of CAMERA_PINHOLE and CAMERA_ORTHOGRAPHIC"
#endif

typedef struct {
    real px, py, pz;   /* where the line crosses the target plane */
    real dx, dy, dz;   /* unit vector away from the camera */
    real start;        /* the camera's place on the line: p + start d */
} Ray;

/* column, row: pixel, row 0 on top; middle: target point; pitch: pixel width and height in the
   target plane; distance: from the camera to the target. All in cells. */
INLINE Ray pixel_ray(
    int column, int row, int columns, int rows, real4 middle, real pitch_x, real pitch_z,
    real distance)
{
    Ray ray;
    const real right = (column + R(0.5) - R(0.5) * columns) * pitch_x;
    const real up = (R(0.5) * rows - row - R(0.5)) * pitch_z;
    ray.px = middle.x + right;
    ray.py = middle.y;
    ray.pz = middle.z + up;
#ifdef CAMERA_PINHOLE
    const real length_ = sqrt(right * right + distance * distance + up * up);
    ray.dx = right / length_;
    ray.dy = distance / length_;
    ray.dz = up / length_;
    ray.start = -length_;
#else
    ray.dx = R(0);
    ray.dy = R(1);
    ray.dz = R(0);
    ray.start = -distance;
#endif
    return ray;
}

#endif
