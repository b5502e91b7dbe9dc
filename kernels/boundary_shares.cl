/* What pixels see of the boundary, without the medium. */
#include "boundary.h"
#include "ray.h"

/* Rays of each listed pixel that end on each part of the boundary; `places` and `ranges` as in image.cl. */
__kernel void boundary_shares(
    __global int *seen, /* BOUNDARIES planes of `count` */
    __global const int *list, const int count, __global const real4 *places,
    __global const int2 *ranges, const int columns, const int rows, const real4 middle, const real pitch_x,
    const real pitch_z, const real distance, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const Boundary boundary = BOUNDARY;
    const int column = list[item] % columns, row = list[item] / columns;
    int ends[BOUNDARIES];
    for (int part = 0; part < BOUNDARIES; ++part) ends[part] = 0;
    const int first = ranges[item].x, rays = ranges[item].y;
    for (int one = 0; one < rays; ++one) {
        const real4 at = places[first + one];
        const Ray ray = ray_at(
            column + at.x, row + at.y, at.z, at.w, columns, rows, middle, pitch_x, pitch_z, distance);
        ++ends[boundary_seen(ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, ray.start, &boundary)];
    }
    for (int part = 0; part < BOUNDARIES; ++part) seen[in_table(part, count, item)] = ends[part];
}
