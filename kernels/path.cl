/* Path tracing, unbiased, the method `path` and the audit: backward Monte Carlo, one path a sample.

   A path segment scores by expected values: the emission of every cell and the boundary at its end, each
   times the transmission up to there. One place of the segment scatters. On the line of sight this is
   forced: `straight` determines what the line scatters in all, and the samples of a pixel are stratified
   over it, so that one traversal serves them all. On later segments the extinction draws the place, or
   none. Russian roulette ends paths of little weight; beyond the last order a path sees the wall. */

#include "boundary.h"
#include "components.h"
#include "linear_cell.h"
#include "phase.h"
#include "random.h"
#include "ray.h"

#ifndef HAS_SCATTERING
#error "path.cl is for scenes that scatter: define HAS_SCATTERING"
#endif
#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif
#ifndef SAMPLES
#error "SAMPLES: of a pixel and batch, a power of two up to 1024"
#endif

#ifndef ROULETTE
#error "ROULETTE: weight under which a path may end"
#endif

/* The medium, by stored cells. */
typedef struct {
    __global const int *directory;
    __global const int *span;
    __global const real *depth;     /* optical depth of a cell's edge */
#ifdef LINEAR_COEFFICIENTS
    __global const real *cell_gradients; /* see extinction.h */
#endif
    __global const real *thermal;   /* source, a plane of stored cells a component */
    __global const real *albedo;
    int stored;                     /* length of a plane */
    Grid grid;
    Boundary boundary;
#ifdef PHASE_CLASSES
    __global const uchar *shares;   /* of classes of droplet size, see phase_class */
#endif
} Medium;

INLINE void score_thermal(real *sum, real taken, int address, const Medium *m)
{
    for (int e = 0; e < EMITTERS; ++e)
        sum[BOUNDARIES + e] += taken * m->thermal[e * m->stored + address];
}

INLINE void score_boundary(real *sum, real weight, const Traversal *w, real from, const Medium *m)
{
    const int seen =
        boundary_seen(w->px, w->py, w->pz, w->dx, w->dy, w->dz, from, &m->boundary);
    for (int c = 0; c < BOUNDARIES; ++c) sum[c] += c == seen ? weight : R(0);
}

#ifdef PHASE_CLASSES
#define COSINE(u, address) class_cosine(u, m->shares + (address), m->stored, table)
#else
#define COSINE(u, address) phase_cosine(u, table)
#endif

/* Traces one path from p in the cell at `address`, where light is scattered into the direction -d; adds
   its score times weight to sum. */
