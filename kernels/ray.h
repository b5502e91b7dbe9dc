/* Camera model: the line of sight of a pixel, in finest cells from the cube's lower corner. */
#ifndef RAY_H
#define RAY_H

#include "real.h"

typedef struct {
    real px, py, pz;   /* intersection of the line and the target plane */
    real dx, dy, dz;   /* unit vector away from the camera */
    real start;        /* the camera's place on the line: p + start d */
} Ray;

/* across, down: place in the image in pixels, from its upper left corner, where the ray crosses the
   target plane. In cells: lens_x, lens_z, the point of the aperture that the ray passes, right of its
   middle and above; middle, the target point, and 1 for a pinhole, 0 for parallel rays; pitch, pixel width
   and height in the target plane; distance, from camera to target. */
INLINE Ray ray_at(
    real across, real down, real lens_x, real lens_z, int columns, int rows, real4 middle, real pitch_x,
    real pitch_z, real distance)
{
    Ray ray;
    const real right = (across - R(0.5) * columns) * pitch_x;
    const real up = (R(0.5) * rows - down) * pitch_z;
    ray.px = middle.x + right;
    ray.py = middle.y;
    ray.pz = middle.z + up;
    const real x = middle.w > R(0) ? right - lens_x : R(0), z = middle.w > R(0) ? up - lens_z : R(0);
    const real length_ = root(x * x + distance * distance + z * z);
    ray.dx = x / length_;
    ray.dy = distance / length_;
    ray.dz = z / length_;
    ray.start = -length_;
    return ray;
}

/* The line through the middles of a pixel and of the aperture; row 0 is on top. */
INLINE Ray pixel_ray(
    int column, int row, int columns, int rows, real4 middle, real pitch_x, real pitch_z,
    real distance)
{
    return ray_at(
        column + R(0.5), row + R(0.5), R(0), R(0), columns, rows, middle, pitch_x, pitch_z, distance);
}

#endif
