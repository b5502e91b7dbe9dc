/* Path tracing, unbiased, the method `path` and the audit: backward Monte Carlo, one path a sample.

   A path segment scores by expected values: the emission of every cell and the boundary at its end, each
   times the transmission up to there. One place of the segment scatters. On the line of sight this is
   forced: the samples of a pixel are stratified over all that the line scatters, so that one traversal
   serves them all. On later segments the extinction draws the place, or none. Russian roulette ends paths
   of little weight; beyond the last order a path sees the wall. So it does after SCATTERINGS, and is
   counted: no loop is endless, whatever the medium and the device. */

#include "boundary.h"
#include "components.h"
#include "linear_cell.h"
#include "phase.h"
#include "random.h"
#include "ray.h"

#ifndef HAS_SCATTERING
#error "path.cl is for scenes that scatter: define HAS_SCATTERING"
#endif
#ifndef SAMPLES
#error "SAMPLES: of a pixel and batch, a power of two up to 1024"
#endif

#ifndef ROULETTE
#error "ROULETTE: weight under which a path may end"
#endif

#ifndef SCATTERINGS
#error "SCATTERINGS: after which a path ends"
#endif

/* Parts of a sum of paths: those of the image, and the number of paths that have ended after SCATTERINGS. */
#define ENDED PARTS
#define PATH_PARTS (PARTS + 1)

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
    real cutoff;                    /* transmission at which a ray ends */
    int order;                      /* largest number of scatterings; below 0: all */
#ifdef PHASE_CLASSES
    __global const uchar *shares;   /* of classes of droplet size, see phase_class */
#endif
} Medium;

