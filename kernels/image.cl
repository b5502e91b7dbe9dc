/* Pictures: one ray a pixel from the camera through the bricks, front to back.

   Each cell of optical depth t adds T (1 - exp(-t)) S to the pixel, T being what is still
   transmitted. S, the source of the cell, has a component for the light that began at the
   background, at the walls and their patches, in the vapour and in the droplets. Without scattering
   those from outside are nothing, and are not compiled in. IMAGES of as many sources are made at
   once: the way through the cells is the same.

   With LINEAR_SOURCE the source of cells that scatter changes across them, as the light in them does that the
   sweeps found: a cell is many pixels wide.

   With GATHER the source of thick cells is what they emit alone; what they scatter is gathered later
   (gather.cl), where the last plane says that there is any.

   After its components each picture has a plane of what a medium and an enclosure of radiance 1 add
   from within the medium: with the weights of what is outside it makes 1 in every pixel, unless light
   is made or lost. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "ray.h"
#include "octree_traversal.h"

#ifdef HAS_SCATTERING
#define FIRST_SOURCE 0
#else
#define FIRST_SOURCE BOUNDARIES
#endif
#define SOURCES (COMPONENTS - FIRST_SOURCE)

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif
#ifndef IMAGES
#error "IMAGES: how many are made at once"
#endif

/* Of a picture's sum: the components, and the part from within at radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)

/* Of all sums: the pictures', and what is left to gather. */
#define LEFT (IMAGES * PARTS)
#ifdef GATHER
#define PLANES (LEFT + 1)
#else
#define PLANES LEFT
#endif

/* A cell's record: optical depth of its edge; albedo, if it is thick; for each picture the source,
   and what is emitted at radiance 1, which is all where nothing scatters. */
#ifdef GATHER
#define ALBEDO 1
#define FIRST 2
#else
#define FIRST 1
#endif
#ifdef HAS_SCATTERING
#define ONE (SOURCES + 1)
#else
#define ONE SOURCES
#endif
#define RECORD (FIRST + IMAGES * ONE)

/* What a line meets. */
typedef struct {
    __global const int *directory; /* brick -> slot, or -1 - coarse leaf; [z][y][x] */
    __global const int *span;      /* cells along the edge of each coarse leaf */
    __global const int *number;    /* of a stored cell's record; below 0 where it is empty */
    __global const real *records;
#ifdef LINEAR_SOURCE
    __global const real *changes;  /* of the sources across each cell along x, y, z: of the first */
    int scattering;                /* so many records */
#endif
    Grid grid;
    Boundary boundary;
} Medium;

INLINE void add_source(real *sum, real taken, __global const real *record)
{
    UNROLL for (int p = 0; p < IMAGES; ++p) {
        __global const real *source = record + FIRST + p * ONE;
        UNROLL for (int c = 0; c < SOURCES; ++c) sum[p * PARTS + FIRST_SOURCE + c] += taken * source[c];
#ifdef HAS_SCATTERING
        sum[p * PARTS + WITHIN] += taken * source[SOURCES];
#else
        sum[p * PARTS + WITHIN] += taken;
#endif
    }
#ifdef GATHER
    sum[LEFT] += taken * record[ALBEDO];
#endif
}

#ifdef LINEAR_SOURCE
/* What a cell's source is more where the ray sees it than in the cell's middle: the nearer to the
   camera, the more is taken out on the way, over the optical depth t. */
INLINE void add_change(
    real *sum, real transmitted, real t, real share, const Traversal *traversal, const Crossing *cell,
    __global const real *change)
{
    const real taken = transmitted * share;
    const real nearer = transmitted * t * rising(t, share, mean_transmission(t, share));
    const real where =
        R(0.5) * taken * (traversal->t + cell->next) - nearer * (cell->next - traversal->t);
    const real x = where * traversal->dx + taken * (traversal->px - traversal->x - R(0.5));
    const real y = where * traversal->dy + taken * (traversal->py - traversal->y - R(0.5));
    const real z = where * traversal->dz + taken * (traversal->pz - traversal->z - R(0.5));
    UNROLL for (int c = 0; c < COMPONENTS; ++c, ++change) {
        const real more = x * change[0] + y * change[COMPONENTS] + z * change[2 * COMPONENTS];
        UNROLL for (int p = 0; p < IMAGES; ++p) {
            sum[p * PARTS + c] += more;
            if (c < BOUNDARIES) sum[p * PARTS + WITHIN] -= more;
        }
    }
}
#endif

