/* The formal solution of the equation of transfer along one ray a pixel, front to back: the images
   (stage 4 of `trace_source`).

   A cell of optical depth t adds T (1 - exp(-t)) S to the pixel; T is the transmission up to the cell, S
   its source function. S has a component for each origin of light: background, walls, patches, vapour,
   droplets. Without scattering the boundary's components of S are 0 and are not compiled in. IMAGES
   images, of as many sources, share one traversal.

   LINEAR_SOURCE: S has a spatial gradient in cells that scatter, since a cell is many pixels wide.
   LINEAR_COEFFICIENTS: the extinction has a gradient too (extinction.h), and S in all cells.

   GATHER: S of thick cells is their emission. The final gather (gather.cl) adds the rest, where the last
   plane is above 0.

   The last plane of an image is WITHIN. With the boundary's weights it sums to 1 in every pixel if energy
   is conserved (cldit/transport/energy_balance.py). */

#include "boundary.h"
#include "components.h"
#include "extinction.h"
#include "ray.h"

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
#error "IMAGES: images that share one traversal"
#endif

/* Planes: those of the images; then what is left to the gather. */
#define LEFT (IMAGES * PARTS)
#ifdef GATHER
#define PLANES (LEFT + 1)
#else
#define PLANES LEFT
#endif

/* A cell's record: optical depth of its edge; its relative gradient along x, y, z (LINEAR_COEFFICIENTS);
   albedo, if it is thick; for each image the source, and the emission at radiance 1, which is 1 where
   nothing scatters. */
#ifdef LINEAR_COEFFICIENTS
#define ALBEDO 4
#else
#define ALBEDO 1
#endif
#ifdef GATHER
#define FIRST (ALBEDO + 1)
#else
#define FIRST ALBEDO
#endif
#ifdef HAS_SCATTERING
#define ONE (SOURCES + 1)
#else
#define ONE SOURCES
#endif
#define RECORD (FIRST + IMAGES * ONE)
#ifdef GATHER
#define IS_THICK(record) ((record)[ALBEDO] > R(0))
#else
#define IS_THICK(record) 0
#endif

/* The medium, by stored cells. */
typedef struct {
    __global const int *directory; /* brick -> slot, or -1 - coarse leaf; [z][y][x] */
    __global const int *span;      /* cells along the edge of each coarse leaf */
    __global const int *number;    /* of a stored cell's record; below 0 where it is empty */
    __global const real *records;
#ifdef LINEAR_SOURCE
    __global const real *gradient;  /* spatial gradient of the source along x, y, z, of the first ... */
    int scattering;                /* ... so many records */
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
/* Adds the gradient's part of the source, at the mean place of what reaches the camera from the cell. t:
   optical depth of the crossing. thick: what is scattered is the gather's. The boundaries' gradients are
   then that of the albedo in all. */
INLINE void add_gradient(
    real *sum, real transmitted, real t, real share, const Traversal *traversal, const Crossing *cell,
    __global const real *gradient, int thick)
{
    const real taken = transmitted * share;
    const real nearer = transmitted * t * rising(t, share, mean_transmission(t, share));
    const real where =
        R(0.5) * taken * (traversal->t + cell->next) - nearer * (cell->next - traversal->t);
    const real half_ = R(0.5) * (cell->mask + 1);
    const real x = where * traversal->dx + taken * (traversal->px - (traversal->x & ~cell->mask) - half_);
    const real y = where * traversal->dy + taken * (traversal->py - (traversal->y & ~cell->mask) - half_);
    const real z = where * traversal->dz + taken * (traversal->pz - (traversal->z & ~cell->mask) - half_);
    UNROLL for (int c = FIRST_SOURCE; c < COMPONENTS; ++c, ++gradient) {
        const real more = x * gradient[0] + y * gradient[SOURCES] + z * gradient[2 * SOURCES];
        UNROLL for (int p = 0; p < IMAGES; ++p) {
            if (c >= BOUNDARIES || !thick) sum[p * PARTS + c] += more;
            if (c < BOUNDARIES) sum[p * PARTS + WITHIN] -= more;
        }
    }
}
#endif

/* Adds one ray to sum. */
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
            const real t = optical_depth(
                extinction_along(last[0], last + 1, &traversal, &cell),
                traversal_length(&traversal, &cell));
            const real share = absorbed(t);
            const real taken = transmitted * share;
            add_source(sum, taken, last);
#ifdef LINEAR_SOURCE
            if (number < m->scattering)
                add_gradient(
                    sum, transmitted, t, share, &traversal, &cell,
                    m->gradient + number * (3 * SOURCES), IS_THICK(last));
#endif
            transmitted *= decay(t); /* a difference has no digits left in deep cells */
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
        /* The rest takes the last cell's source. So energy is conserved, and the error is CUTOFF times
           the change of S beyond. */
        add_source(sum, transmitted, last);
    }
}

/* coarse: address of coarse leaf 0; low..high: cells outside these bounds are empty. */
#ifdef LINEAR_SOURCE
#define GRADIENT_ARGUMENTS __global const real *gradient, const int scattering,
#define GRADIENTS gradient, scattering,
#else
#define GRADIENT_ARGUMENTS
#define GRADIENTS
#endif
#define ARGUMENTS \
    __global const int *directory, __global const int *span, __global const int *number, \
    __global const real *records, GRADIENT_ARGUMENTS const int coarse, const int stored, \
    const int bricks, const int4 low, const int4 high, const int columns, const int rows, \
    const real4 middle, const real pitch_x, const real pitch_z, const real distance, \
    BOUNDARY_ARGUMENTS
#define MEDIUM {directory, span, number, records, GRADIENTS {coarse, bricks, low, high}, BOUNDARY}

/* The image of one ray a pixel. planes, out: [plane][row][column]. */
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
    for (int c = 0; c < PLANES; ++c) planes[(size_t)c * rows * columns + pixel] = sum[c];
}

/* The mean of rays through each listed pixel, by the same rays of each: places [right, down] in it, 0 to
   1 in focus, and points of the aperture, as in ray.h. planes, out: [plane][list]. */
__kernel void refine(
    __global real *planes, __global const int *list, const int count, __global const real4 *places,
    const int rays, ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int pixel = list[item];
    const real row = pixel / columns;
    const real column = pixel % columns;
    const Medium medium = MEDIUM;
    real sum[PLANES];
    for (int c = 0; c < PLANES; ++c) sum[c] = R(0);
    for (int one = 0; one < rays; ++one) {
        const real4 at = places[one];
        const Ray ray = ray_at(
            column + at.x, row + at.y, at.z, at.w, columns, rows, middle, pitch_x, pitch_z, distance);
        formal_solution(sum, &ray, &medium);
    }
    for (int c = 0; c < PLANES; ++c) planes[(size_t)c * count + item] = sum[c] / rays;
}