INLINE void path(
    real *sum, real weight, real3 p, real3 d, int address, uint pixel, uint sample, uint batch, uint2 key,
    uint4 shift0, uint4 shift1, const Medium *m, __global const real *table,
    __global const uint *columns)
{
    const real floor_ = ROULETTE * weight;
    for (uint event = 0; ; ++event) {
#ifdef ORDER
        if (event >= ORDER) {
            sum[WALL] += weight;
            return;
        }
#endif
        uint4 word = philox((uint4)(pixel, sample, event, batch), key);
        if (event < 2) {
            const uint4 shift = event == 0 ? shift0 : shift1;
            word.x = sobol(sample, 3 * event + 1, columns) ^ shift.x;
            word.y = sobol(sample, 3 * event + 2, columns) ^ shift.y;
            word.z = sobol(sample, 3 * event + 3, columns) ^ shift.z;
        }
        d = turned(d, COSINE(unit(word.x), address), unit(word.y));
        const real goal = unit(word.z); /* transmission at which this segment is scattered */

        Traversal traversal = {p.x, p.y, p.z, d.x, d.y, d.z, R(0), 0, 0, 0};
        real transmitted = R(1), albedo = R(0);
        int has_scattered = 0, last = m->grid.coarse;
        int inside = traversal_enter(&traversal, &m->grid, R(0));
        while (inside && transmitted > R(CUTOFF)) {
            const Crossing cell = traversal_cell(&traversal, &m->grid, m->directory, m->span);
            const real density = m->depth[cell.address];
            if (density > R(0)) {
                const Extinction e = extinction_along(
                    density, GRADIENTS_OF(m->cell_gradients, cell.address), &traversal, &cell);
                const real t = optical_depth(e, traversal_length(&traversal, &cell));
                const real share = absorbed(t);
                const real taken = transmitted * share;
                score_thermal(sum, weight * taken, cell.address, m);
#ifdef LINEAR_COEFFICIENTS
                __global const real *gradients = GRADIENTS_OF(m->cell_gradients, cell.address);
                const real3 place = mean_place(&traversal, &cell, t, share);
                add_emission_gradient(sum, weight * taken, gradients, place);
#endif
                if (!has_scattered && transmitted * decay(t) <= goal) {
                    const real part = most(R(0), least((transmitted - goal) / taken, R(1)));
                    const real at = least(traversal.t + length_along(part, share, e), cell.next);
                    p = (real3)(traversal.px, traversal.py, traversal.pz) + at * d;
                    albedo = m->albedo[cell.address];
                    address = cell.address;
#ifdef LINEAR_COEFFICIENTS
                    albedo = albedo_at(albedo, gradients, place_in(&traversal, &cell, at));
#endif
                    has_scattered = 1;
                }
                transmitted *= decay(t);
                last = cell.address;
            }
            inside = traversal_advance(&traversal, &cell, &m->grid);
        }
        if (transmitted > R(CUTOFF)) {
            score_boundary(sum, weight * transmitted, &traversal, R(0), m);
        } else {
            /* The rest ends in the last cell, as if that had no end. */
            score_thermal(sum, weight * transmitted, last, m);
            if (!has_scattered) {
                p = (real3)(traversal.px, traversal.py, traversal.pz) + traversal.t * d;
                albedo = m->albedo[last];
                address = last;
                has_scattered = 1;
            }
        }
        if (has_scattered) sum[WITHIN] += weight * (R(1) - albedo);
        weight *= albedo;
        if (!has_scattered || weight <= R(0)) return;
        if (weight < floor_) {
            if (unit(word.w) * floor_ >= weight) return;
            weight = floor_;
        }
    }
}

#ifdef PHASE_CLASSES
#define SHARES_ARGUMENT , __global const uchar *shares
#define SHARES , shares
#else
#define SHARES_ARGUMENT
#define SHARES
#endif

#define MEDIUM_ARGUMENTS \
    __global const int *directory, __global const int *span, __global const real *depth, \
    CELL_GRADIENTS_ARGUMENT __global const real *thermal, __global const real *albedo, \
    const int coarse, const int stored, const int bricks, \
    const int4 low, const int4 high, const int columns, const int rows, const real4 middle, \
    const real pitch_x, const real pitch_z, const real distance, BOUNDARY_ARGUMENTS \
    SHARES_ARGUMENT

#define MEDIUM {directory, span, depth, CELL_GRADIENTS thermal, albedo, stored, {coarse, bricks, low, high}, \
    BOUNDARY SHARES}

