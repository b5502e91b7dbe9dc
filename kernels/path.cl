/* Path tracing, unbiased: one chain of scatterings a sample.

   A flight scores what it meets at its expected value: in every cell the emission, and at its end
   the boundary, each times what the line transmits up to there. One place of the flight is chosen to
   scatter from. On the line of sight this is forced: what scatters there in all is known from
   `straight`, and the samples of a pixel divide it evenly among them, so that one walk along the
   line serves them all. On later flights it is chosen by the extinction, or does not happen.
   Chains of little weight end by Russian roulette; after the last order the wall is seen. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "phase.h"
#include "random.h"
#include "ray.h"
#include "octree_traversal.h"

#ifndef HAS_SCATTERING
#error "path.cl is for scenes that scatter: define HAS_SCATTERING"
#endif
#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif
#ifndef SAMPLES
#error "SAMPLES: a pixel and batch, a power of two up to 1024"
#endif

/* Of a chain's sum: the components, and what it would bring from within a medium of radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)
#ifndef ROULETTE
#error "ROULETTE: weight under which a path may end"
#endif

/* What the light meets, stored cell by stored cell. */
typedef struct {
    __global const int *directory;
    __global const int *span;
    __global const real *depth;     /* optical depth of a cell's edge */
    __global const real *thermal;   /* source, a plane of stored cells a component */
    __global const real *albedo;
    int stored;                     /* length of a plane */
    Grid grid;
    Boundary boundary;
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

/* Follows one chain from p, where light that runs on along d is scattered; adds to sum what it
   brings, times weight. */
INLINE void path(
    real *sum, real weight, real3 p, real3 d, uint pixel, uint sample, uint batch, uint2 key,
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
        d = turned(d, phase_cosine(unit(word.x), table), unit(word.y));
        const real goal = unit(word.z); /* transmission at which this flight is scattered */

        Traversal traversal = {p.x, p.y, p.z, d.x, d.y, d.z, R(0), 0, 0, 0};
        real transmitted = R(1), albedo = R(0);
        int met = 0, last = m->grid.coarse;
        int inside = traversal_enter(&traversal, &m->grid, R(0));
        while (inside && transmitted > R(CUTOFF)) {
            const Crossing cell = traversal_cell(&traversal, &m->grid, m->directory, m->span);
            const real density = m->depth[cell.address];
            if (density > R(0)) {
                const real share = absorbed(density * traversal_length(&traversal, &cell));
                const real taken = transmitted * share;
                score_thermal(sum, weight * taken, cell.address, m);
                if (!met && transmitted - taken <= goal) {
                    const real part = most(R(0), least((transmitted - goal) / taken, R(1)));
                    const real at = least(traversal.t + length_at(part, share, density), cell.next);
                    p = (real3)(traversal.px, traversal.py, traversal.pz) + at * d;
                    albedo = m->albedo[cell.address];
                    met = 1;
                }
                transmitted -= taken;
                last = cell.address;
            }
            inside = traversal_advance(&traversal, &cell, &m->grid);
        }
        if (transmitted > R(CUTOFF)) {
            score_boundary(sum, weight * transmitted, &traversal, R(0), m);
        } else {
            /* What is left ends in the last cell, as if that went on for ever. */
            score_thermal(sum, weight * transmitted, last, m);
            if (!met) {
                p = (real3)(traversal.px, traversal.py, traversal.pz) + traversal.t * d;
                albedo = m->albedo[last];
                met = 1;
            }
        }
        if (met) sum[WITHIN] += weight * (R(1) - albedo);
        weight *= albedo;
        if (!met || weight <= R(0)) return;
        if (weight < floor_) {
            if (unit(word.w) * floor_ >= weight) return;
            weight = floor_;
        }
    }
}

#define MEDIUM_ARGUMENTS \
    __global const int *directory, __global const int *span, __global const real *depth, \
    __global const real *thermal, __global const real *albedo, \
    const int coarse, const int stored, const int bricks, \
    const int4 low, const int4 high, const int columns, const int rows, const real4 middle, \
    const real pitch_x, const real pitch_z, const real distance, BOUNDARY_ARGUMENTS

#define MEDIUM {directory, span, depth, thermal, albedo, stored, {coarse, bricks, low, high}, \
    BOUNDARY}

/* What is seen without scattering, in every pixel, and what the line of sight scatters in all. */
__kernel void straight(
    __global real *weights,   /* out: [component][row][column], and the part from within */
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
            const real taken = transmitted * absorbed(density * traversal_length(&traversal, &cell));
            score_thermal(sum, taken, cell.address, &m);
            const real share = taken * albedo[cell.address];
            sum[WITHIN] += taken - share;
            loss += share;
            transmitted -= taken;
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

/* Mean of SAMPLES chains for each listed pixel. Sample k scatters for the first time where the share
   (k + something) / SAMPLES of all that the line of sight scatters has been scattered. */
__kernel void scatter(
    __global real *means,           /* out: [component][list], and the part from within */
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
            const real share = absorbed(density * traversal_length(&traversal, &cell));
            const real taken = transmitted * share;
            const real here = taken * albedo[cell.address];
            transmitted -= taken;
            /* At the end of the light all that remains is scattered; rounding must lose no sample. */
            const int end = transmitted <= R(CUTOFF) || loss + here >= all * R(0.999999);
            while (sample < SAMPLES && here > R(0)) {
                const real goal = (sample + offset) * (all / SAMPLES) - loss;
                if (goal >= here && !end) break;
                const real part = most(R(0), least(goal / here, R(1)));
                const real at = least(traversal.t + length_at(part, share, density), cell.next);
                const real3 p = (real3)(ray.px, ray.py, ray.pz) + at * along;
                const uint index = van_der_corput(sample);
                path(sum, all / SAMPLES, p, along, pixel, index, batch, key, shift0, shift1, &m,
                      table, sobol_columns);
                ++sample;
            }
            loss += here;
        }
        inside = traversal_advance(&traversal, &cell, &m.grid);
    }
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = sum[c];
}
