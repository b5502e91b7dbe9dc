/* The picture: one ray a pixel from the camera through the bricks, front to back.

   Each cell of optical depth t adds T (1 - exp(-t)) S to the pixel, T being what is still
   transmitted. S, the source of the cell, has a component for the light that began at the
   background, at the walls and their patches, in the vapour and in the droplets. Without scattering
   those from outside are nothing, and are not compiled in.

   The last plane is what a medium and an enclosure of radiance 1 add from within the medium: with the
   weights of what is outside it makes 1 in every pixel, unless light is made or lost. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "ray.h"
#include "walk.h"

#ifdef HAS_SCATTERING
#define FIRST_SOURCE 0
#else
#define FIRST_SOURCE BOUNDARIES
#endif
#define SOURCES (COMPONENTS - FIRST_SOURCE)

#ifdef HAS_SCATTERING
#define ISOTHERMAL(address) isothermal[address]
#else
#define ISOTHERMAL(address) R(1)
#endif

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif

__kernel void image(
    __global real *weights,           /* out: [component][row][column], and the part from within */
    __global const int *directory,    /* in: brick -> slot, or -1 - coarse leaf; [z][y][x] */
    __global const int *span,         /* in: cells along the edge of each coarse leaf */
    __global const real *depth,       /* in: optical depth of a cell's edge, per stored cell */
    __global const real *source,      /* in: S, one plane of stored cells a component */
#ifdef HAS_SCATTERING
    __global const real *isothermal,  /* in: S of what is emitted at radiance 1 */
#endif
    const int coarse,                 /* address of coarse leaf 0 */
    const int stored,                 /* length of a plane */
    const int bricks,
    const int4 low, const int4 high,  /* cells outside these bounds are empty */
    const int columns, const int rows,
    const real4 middle, const real pitch_x, const real pitch_z, const real distance,
    BOUNDARY_ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    const Grid grid = {coarse, bricks, low, high};
    Walk walk = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};

    real sum[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) sum[c] = R(0);
    real transmitted = R(1), within = R(0);
    int last = coarse;

    if (walk_in(&walk, &grid, ray.start)) while (transmitted > R(CUTOFF)) {
        const Crossing cell = walk_ahead(&walk, &grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const real taken = transmitted * absorbed(density * walk_length(&walk, &cell));
            for (int c = 0; c < SOURCES; ++c)
                sum[FIRST_SOURCE + c] += taken * source[c * stored + cell.address];
            within += taken * ISOTHERMAL(cell.address);
            transmitted -= taken;
            last = cell.address;
        }
        if (!walk_on(&walk, &cell, &grid)) break;
    }

    if (transmitted > R(CUTOFF)) {
        const Boundary boundary = BOUNDARY;
        const int seen = boundary_seen(
            ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, ray.start, &boundary);
        for (int c = 0; c < BOUNDARIES; ++c) sum[c] += c == seen ? transmitted : R(0);
    } else {
        /* The little that is left goes as deep as the last cell looks: it takes that cell's source,
           which costs no light and errs by CUTOFF times the change of S beyond. */
        for (int c = 0; c < SOURCES; ++c)
            sum[FIRST_SOURCE + c] += transmitted * source[c * stored + last];
        within += transmitted * ISOTHERMAL(last);
    }
    const int pixel = row * columns + column;
    for (int c = 0; c < COMPONENTS; ++c) weights[c * rows * columns + pixel] = sum[c];
    weights[COMPONENTS * rows * columns + pixel] = within;
}
