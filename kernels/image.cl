/* The picture: one ray a pixel from the camera through the bricks, front to back.

   Each cell of optical depth t adds T (1 - exp(-t)) S to the pixel, T being what is still
   transmitted. S, the source of the cell, has a component for the light that began at the
   background, at the walls and their patches, in the vapour and in the droplets. Without scattering
   those from outside are nothing, and are not compiled in.

   With GATHER the source of thick cells is what they emit alone; what they scatter is gathered later
   (gather.cl), where the plane before the last says that there is any.

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

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif

/* What a line meets, stored cell by stored cell. */
typedef struct {
    __global const int *directory; /* brick -> slot, or -1 - coarse leaf; [z][y][x] */
    __global const int *span;      /* cells along the edge of each coarse leaf */
    __global const real *depth;    /* optical depth of a cell's edge */
    __global const real *source;   /* S, one plane of stored cells a component */
#ifdef HAS_SCATTERING
    __global const real *isothermal; /* S of what is emitted at radiance 1 */
#endif
#ifdef GATHER
    __global const real *albedo;   /* of thick cells, else 0 */
#endif
    int stored;                    /* length of a plane */
    Grid grid;
    Boundary boundary;
} Medium;

/* Of a sum: the components, what is left to gather, and the part from within at radiance 1. */
#ifdef GATHER
#define LEFT COMPONENTS
#define WITHIN (COMPONENTS + 1)
#else
#define WITHIN COMPONENTS
#endif
#define PARTS (WITHIN + 1)

#ifdef HAS_SCATTERING
#define ISOTHERMAL(m, address) (m)->isothermal[address]
#else
#define ISOTHERMAL(m, address) R(1)
#endif

INLINE void add_source(real *sum, real taken, int address, const Medium *m)
{
    for (int c = 0; c < SOURCES; ++c)
        sum[FIRST_SOURCE + c] += taken * m->source[c * m->stored + address];
#ifdef GATHER
    sum[LEFT] += taken * m->albedo[address];
#endif
    sum[WITHIN] += taken * ISOTHERMAL(m, address);
}

/* Adds what one ray brings to sum. */
INLINE void look(real *sum, const Ray *ray, const Medium *m)
{
    Walk walk = {ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, R(0), 0, 0, 0};
    real transmitted = R(1);
    int last = m->grid.coarse;

    if (walk_in(&walk, &m->grid, ray->start)) while (transmitted > R(CUTOFF)) {
        const Crossing cell = walk_ahead(&walk, &m->grid, m->directory, m->span);
        const real density = m->depth[cell.address];
        if (density > R(0)) {
            const real taken = transmitted * absorbed(density * walk_length(&walk, &cell));
            add_source(sum, taken, cell.address, m);
            transmitted -= taken;
            last = cell.address;
        }
        if (!walk_on(&walk, &cell, &m->grid)) break;
    }

    if (transmitted > R(CUTOFF)) {
        const int seen = boundary_seen(
            ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, ray->start, &m->boundary);
        for (int c = 0; c < BOUNDARIES; ++c) sum[c] += c == seen ? transmitted : R(0);
    } else {
        /* The little that is left goes as deep as the last cell looks: it takes that cell's source,
           which costs no light and errs by CUTOFF times the change of S beyond. */
        add_source(sum, transmitted, last, m);
    }
}

/* coarse: address of coarse leaf 0; low..high: cells outside these bounds are empty. */
#ifdef HAS_SCATTERING
#define ISOTHERMAL_ARGUMENT __global const real *isothermal,
#define ISOTHERMAL_MEMBER isothermal,
#else
#define ISOTHERMAL_ARGUMENT
#define ISOTHERMAL_MEMBER
#endif
#ifdef GATHER
#define ALBEDO_ARGUMENT __global const real *albedo,
#define ALBEDO_MEMBER albedo,
#else
#define ALBEDO_ARGUMENT
#define ALBEDO_MEMBER
#endif
#define ARGUMENTS \
    __global const int *directory, __global const int *span, __global const real *depth, \
    __global const real *source, ISOTHERMAL_ARGUMENT ALBEDO_ARGUMENT \
    const int coarse, const int stored, \
    const int bricks, const int4 low, const int4 high, const int columns, const int rows, \
    const real4 middle, const real pitch_x, const real pitch_z, const real distance, \
    BOUNDARY_ARGUMENTS
#define MEDIUM {directory, span, depth, source, ISOTHERMAL_MEMBER ALBEDO_MEMBER \
    stored, {coarse, bricks, low, high}, BOUNDARY}

/* weights, out: [component][row][column], and the part from within */
__kernel void image(__global real *weights, ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Medium medium = MEDIUM;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    real sum[PARTS];
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
    look(sum, &ray, &medium);
    const int pixel = row * columns + column;
    for (int c = 0; c < PARTS; ++c) weights[c * rows * columns + pixel] = sum[c];
}

#ifdef RAYS_ACROSS
/* The mean of RAYS_ACROSS^2 rays through each listed pixel, one in the middle of each of as many
   equal parts of it. weights, out: [component][list], and the part from within. */
__kernel void refine(
    __global real *weights, __global const int *list, const int count, ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int pixel = list[item];
    const real row = pixel / columns;
    const real column = pixel % columns;
    const Medium medium = MEDIUM;
    real sum[PARTS];
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
    for (int part = 0; part < RAYS_ACROSS * RAYS_ACROSS; ++part) {
        const real across = column + (part % RAYS_ACROSS + R(0.5)) / RAYS_ACROSS;
        const real down = row + (part / RAYS_ACROSS + R(0.5)) / RAYS_ACROSS;
        const Ray ray = ray_at(across, down, columns, rows, middle, pitch_x, pitch_z, distance);
        look(sum, &ray, &medium);
    }
    for (int c = 0; c < PARTS; ++c)
        weights[c * count + item] = sum[c] / (RAYS_ACROSS * RAYS_ACROSS);
}
#endif
