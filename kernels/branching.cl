/* The paper's own ray tracing (Section "Ray Tracing"), the method `branching`. In each cell that
   scatters, new rays start at random places in random directions: 1000 times the share of the ray that
   is scattered there, at most 100. These branch in turn, up to the order; light scattered beyond it
   comes from the walls. A ray ends where its transmission is below the cut-off.

   A ray waits on a stack, of one place an order, while the rays that it started are followed. If the
   rule gives a fraction of a ray, a random number rounds it up or down, so that the mean is kept.

   Each ray has its own sums, which it adds to its parent's when it ends: a million small numbers added
   to a large one would be rounded away in part. */

#include "boundary.h"
#include "components.h"
#include "linear_cell.h"
#include "phase.h"
#include "random.h"
#include "ray.h"

#ifndef HAS_SCATTERING
#error "branching.cl is for scenes that scatter: define HAS_SCATTERING"
#endif
#ifndef HIGHEST_ORDER
#error "HIGHEST_ORDER: most scatterings of a ray"
#endif

#define RAYS_PER_SHARE R(1000)
#define MOST_RAYS R(100)

/* A ray, and the rays that are still to start in the cell that it has just crossed. */
typedef struct {
    Traversal traversal;
    real weight;      /* of the ray when it started */
    real transmitted; /* of it, up to here */
    int inside;
    int waiting;      /* rays to start ... */
    real each;        /* ... of this weight ... */
    int4 low, high;   /* ... in this cell */
} Branch;

__kernel void branching(
    __global real *weights,           /* out: [part][row][column] */
    __global uint *started,           /* out: rays of each pixel */
    const uint2 key,
    __global const int *directory, __global const int *span, __global const real *depth,
    CELL_GRADIENTS_ARGUMENT __global const real *thermal, __global const real *albedo,
    const int coarse, const int stored, const int bricks,
    const int4 low, const int4 high, const int columns, const int rows, const real4 middle,
    const real pitch_x, const real pitch_z, const real distance, const real cutoff, const int order,
    BOUNDARY_ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const uint pixel = row * columns + column;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    const Grid grid = {coarse, bricks, low, high};
    const Boundary boundary = BOUNDARY;
    Branch stack[HIGHEST_ORDER + 1];
    real sums[HIGHEST_ORDER + 1][PARTS];
    for (int c = 0; c < PARTS; ++c) sums[0][c] = R(0);
    const Traversal first = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    stack[0].traversal = first;
    stack[0].weight = R(1);
    stack[0].transmitted = R(1);
    stack[0].waiting = 0;
    stack[0].inside = traversal_enter(&stack[0].traversal, &grid, ray.start);
    int level = 0;
    uint count = 0, draws = 0;
    while (level >= 0) {
        Branch b = stack[level];
        real *sum = sums[level];
        if (b.waiting > 0) {
            const uint4 place = philox((uint4)(pixel, draws++, 0, 0), key);
            const uint4 direction = philox((uint4)(pixel, draws++, 0, 0), key);
            const real3 up = (real3)(R(0), R(0), R(1));
            const real3 d = turned(up, R(1) - R(2) * unit(direction.x), unit(direction.y));
            --stack[level].waiting;
            ++count;
            ++level;
            const Traversal next = {
                b.low.x + unit(place.x) * (b.high.x - b.low.x),
                b.low.y + unit(place.y) * (b.high.y - b.low.y),
                b.low.z + unit(place.z) * (b.high.z - b.low.z),
                d.x, d.y, d.z, R(0), 0, 0, 0};
            stack[level].traversal = next;
            stack[level].weight = b.each;
            stack[level].transmitted = R(1);
            stack[level].waiting = 0;
            stack[level].inside = traversal_enter(&stack[level].traversal, &grid, R(0));
            for (int c = 0; c < PARTS; ++c) sums[level][c] = R(0);
            continue;
        }
        while (b.inside && b.transmitted > cutoff && b.waiting == 0) {
            const Crossing cell = traversal_cell(&b.traversal, &grid, directory, span);
            const real density = depth[cell.address];
            if (density > R(0)) {
                const Extinction e = extinction_along(
                    density, GRADIENTS_OF(cell_gradients, cell.address), &b.traversal, &cell);
                const real t = optical_depth(e, traversal_length(&b.traversal, &cell));
                const real shares = absorbed(t);
                const real taken = b.transmitted * shares;
                real scatters = albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
                __global const real *gradients = GRADIENTS_OF(cell_gradients, cell.address);
                const real3 place = mean_place(&b.traversal, &cell, t, shares);
                add_emission_gradient(sum, b.weight * taken, gradients, place);
                scatters = albedo_at(scatters, gradients, place);
#endif
                for (int c = 0; c < EMITTERS; ++c)
                    sum[BOUNDARIES + c] += b.weight * taken * thermal[in_table(c, stored, cell.address)];
                const real share = taken * scatters;
                sum[WITHIN] += b.weight * (taken - share);
                b.transmitted *= decay(t);
                if (level == order) {
                    sum[WALL] += b.weight * share;
                } else if (share > R(0)) {
                    const real rays = least(RAYS_PER_SHARE * share, MOST_RAYS);
                    const uint4 chance = philox((uint4)(pixel, draws++, 0, 0), key);
                    b.waiting = floor_of(rays);
                    if (unit(chance.x) < rays - floor_of(rays)) ++b.waiting;
                    b.each = b.weight * share / rays;
                    traversal_bounds(&b.traversal, &cell, &grid, &b.low, &b.high);
                }
            }
            b.inside = traversal_advance(&b.traversal, &cell, &grid);
        }
        stack[level] = b;
        if (b.waiting > 0) continue;
        if (b.transmitted > cutoff) {
            const int seen = boundary_seen(
                b.traversal.px, b.traversal.py, b.traversal.pz, b.traversal.dx, b.traversal.dy, b.traversal.dz,
                level == 0 ? ray.start : R(0), &boundary);
            for (int c = 0; c < BOUNDARIES; ++c)
                sum[c] += c == seen ? b.weight * b.transmitted : R(0);
        }
        if (level > 0)
            for (int c = 0; c < PARTS; ++c) sums[level - 1][c] += sum[c];
        --level;
    }
    for (int c = 0; c < PARTS; ++c) weights[in_table(c, rows * columns, pixel)] = sums[0][c];
    started[pixel] = count;
}
