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
#include "linear_cell.h"
#include "ray.h"

#ifdef HAS_SCATTERING
#define FIRST_SOURCE 0
#else
#define FIRST_SOURCE BOUNDARIES
#endif
#define SOURCES (COMPONENTS - FIRST_SOURCE)

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
    real cutoff; /* transmission at which a ray ends */
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

    if (traversal_enter(&traversal, &m->grid, ray->start)) while (transmitted > m->cutoff) {
        const Crossing cell = traversal_cell(&traversal, &m->grid, m->directory, m->span);
        const int number = m->number[cell.address];
        if (number >= 0) {
            last = m->records + in_table(number, RECORD, 0);
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
                    m->gradient + in_table(number, 3 * SOURCES, 0), IS_THICK(last));
#endif
            transmitted *= decay(t); /* a difference has no digits left in deep cells */
        }
        if (!traversal_advance(&traversal, &cell, &m->grid)) break;
    }

    if (transmitted > m->cutoff) {
        const int seen = boundary_seen(
            ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, ray->start, &m->boundary);
        UNROLL for (int p = 0; p < IMAGES; ++p)
            UNROLL for (int c = 0; c < BOUNDARIES; ++c)
                sum[p * PARTS + c] += c == seen ? transmitted : R(0);
    } else {
        /* The rest takes the last cell's source. So energy is conserved, and the error is the cut-off times
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
    BOUNDARY_ARGUMENTS, const real cutoff
#define MEDIUM \
    {directory, span, number, records, GRADIENTS {coarse, bricks, low, high}, BOUNDARY, cutoff}

/* The mean of rays through each listed pixel. places: [right, down] in it, 0 to 1 in focus, and points of
   the aperture, as in ray.h; ranges: first and number of each pixel's. planes, out: [plane][list]. */
__kernel void image(
    __global real *planes, __global const int *list, const int count, __global const real4 *places,
    __global const int2 *ranges, ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int pixel = list[item];
    const real row = pixel / columns;
    const real column = pixel % columns;
    const Medium medium = MEDIUM;
    real sum[PLANES];
    for (int c = 0; c < PLANES; ++c) sum[c] = R(0);
    const int first = ranges[item].x, rays = ranges[item].y;
    for (int one = 0; one < rays; ++one) {
        const real4 at = places[first + one];
        const Ray ray = ray_at(
            column + at.x, row + at.y, at.z, at.w, columns, rows, middle, pitch_x, pitch_z, distance);
        formal_solution(sum, &ray, &medium);
    }
    for (int c = 0; c < PLANES; ++c) planes[in_table(c, count, item)] = sum[c] / rays;
}

/* Mean albedo and emission of a cell. */
typedef struct { real albedo, thermal[EMITTERS + 1]; } CellMeans;

#ifdef HAS_SCATTERING
INLINE CellMeans means_of(
    int cell, real edge, __global const real *albedo, __global const real *thermal, int stored,
    __global const real *gradients)
{
    CellMeans mean;
    mean.albedo = albedo[cell];
    for (int e = 0; e < EMITTERS; ++e) mean.thermal[e] = thermal[in_table(e, stored, cell)];
#ifdef LINEAR_COEFFICIENTS
    mean.albedo += excess_of(gradients, 0, edge);
    for (int e = 0; e < EMITTERS; ++e) mean.thermal[e] += excess_of(gradients, 1 + e, edge);
#endif
    return mean;
}

/* Mean of the images' sources of a cell, of which the medium emits `thermal` and scatters the rest. */
INLINE real mean_source(__global const real *sources, int c, int scattering, int row)
{
    real sum = R(0);
    for (int p = 0; p < IMAGES; ++p) sum += sources[in_table(p * COMPONENTS + c, scattering, row)];
    return sum / IMAGES;
}
INLINE real radiance_of(real source, int c, CellMeans mean)
{
    return (c < BOUNDARIES ? source : source - mean.thermal[c - BOUNDARIES]) / mean.albedo;
}
#endif

/* Records of all cells that are not empty, and gradients of their sources. Those that scatter come first.
   With `spatial`, the radiance has a spatial gradient, from that of the neighbours: the value at a face is
   between the means of both cells, closer to that of the thinner one, as a cell's share of the difference
   is proportional to the root of its optical depth. It would be the depth itself in diffusion, and equal
   shares in transparent cells; on `gdi` the root has the smallest error. A cell with one neighbour has the
   same slope on both sides. Gradients that are known take precedence. */
__kernel void cell_records(
    __global real *records,         /* out */
    __global const int *number,     /* in: of the record of a cell; below 0 where it is empty */
#ifdef HAS_SCATTERING
    __global const real *sources,   /* in: [image][component][scattering cell] */
    __global const real *defect,    /* in: error of the mean radiance in a cavity of radiance 1 */
    const int cells,                /* that scatter */
#ifdef GATHER
    __global const uchar *thick,    /* in: 1 in cells that scatter and are left to the gather */
#endif
#ifdef LINEAR_SOURCE
    __global const int *known,      /* in: number of the gradient of a cell that scatters; -1: not known */
    __global const real *known_gradient, /* in: of the radiance, [axis][component][number] */
    const int known_cells, const int spatial,
#endif
#endif
#ifdef LINEAR_SOURCE
    __global real *gradient,        /* out */
#endif
    __global const real *depth, __global const real *albedo, __global const real *thermal,
    CELL_GRADIENTS_ARGUMENT TREE_ARGUMENTS, const int stored)
{
    const int cell = get_global_id(0);
    if (cell >= stored) return;
    const int row = number[cell];
    if (row < 0) return;
    __global real *record = records + in_table(row, RECORD, 0);
    record[0] = depth[cell];
#ifdef LINEAR_COEFFICIENTS
    __global const real *own = GRADIENTS_OF(cell_gradients, cell);
    for (int axis = 0; axis < 3; ++axis) record[1 + axis] = own[axis];
#endif
    real change[3 * COMPONENTS];
    for (int n = 0; n < 3 * COMPONENTS; ++n) change[n] = R(0);
#ifdef LINEAR_COEFFICIENTS
    for (int e = 0; e < EMITTERS; ++e)
        for (int axis = 0; axis < 3; ++axis)
            change[axis * COMPONENTS + BOUNDARIES + e] = own[6 + 3 * e + axis];
#endif
#ifndef HAS_SCATTERING
    for (int e = 0; e < EMITTERS; ++e) record[FIRST + e] = thermal[in_table(e, stored, cell)];
#else
    const int scatters = row < cells;
    real excess[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) excess[c] = R(0);
#ifdef GATHER
    const int is_thick = scatters && thick[row];
    record[ALBEDO] = is_thick ? albedo[cell] : R(0);
#else
    const int is_thick = 0;
#endif
    CellMeans mean;
    if (scatters) {
        const real edge = edge_of(cell, coarse, span);
        mean = means_of(cell, edge, albedo, thermal, stored, GRADIENTS_OF(cell_gradients, cell));
#ifdef LINEAR_SOURCE
        real light[COMPONENTS], scattered[3 * COMPONENTS];
        for (int c = 0; c < COMPONENTS; ++c)
            light[c] = radiance_of(mean_source(sources, c, cells, row), c, mean);
        for (int n = 0; n < 3 * COMPONENTS; ++n) scattered[n] = R(0);
        if (spatial && known[row] >= 0) {
            for (int n = 0; n < 3 * COMPONENTS; ++n)
                scattered[n] = known_gradient[in_table(n, known_cells, known[row])];
        } else if (spatial) {
            for (int axis = 0; axis < 3; ++axis) {
                int near[2];
                for (int up = 0; up < 2; ++up) {
                    near[up] = beside(cell, axis, up, directory, corners, bricks, coarse);
                    const int other = number[near[up]];
                    if (near[up] >= coarse || other < 0 || other >= cells) near[up] = -1;
                }
                for (int up = 0; up < 2; ++up) {
                    if (near[up] < 0) continue;
                    const real share = (up ? R(1) : R(-1)) * (near[1 - up] < 0 ? R(2) : R(1)) * root(depth[cell])
                        / (root(depth[cell]) + root(depth[near[up]]));
                    const CellMeans there = means_of(
                        near[up], R(1), albedo, thermal, stored, GRADIENTS_OF(cell_gradients, near[up]));
                    for (int c = 0; c < COMPONENTS; ++c) {
                        const real source = mean_source(sources, c, cells, number[near[up]]);
                        scattered[axis * COMPONENTS + c] +=
                            share * (radiance_of(source, c, there) - light[c]);
                    }
                }
            }
        }
        limit_gradient(scattered, light, BOUNDARIES, COMPONENTS);
        for (int n = 0; n < 3 * COMPONENTS; ++n) change[n] += mean.albedo * scattered[n];
#ifdef LINEAR_COEFFICIENTS
        real bound[COMPONENTS];
        for (int c = 0; c < COMPONENTS; ++c) {
            bound[c] = mean_source(sources, c, cells, row) / MOST_IN_CELL;
            for (int axis = 0; axis < 3; ++axis) {
                const int n = axis * COMPONENTS + c;
                change[n] = edge * (change[n] + light[c] * own[3 + axis]);
            }
        }
        limit_gradient(change, bound, BOUNDARIES, COMPONENTS);
        for (int n = 0; n < 3 * COMPONENTS; ++n) {
            excess[n % COMPONENTS] += own[n / COMPONENTS] * change[n] * edge * R(1.0 / 12.0);
            change[n] /= edge;
        }
        if (is_thick)
            for (int axis = 0; axis < 3; ++axis) {
                for (int c = 0; c < BOUNDARIES; ++c)
                    change[axis * COMPONENTS + c] = c == 0 ? own[3 + axis] : R(0);
                for (int e = 0; e < EMITTERS; ++e)
                    change[axis * COMPONENTS + BOUNDARIES + e] = own[6 + 3 * e + axis];
            }
#else
        if (is_thick) for (int n = 0; n < 3 * COMPONENTS; ++n) change[n] = R(0);
#endif
#endif
    }
    for (int p = 0; p < IMAGES; ++p) {
        __global real *source = record + FIRST + p * ONE;
        for (int c = 0; c < COMPONENTS; ++c)
            source[c] = c < BOUNDARIES ? R(0) : thermal[in_table(c - BOUNDARIES, stored, cell)];
        source[COMPONENTS] = R(1);
        if (!scatters) continue;
        const real made = mean.albedo * defect[row];
        if (is_thick) { /* the gather adds the scattered light */
            source[COMPONENTS] = R(1) - albedo[cell] + made;
            continue;
        }
        real outside = R(0);
        for (int c = 0; c < COMPONENTS; ++c) {
            source[c] = sources[in_table(p * COMPONENTS + c, cells, row)] - excess[c];
            if (c < BOUNDARIES) outside += source[c];
        }
        source[COMPONENTS] = R(1) - outside + made;
    }
#endif
#ifdef LINEAR_SOURCE
#if defined(HAS_SCATTERING) && !defined(LINEAR_COEFFICIENTS)
    if (row >= cells) return;
#endif
    for (int axis = 0; axis < 3; ++axis)
        for (int c = 0; c < SOURCES; ++c)
            gradient[in_table(row, 3 * SOURCES, axis * SOURCES + c)] =
                change[axis * COMPONENTS + FIRST_SOURCE + c];
#endif
}
