/* Camera model: the line of sight of a pixel, in finest cells from the cube's lower corner. */
#ifndef RAY_H
#define RAY_H

#include "real.h"

#if defined(CAMERA_PINHOLE) == defined(CAMERA_ORTHOGRAPHIC)
#error "define one of CAMERA_PINHOLE and CAMERA_ORTHOGRAPHIC"
#endif

typedef struct {
    real px, py, pz;   /* intersection of the line and the target plane */
    real dx, dy, dz;   /* unit vector away from the camera */
    real start;        /* the camera's place on the line: p + start d */
} Ray;

/* across, down: place in the image in pixels, from its upper left corner. In cells: middle, the target
   point; pitch, pixel width and height in the target plane; distance, from camera to target. */
INLINE Ray ray_at(
    real across, real down, int columns, int rows, real4 middle, real pitch_x, real pitch_z,
    real distance)
{
    Ray ray;
    const real right = (across - R(0.5) * columns) * pitch_x;
    const real up = (R(0.5) * rows - down) * pitch_z;
    ray.px = middle.x + right;
    ray.py = middle.y;
    ray.pz = middle.z + up;
#ifdef CAMERA_PINHOLE
    const real length_ = root(right * right + distance * distance + up * up);
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

/* The line through the middle of a pixel; row 0 is on top. */
INLINE Ray pixel_ray(
    int column, int row, int columns, int rows, real4 middle, real pitch_x, real pitch_z,
    real distance)
{
    return ray_at(
        column + R(0.5), row + R(0.5), columns, rows, middle, pitch_x, pitch_z, distance);
}

#endif