INLINE void score_thermal(real *sum, real taken, int address, const Medium *m)
{
    for (int e = 0; e < EMITTERS; ++e)
        sum[BOUNDARIES + e] += taken * m->thermal[in_table(e, m->stored, address)];
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
    const uint events = m->order < 0 ? SCATTERINGS : m->order;
    for (uint event = 0; event < events; ++event) {
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
        while (inside && transmitted > m->cutoff) {
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
        if (transmitted > m->cutoff) {
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
    sum[WALL] += weight;
    if (m->order < 0) sum[ENDED] += R(1);
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
    const real pitch_x, const real pitch_z, const real distance, BOUNDARY_ARGUMENTS, \
    const real cutoff, const int order SHARES_ARGUMENT

#define MEDIUM {directory, span, depth, CELL_GRADIENTS thermal, albedo, stored, {coarse, bricks, low, high}, \
    BOUNDARY, cutoff, order SHARES}

/* The line of sight of a pixel in a batch: through its middle, or, in whole pixels, through a place of the
   pixel. The places of all even batches, and of all odd ones, are Sobol points with one random shift. */
INLINE Ray line_of_sight(
    uint pixel, uint batch, uint2 key, int columns, int rows, real4 middle, real pitch_x, real pitch_z,
    real distance, int whole_pixels, __global const uint *sobol_columns)
{
    real right = R(0.5), down = R(0.5);
    if (whole_pixels) {
        const uint point = batch / 2;
        const uint4 shift =
            philox((uint4)(pixel, 2 + (point >> SOBOL_BITS), 0xFFFFFFFFu, batch & 1u), key);
        right = unit(sobol(point, 1, sobol_columns) ^ shift.x);
        down = unit(sobol(point, 2, sobol_columns) ^ shift.y);
    }
    return ray_at(
        pixel % columns + right, pixel / columns + down, R(0), R(0), columns, rows, middle, pitch_x, pitch_z,
        distance);
}

/* Adds the unscattered radiance of a line of sight to sum. Returns what the line scatters in all. end, out:
   address of the last cell that scatters. */
INLINE real unscattered(real *sum, int *end, const Ray *ray, const Medium *m)
{
    Traversal traversal = {ray->px, ray->py, ray->pz, ray->dx, ray->dy, ray->dz, R(0), 0, 0, 0};
    real transmitted = R(1), loss = R(0);
    int last = m->grid.coarse;
    int inside = traversal_enter(&traversal, &m->grid, ray->start);
    while (inside && transmitted > m->cutoff) {
        const Crossing cell = traversal_cell(&traversal, &m->grid, m->directory, m->span);
        const real density = m->depth[cell.address];
        if (density > R(0)) {
            __global const real *gradients = GRADIENTS_OF(m->cell_gradients, cell.address);
            const Extinction e = extinction_along(density, gradients, &traversal, &cell);
            const real t = optical_depth(e, traversal_length(&traversal, &cell));
            const real share = absorbed(t);
            const real taken = transmitted * share;
            score_thermal(sum, taken, cell.address, m);
            real scatters = m->albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
            const real3 place = mean_place(&traversal, &cell, t, share);
            add_emission_gradient(sum, taken, gradients, place);
            scatters = albedo_at(scatters, gradients, place);
#endif
            const real here = taken * scatters;
            sum[WITHIN] += taken - here;
            loss += here;
            if (here > R(0)) *end = cell.address;
            transmitted *= decay(t);
            last = cell.address;
        }
        inside = traversal_advance(&traversal, &cell, &m->grid);
    }
    if (transmitted > m->cutoff) {
        score_boundary(sum, transmitted, &traversal, ray->start, m);
    } else {
        score_thermal(sum, transmitted, last, m);
        sum[WITHIN] += transmitted * (R(1) - m->albedo[last]);
        loss += transmitted * m->albedo[last];
    }
    return loss;
}

/* What the line of sight through the middle of every pixel scatters in all. */
__kernel void straight(
    __global real *scattered, /* out: [row][column] */
    MEDIUM_ARGUMENTS)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= columns || row >= rows) return;
    const Ray ray = pixel_ray(column, row, columns, rows, middle, pitch_x, pitch_z, distance);
    const Medium m = MEDIUM;
    real sum[PARTS];
    int end;
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
    scattered[row * columns + column] = unscattered(sum, &end, &ray, &m);
}

/* Radiance of each listed pixel by SAMPLES paths. A work-group has the pixel, and its work-items the paths.
   Sample k scatters for the first time where the line of sight has scattered the share (k + offset) /
   SAMPLES of all that it scatters. */
__kernel void scatter(
    __global real *means,     /* out: [part][list]; the last part: number of paths that were ended */
    __global const int *list, /* in: pixels, one for each group */
    const int count, const uint2 key, const uint batch, const int whole_pixels,
    __global const real *table, __global const uint *sobol_columns,
    MEDIUM_ARGUMENTS)
{
    __local real direct[PARTS], at[SAMPLES], sums[SAMPLES * PATH_PARTS];
    __local real all[1];
    __local int address[SAMPLES], placed[1];
    const int item = get_group_id(0), lane = get_local_id(0), lanes = get_local_size(0);
    const uint pixel = list[item];
    const Medium m = MEDIUM;
    const Ray ray = line_of_sight(
        pixel, batch, key, columns, rows, middle, pitch_x, pitch_z, distance, whole_pixels,
        sobol_columns);
    const uint4 shift0 = philox((uint4)(pixel, 0, 0xFFFFFFFFu, batch), key);
    const uint4 shift1 = philox((uint4)(pixel, 1, 0xFFFFFFFFu, batch), key);
    if (lane == 0) {
        real sum[PARTS];
        int last = -1, sample = 0;
        for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
        const real scattered = unscattered(sum, &last, &ray, &m);
        for (int c = 0; c < PARTS; ++c) direct[c] = sum[c];
        const real offset = unit(shift0.w);
        Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
        real transmitted = R(1), loss = R(0);
        int inside = scattered > R(0) && traversal_enter(&traversal, &m.grid, ray.start);
        while (inside && sample < SAMPLES) {
            const Crossing cell = traversal_cell(&traversal, &m.grid, directory, span);
            const real density = depth[cell.address];
            if (density > R(0)) {
                const Extinction e = extinction_along(
                    density, GRADIENTS_OF(cell_gradients, cell.address), &traversal, &cell);
                const real t = optical_depth(e, traversal_length(&traversal, &cell));
                const real share = absorbed(t);
                real scatters = albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
                scatters = albedo_at(
                    scatters, GRADIENTS_OF(cell_gradients, cell.address),
                    mean_place(&traversal, &cell, t, share));
#endif
                const real here = transmitted * share * scatters;
                transmitted *= decay(t);
                while (sample < SAMPLES && here > R(0)) {
                    const real goal = (sample + offset) * (scattered / SAMPLES) - loss;
                    /* The last cell takes all samples that are left: rounding must lose none. */
                    if (goal >= here && cell.address != last) break;
                    const real part = most(R(0), least(goal / here, R(1)));
                    at[sample] = least(traversal.t + length_along(part, share, e), cell.next);
                    address[sample++] = cell.address;
                }
                loss += here;
            }
            inside = traversal_advance(&traversal, &cell, &m.grid);
        }
        all[0] = scattered;
        placed[0] = sample;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int sample = lane; sample < SAMPLES; sample += lanes) {
        real sum[PATH_PARTS];
        for (int c = 0; c < PATH_PARTS; ++c) sum[c] = R(0);
        if (sample < placed[0]) {
            const real3 along = (real3)(ray.dx, ray.dy, ray.dz);
            const real3 p = (real3)(ray.px, ray.py, ray.pz) + at[sample] * along;
            path(sum, all[0] / SAMPLES, p, along, address[sample], pixel, van_der_corput(sample), batch,
                 key, shift0, shift1, &m, table, sobol_columns);
        }
        for (int c = 0; c < PATH_PARTS; ++c) sums[sample * PATH_PARTS + c] = sum[c];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int c = lane; c < PATH_PARTS; c += lanes) {
        real total = c < PARTS ? direct[c] : R(0);
        for (int sample = 0; sample < SAMPLES; ++sample) total += sums[sample * PATH_PARTS + c];
        means[in_table(c, count, item)] = total;
    }
}