/* Unscattered radiance of every pixel, and what its line of sight scatters in all. */
__kernel void straight(
    __global real *weights,   /* out: [part][row][column] */
    __global real *scattered, /* out: [row][column] */
    MEDIUM_ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    const Medium m = MEDIUM;
    Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    real sum[PARTS];
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
    real transmitted = R(1), loss = R(0);
    int last = coarse;
    int inside = traversal_enter(&traversal, &m.grid, ray.start);
    while (inside && transmitted > R(CUTOFF)) {
        const Crossing cell = traversal_cell(&traversal, &m.grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const Extinction e = extinction_along(
                density, GRADIENTS_OF(cell_gradients, cell.address), &traversal, &cell);
            const real t = optical_depth(e, traversal_length(&traversal, &cell));
            const real share = absorbed(t);
            const real taken = transmitted * share;
            score_thermal(sum, taken, cell.address, &m);
            real scatters = albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
            __global const real *gradients = GRADIENTS_OF(cell_gradients, cell.address);
            const real3 place = mean_place(&traversal, &cell, t, share);
            add_emission_gradient(sum, taken, gradients, place);
            scatters = albedo_at(scatters, gradients, place);
#endif
            const real here = taken * scatters;
            sum[WITHIN] += taken - here;
            loss += here;
            transmitted *= decay(t);
            last = cell.address;
        }
        inside = traversal_advance(&traversal, &cell, &m.grid);
    }
    if (transmitted > R(CUTOFF)) {
        score_boundary(sum, transmitted, &traversal, ray.start, &m);
    } else {
        score_thermal(sum, transmitted, last, &m);
        sum[WITHIN] += transmitted * (R(1) - albedo[last]);
        loss += transmitted * albedo[last];
    }
    const int pixel = row * columns + column;
    for (int c = 0; c < PARTS; ++c) weights[c * rows * columns + pixel] = sum[c];
    scattered[pixel] = loss;
}

/* Mean of SAMPLES paths for each listed pixel. Sample k scatters for the first time where the line of
   sight has scattered the share (k + offset) / SAMPLES of all that it scatters. */
__kernel void scatter(
    __global real *means,           /* out: [part][list] */
    __global const int *list,       /* in: pixels that scatter */
    __global const real *scattered, /* in: what they scatter in all */
    const int count, const uint2 key, const uint batch,
    __global const real *table, __global const uint *sobol_columns,
    MEDIUM_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const uint pixel = list[item];
    const Ray ray = pixel_ray(
        pixel % columns, pixel / columns, columns, rows, middle, pitch_x, pitch_z, distance);
    const Medium m = MEDIUM;
    Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    const real3 along = (real3)(ray.dx, ray.dy, ray.dz);
    const real all = scattered[item];
    const uint4 shift0 = philox((uint4)(pixel, 0, 0xFFFFFFFFu, batch), key);
    const uint4 shift1 = philox((uint4)(pixel, 1, 0xFFFFFFFFu, batch), key);
    const real offset = unit(shift0.w);
    real sum[PARTS];
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);

    real transmitted = R(1), loss = R(0);
    uint sample = 0;
    int inside = traversal_enter(&traversal, &m.grid, ray.start);
    while (inside && transmitted > R(CUTOFF) && sample < SAMPLES) {
        const Crossing cell = traversal_cell(&traversal, &m.grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const Extinction e = extinction_along(
                density, GRADIENTS_OF(cell_gradients, cell.address), &traversal, &cell);
            const real t = optical_depth(e, traversal_length(&traversal, &cell));
            const real share = absorbed(t);
            const real taken = transmitted * share;
            real scatters = albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
            scatters = albedo_at(
                scatters, GRADIENTS_OF(cell_gradients, cell.address),
                mean_place(&traversal, &cell, t, share));
#endif
            const real here = taken * scatters;
            transmitted *= decay(t);
            /* The end of the line takes all samples that are left: rounding must lose none. */
            const int end = transmitted <= R(CUTOFF) || loss + here >= all * R(0.999999);
            while (sample < SAMPLES && here > R(0)) {
                const real goal = (sample + offset) * (all / SAMPLES) - loss;
                if (goal >= here && !end) break;
                const real part = most(R(0), least(goal / here, R(1)));
                const real at = least(traversal.t + length_along(part, share, e), cell.next);
                const real3 p = (real3)(ray.px, ray.py, ray.pz) + at * along;
                const uint index = van_der_corput(sample);
                path(sum, all / SAMPLES, p, along, cell.address, pixel, index, batch, key, shift0, shift1, &m,
                      table, sobol_columns);
                ++sample;
            }
            loss += here;
        }
        inside = traversal_advance(&traversal, &cell, &m.grid);
    }
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = sum[c];
}
