/* The picture: one ray a pixel from the camera through the bricks, front to back.

   Each cell of optical depth t adds T (1 - exp(-t)) S to the pixel, T being what is still
   transmitted. S, the source of the cell, has a component for the light that began at the
   background, at the walls, in the vapour and in the droplets. Without scattering the first two
   are nothing, and are not compiled in. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "ray.h"

#ifdef HAS_SCATTERING
#define FIRST_SOURCE 0
#else
#define FIRST_SOURCE 2
#endif
#define SOURCES (COMPONENTS - FIRST_SOURCE)

#define BRICK 8
#define BRICK_CELLS 512

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif

/* Distance along the line to the far side, on one axis, of the box low..high. */
inline real distance_to(real place, real slope, real low, real high)
{
    return slope == R(0) ? R(INFINITY) : ((slope > R(0) ? high : low) - place) / slope;
}

/* Distance to the near side; -infinity where the line runs inside the slab, +infinity outside. */
inline real distance_from(real place, real slope, real low, real high)
{
    if (slope == R(0)) return place >= low && place < high ? R(-INFINITY) : R(INFINITY);
    return ((slope > R(0) ? low : high) - place) / slope;
}

inline int cell_at(real place, int low, int high)
{
    return clamp((int)floor(place), low, high);
}

__kernel void image(
    __global real *weights,           /* out: [component][row][column] */
    __global const int *directory,    /* in: brick -> slot, or -1 - coarse leaf; [z][y][x] */
    __global const int *span,         /* in: cells along the edge of each coarse leaf */
    __global const real *depth,       /* in: optical depth of a cell's edge, per stored cell */
    __global const real *source,      /* in: S, one plane of stored cells a component */
    const int coarse,                 /* address of coarse leaf 0 */
    const int stored,                 /* length of a plane */
    const int bricks,
    const int4 low, const int4 high,  /* cells outside these bounds are empty */
    const int columns, const int rows,
    const real4 middle, const real pitch_x, const real pitch_z, const real distance,
    const real4 disc)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);

    real sum[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) sum[c] = R(0);
    real transmitted = R(1);
    int last = coarse;

    real t = fmax(fmax(distance_from(ray.px, ray.dx, low.x, high.x),
                       distance_from(ray.py, ray.dy, low.y, high.y)),
                  fmax(distance_from(ray.pz, ray.dz, low.z, high.z), ray.start));
    const real end = fmin(fmin(distance_to(ray.px, ray.dx, low.x, high.x),
                               distance_to(ray.py, ray.dy, low.y, high.y)),
                          distance_to(ray.pz, ray.dz, low.z, high.z));
    if (t < end) {
        int x = cell_at(ray.px + t * ray.dx, low.x, high.x - 1);
        int y = cell_at(ray.py + t * ray.dy, low.y, high.y - 1);
        int z = cell_at(ray.pz + t * ray.dz, low.z, high.z - 1);
        while (transmitted > R(CUTOFF)) {
            const int slot = directory[((z / BRICK) * bricks + y / BRICK) * bricks + x / BRICK];
            const int whole = slot < 0;   /* the brick is in one leaf: cross that in one step */
            const int mask = whole ? span[-1 - slot] - 1 : 0;
            const int address = whole ? coarse - 1 - slot
                : slot * BRICK_CELLS + ((z % BRICK) * BRICK + y % BRICK) * BRICK + x % BRICK;
            const int lx = max(x & ~mask, low.x), hx = min((x | mask) + 1, high.x);
            const int ly = max(y & ~mask, low.y), hy = min((y | mask) + 1, high.y);
            const int lz = max(z & ~mask, low.z), hz = min((z | mask) + 1, high.z);
            const real tx = distance_to(ray.px, ray.dx, lx, hx);
            const real ty = distance_to(ray.py, ray.dy, ly, hy);
            const real tz = distance_to(ray.pz, ray.dz, lz, hz);
            const real next = fmin(tx, fmin(ty, tz));

            const real density = depth[address];
            if (density > R(0)) {
                const real taken = transmitted * absorbed(density * fmax(next - t, R(0)));
                for (int c = 0; c < SOURCES; ++c)
                    sum[FIRST_SOURCE + c] += taken * source[c * stored + address];
                transmitted -= taken;
                last = address;
            }

            t = fmax(t, next);
            if (next == tx) {
                x = ray.dx > R(0) ? hx : lx - 1;
                if (x < low.x || x >= high.x) break;
            } else if (whole) {
                x = cell_at(ray.px + t * ray.dx, lx, hx - 1);
            }
            if (next == ty) {
                y = ray.dy > R(0) ? hy : ly - 1;
                if (y < low.y || y >= high.y) break;
            } else if (whole) {
                y = cell_at(ray.py + t * ray.dy, ly, hy - 1);
            }
            if (next == tz) {
                z = ray.dz > R(0) ? hz : lz - 1;
                if (z < low.z || z >= high.z) break;
            } else if (whole) {
                z = cell_at(ray.pz + t * ray.dz, lz, hz - 1);
            }
        }
    }

    if (transmitted > R(CUTOFF)) {
        const real seen = sees_background(
            ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, disc);
        sum[BACKGROUND] += transmitted * seen;
        sum[WALL] += transmitted * (R(1) - seen);
    } else {
        /* The little that is left goes as deep as the last cell looks: it takes that cell's source,
           which costs no light and errs by CUTOFF times the change of S beyond. */
        for (int c = 0; c < SOURCES; ++c)
            sum[FIRST_SOURCE + c] += transmitted * source[c * stored + last];
    }
    const int pixel = row * columns + column;
    for (int c = 0; c < COMPONENTS; ++c) weights[c * rows * columns + pixel] = sum[c];
}
