/* Cells that the lines of sight cross, and how many of these are not empty: the traversal of
   image.cl without the radiance. */

#include "boundary.h"
#include "ray.h"
#include "octree_traversal.h"

__kernel void count(
    __global int2 *crossings,         /* out: cells crossed, and those that are not empty */
    __global const int *directory, __global const int *span, __global const real *depth,
    const int coarse, const int stored, const int bricks,
    const int4 low, const int4 high,
    const int columns, const int rows,
    const real4 middle, const real pitch_x, const real pitch_z, const real distance,
    BOUNDARY_ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    const Grid grid = {coarse, bricks, low, high};
    Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    int2 crossed = (int2)(0, 0);
    if (traversal_enter(&traversal, &grid, ray.start)) for (;;) {
        const Crossing cell = traversal_cell(&traversal, &grid, directory, span);
        crossed += (int2)(1, depth[cell.address] > R(0) ? 1 : 0);
        if (!traversal_advance(&traversal, &cell, &grid)) break;
    }
    crossings[row * columns + column] = crossed;
}