/* Adds what one ray brings to sum. */
INLINE void formal_solution(real *sum, const Ray *ray, const Medium *m)
{
    Traversal traversal = {ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, R(0), 0, 0, 0};
    real transmitted = R(1);
    __global const real *last = m->records;

    if (traversal_enter(&traversal, &m->grid, ray->start)) while (transmitted > R(CUTOFF)) {
        const Crossing cell = traversal_cell(&traversal, &m->grid, m->directory, m->span);
        const int number = m->number[cell.address];
        if (number >= 0) {
            last = m->records + number * RECORD;
            const real t = last[0] * traversal_length(&traversal, &cell);
            const real share = absorbed(t);
            const real taken = transmitted * share;
            add_source(sum, taken, last);
#ifdef LINEAR_SOURCE
            if (number < m->scattering)
                add_change(
                    sum, transmitted, t, share, &traversal, &cell,
                    m->changes + number * (3 * COMPONENTS));
#endif
            transmitted -= taken;
        }
        if (!traversal_advance(&traversal, &cell, &m->grid)) break;
    }

    if (transmitted > R(CUTOFF)) {
        const int seen = boundary_seen(
            ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, ray->start, &m->boundary);
        UNROLL for (int p = 0; p < IMAGES; ++p)
            UNROLL for (int c = 0; c < BOUNDARIES; ++c)
                sum[p * PARTS + c] += c == seen ? transmitted : R(0);
    } else {
        /* The little that is left goes as deep as the last cell looks: it takes that cell's source,
           which costs no light and errs by CUTOFF times the change of S beyond. */
        add_source(sum, transmitted, last);
    }
}

/* coarse: address of coarse leaf 0; low..high: cells outside these bounds are empty. */
#ifdef LINEAR_SOURCE
#define CHANGE_ARGUMENTS __global const real *changes, const int scattering,
#define CHANGES changes, scattering,
#else
#define CHANGE_ARGUMENTS
#define CHANGES
#endif
#define ARGUMENTS \
    __global const int *directory, __global const int *span, __global const int *number, \
    __global const real *records, CHANGE_ARGUMENTS const int coarse, const int stored, \
    const int bricks, const int4 low, const int4 high, const int columns, const int rows, \
    const real4 middle, const real pitch_x, const real pitch_z, const real distance, \
    BOUNDARY_ARGUMENTS
#define MEDIUM {directory, span, number, records, CHANGES {coarse, bricks, low, high}, BOUNDARY}

/* planes, out: [plane][row][column]: of each picture the components and the part from within; then
   what is left to gather */
__kernel void image(__global real *planes, ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Medium medium = MEDIUM;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    real sum[PLANES];
    for (int c = 0; c < PLANES; ++c) sum[c] = R(0);
    formal_solution(sum, &ray, &medium);
    const int pixel = row * columns + column;
    for (int c = 0; c < PLANES; ++c) planes[c * rows * columns + pixel] = sum[c];
}

#ifdef RAYS_ACROSS
/* The mean of RAYS_ACROSS^2 rays through each listed pixel, one in the middle of each of as many
   equal parts of it. planes, out: [plane][list]. */
__kernel void refine(
    __global real *planes, __global const int *list, const int count, ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int pixel = list[item];
    const real row = pixel / columns;
    const real column = pixel % columns;
    const Medium medium = MEDIUM;
    real sum[PLANES];
    for (int c = 0; c < PLANES; ++c) sum[c] = R(0);
    for (int part = 0; part < RAYS_ACROSS * RAYS_ACROSS; ++part) {
        const real across = column + (part % RAYS_ACROSS + R(0.5)) / RAYS_ACROSS;
        const real down = row + (part / RAYS_ACROSS + R(0.5)) / RAYS_ACROSS;
        const Ray ray = ray_at(across, down, columns, rows, middle, pitch_x, pitch_z, distance);
        formal_solution(sum, &ray, &medium);
    }
    for (int c = 0; c < PLANES; ++c)
        planes[c * count + item] = sum[c] / (RAYS_ACROSS * RAYS_ACROSS);
}
#endif
