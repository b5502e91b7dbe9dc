/* Final gather: what thick cells scatter to the camera, by short paths from each pixel (Jensen, Global
   Illumination using Photon Maps, Rendering Techniques 1996; stage 5 of `trace_source`).

   The sweeps give a cell one source, constant or linear in it. A thick cell scatters more than that back
   to where light enters it. So paths start at places in thick cells on the line of sight, along an
   ordinate of the final sweeps, weighted by the phase function. A path segment scores the sources of the
   cells of the thick region that it crosses. It ends at the boundary, or at the first interface to
   another cell, in the radiance that the final sweeps stored there for each ordinate.

   In some cells, even thicker, a linear source is too inaccurate. There a segment scores the emission
   alone, and the path continues from one place, with all of the scattered weight, by the phase function
   itself. It ends if little weight is left, or after `most_segments` segments, when radiance no longer
   depends on where light entered: the weight left then takes the source of the sweeps. So every path
   conserves energy to rounding.

   FREE_DIRECTIONS: light diffuses in thick cells, and paths are long. Their directions are not those of
   ordinates, whose errors would add up over many scatterings. The same holds with PHASE_CLASSES, because
   each cell has its own phase function.

   COUNTED: the number of cells that segments crossed replaces WITHIN. */

#include "simd.h"

#include "directions.h"
#include "extinction.h"
#include "path_segment.h"
#include "phase.h"
#include "random.h"
#include "ray.h"

#ifdef PHASE_CLASSES
#define COSINE(u, cell) class_cosine(u, m->shares + (cell), m->size, table)
#else
#define COSINE(u, cell) phase_cosine(u, table)
#endif

/* Weight of an ordinate for light scattered along `sight`, over the probability with which it is drawn:
   that of a line of sight along +y. */
INLINE real phase_weight(real4 direction, real3 sight, __global const real *by_half_sine)
{
#ifdef PHASE_STEPS
    const real cosine = direction.x * sight.x + direction.y * sight.y + direction.z * sight.z;
    return by_half_sine[half_sine_bin(cosine)] / by_half_sine[half_sine_bin(direction.y)];
#else
    return R(1);
#endif
}

/* Words of a point of a low-discrepancy set; shifts randomise them. The first is the place on the line of
   sight, the others are for a path's first two scatterings. */
#define DIMENSIONS 8

/* A path, in one lane: its point, its scatterings so far, the ordinate whose stored radiance its segment
   ends in, and the weight below which it ends. */
typedef struct {
    uint point, event;
    int number;
    real floor;
} Path;

/* What the paths of a pixel have in common. */
typedef struct {
    real3 sight;                  /* unit vector away from the camera */
    __global const uint *points;  /* DIMENSIONS words each */
    uint4 shift0, shift1;
    uint first;                   /* number of the first point */
    uint pixel, half_;
    uint2 key;
    uint most_segments;           /* of a path */
    real end_weight;              /* share of its weight below which a path ends ... */
    real least_transmission;      /* ... and a segment */
} PixelPaths;

/* Ends a path, or a part of its weight, in the sweeps' source along d at p of a cell. */
INLINE void end_at(real *sum, real weight, real3 p, real3 d, __global const real *record)
{
    Light light = no_light();
    add_source(&light, weight, weight * (p - R(0.5)), d, record);
    score_light(sum, weight, &light);
}

/* Starts a path at p in a thick `cell`. Returns 0 where the path ends there. */
INLINE int start_path(
    real *sum, Segments *f, int lane, Path *path, uint point, int cell, real3 p, real weight,
    const PixelPaths *common, const ThickRegion *m, __global const real *by_half_sine,
    __global const real *table)
{
    __global const uint *word = common->points + point * DIMENSIONS;
    path->point = point;
    path->event = 0;
#ifdef FREE_DIRECTIONS
    const real4 d = (real4)(
        turned(
            common->sight, COSINE(unit(word[1] ^ common->shift0.x), cell),
            unit(word[6] ^ common->shift0.z)), R(0));
    path->number = m->nearest[direction_near(d.xyz)];
    if (path->number < 0) { /* no ordinate is in that octant */
        end_at(sum, weight, p, d.xyz, m->cells + (size_t)cell * RECORD);
        return 0;
    }
#else
    const int drawn =
        direction_at(unit(word[1] ^ common->shift0.x), m->directions, m->start, m->count);
    const real4 d = m->directions[drawn];
    weight *= phase_weight(d, common->sight, by_half_sine);
    path->number = m->number_of[drawn];
#endif
    path->floor = common->end_weight * weight;
    start_segment(
        f, lane, cell, p, d.xyz, weight, common->least_transmission, unit(word[2] ^ common->shift0.y));
    return 1;
}

/* Continues a path from the place that was drawn on its segment. Returns 0 where the path has ended. */
INLINE int continue_path(
    real *sum, Segments *f, int lane, Path *path, const PixelPaths *common, const ThickRegion *m,
    __global const real *table)
{
    const int cell = LANE_I(f->drawn, lane);
    const real weight = LANE(f->scattered, lane);
    if (cell < 0 || !(weight > R(0))) return 0;
    __global const real *record = m->cells + (size_t)cell * RECORD;
    const real3 d = f->direction[lane];
    const real3 p = (real3)(LANE(f->x, lane), LANE(f->y, lane), LANE(f->z, lane))
        + length_at(LANE(f->u, lane), LANE(f->share, lane), record[DEPTH]) * d;
    /* What is left of a path's weight ends in the sweeps' source. So every path conserves energy, and
       none brings less than no light, as Russian roulette with a source would. */
    if (++path->event >= common->most_segments || weight < path->floor) {
        end_at(sum, weight, p, d, record);
        return 0;
    }
    __global const uint *word = common->points + path->point * DIMENSIONS;
    const uint4 counter =
        (uint4)(common->pixel, common->first + path->point, path->event, common->half_);
    const uint4 words = path->event == 1
        ? (uint4)(word[3], word[4], word[5], word[7]) ^ common->shift1 : philox(counter, common->key);
#if defined(PHASE_BINS) || defined(FREE_DIRECTIONS)
    const real3 on = turned(d, COSINE(unit(words.x), cell), unit(words.y));
    path->number = m->nearest[direction_near(on)];
    if (path->number < 0) { /* no ordinate is in that octant */
        end_at(sum, weight, p, d, record);
        return 0;
    }
#else
    const int drawn = direction_at(unit(words.x), m->directions, m->start, m->count);
    const real3 on = m->directions[drawn].xyz;
    path->number = m->number_of[drawn];
#endif
    start_segment(f, lane, cell, p, on, weight, common->least_transmission, unit(words.z));
    return 1;
}

/* An interval of a line of sight within a thick cell: the cell; start and length on the line; absorbed
   share; what thick cells scatter to the camera up to its end; and the extinction where it begins and its
   rise. */
#define AT 3
#define LENGTH 4
#define SHARE 5
#define CUMULATIVE 6
#define ENTRY 7
#define RISE 8
#define INTERVAL 9

/* Intervals of each listed ray. With `fill` they are written from `first` on, else only counted. */
__kernel void thick_intervals(
    __global int *number,        /* out: of intervals, [list] */
    __global real *intervals,    /* out */
    __global const int *first,   /* in: of each ray's intervals */
    const int fill,
    __global const real4 *list,  /* in: of rays, see ray_at */
    const int count,
    __global const real *albedo, /* in: of stored cells that are thick, else 0 */
    __global const int *directory, __global const int *span, __global const real *depth,
    CELL_GRADIENTS_ARGUMENT
    const int coarse, const int stored, const int bricks, const int4 low, const int4 high,
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, const real cutoff, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const real4 at_lens = list[item];
    const Ray ray = ray_at(
        at_lens.x, at_lens.y, at_lens.z, at_lens.w, columns, rows, middle, pitch_x, pitch_z, distance);
    const Grid grid = {coarse, bricks, low, high};
    Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    real transmitted = R(1), loss = R(0);
    int crossed = 0;
    int inside = traversal_enter(&traversal, &grid, ray.start);
    while (inside && transmitted > cutoff) {
        const Crossing cell = traversal_cell(&traversal, &grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const Extinction here_ = extinction_along(
                density, GRADIENTS_OF(cell_gradients, cell.address), &traversal, &cell);
            const lane_t t = (lane_t)optical_depth(here_, traversal_length(&traversal, &cell));
            const lane_t shares = absorbed(t), left = decay(t);
            const real share = LANE(shares, 0);
            real taken = transmitted * share;
            transmitted *= LANE(left, 0);
            if (transmitted <= cutoff) taken += transmitted; /* as in image.cl */
            real scatters = albedo[cell.address];
#ifdef LINEAR_COEFFICIENTS
            if (scatters > R(0) && share > R(0)) { /* at the mean place, as by mean_place */
                const lane_t nearer = t * rising(t, shares, mean_transmission(t, shares));
                const real at = R(0.5) * (traversal.t + cell.next)
                    - LANE(nearer, 0) / share * (cell.next - traversal.t);
                scatters += along_gradient(
                    GRADIENTS_OF(cell_gradients, cell.address) + 3, place_in(&traversal, &cell, at));
            }
#endif
            const real here = taken * scatters;
            if (here > R(0)) {
                loss += here;
                if (fill) {
                    __global real *one = intervals + (size_t)(first[item] + crossed) * INTERVAL;
                    one[0] = traversal.x;
                    one[1] = traversal.y;
                    one[2] = traversal.z;
                    one[AT] = traversal.t;
                    one[LENGTH] = cell.next - traversal.t;
                    one[SHARE] = share;
                    one[CUMULATIVE] = loss;
                    one[ENTRY] = here_.entry;
                    one[RISE] = here_.rise;
                }
                ++crossed;
            }
        }
        inside = traversal_advance(&traversal, &cell, &grid);
    }
    if (!fill) number[item] = crossed;
}

/* Means of two independent sets of paths for each chosen ray, with the points from `from_point` on. The first
   dimension of a point is the share of all that thick cells scatter on the line, up to the path's start. */
__kernel void gather(
    __global real *means,         /* out: [half][part][list], the last part the number of segments */
    __global const int2 *chosen,  /* in: number of a ray, and of the samples of either half */
    const int count, const uint from_point, const uint2 key,
    __global const uint *points,  /* in: low-discrepancy, one a path */
    __global const real4 *list,   /* in: of rays, see ray_at */
    __global const uint *numbers, /* in: of rays, for random numbers */
    __global const int *first,    /* in: of each ray's intervals, and the end */
    __global const real *intervals,
    __global const real *table, __global const real *by_half_sine,
    __global const int *places,   /* in: from here to `box_shape`, see ThickRegion */
    __global const int4 *at, __global const int *beside, __global const real *region_depth,
    __global const real *cells, __global const real *light,
    __global const real4 *directions, __global const int *number_of, __global const int *start,
    __global const int *nearest,
    const int direction_count, const int4 box_low, const int4 box_shape,
    const uint most_segments, const real end_weight, const real least_transmission, /* see PixelPaths */
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, BOUNDARY_ARGUMENTS
#ifdef BLURRED_BOUNDARY
    , __global const real *whole_depth
#endif
#ifdef PHASE_CLASSES
    , __global const uchar *class_shares, const int region_cells
#endif
    )
{
    const int item = get_global_id(0);
    const uint half_ = get_global_id(1);
    if (item >= count) return;
    const int number = chosen[item].x;
    const uint samples = chosen[item].y;
    const real4 at_lens = list[number];
    const Ray ray = ray_at(
        at_lens.x, at_lens.y, at_lens.z, at_lens.w, columns, rows, middle, pitch_x, pitch_z, distance);
    const ThickRegion region = {places, at, beside, region_depth, cells, light, directions, number_of,
                       start, nearest, direction_count, box_low, box_shape,
                       BOUNDARY
#ifdef BLURRED_BOUNDARY
                       , whole_depth
#endif
#ifdef PHASE_CLASSES
                       , class_shares, region_cells
#endif
                       };
    const real3 from = (real3)(ray.px, ray.py, ray.pz);
    const real3 sight = (real3)(ray.dx, ray.dy, ray.dz);
    const uint pixel = numbers[number];
    const PixelPaths common = {
        sight, points, philox((uint4)(pixel, 0, 0xFFFFFFFFu, half_), key),
        philox((uint4)(pixel, 1, 0xFFFFFFFFu, half_), key), from_point, pixel, half_, key,
        most_segments, end_weight, least_transmission};
    /* Two sums: a long path's scores are far smaller than the total. */
    real sum[PARTS], total[PARTS];
    PendingScores pending;
    pending.count = 0;
#ifdef COUNTED
    pending.crossed = 0;
#endif
    for (int c = 0; c < PARTS; ++c) sum[c] = total[c] = pending.sum[c] = R(0);
    /* A ray whose weight was all rounding has no interval. */
    const int interval_count = first[number + 1] - first[number];
    __global const real *interval = intervals + (size_t)first[number] * INTERVAL;
    const real all =
        interval_count > 0 ? interval[(interval_count - 1) * INTERVAL + CUMULATIVE] : R(0);

#if defined(PHASE_STEPS) && !defined(FREE_DIRECTIONS)
    real weights = R(0);
    for (uint k = 0; k < samples; ++k) {
        const uint word = points[k * DIMENSIONS + 1] ^ common.shift0.x;
        const int drawn = direction_at(unit(word), directions, start, direction_count);
        weights += phase_weight(directions[drawn], sight, by_half_sine);
    }
    const real path_weight = all / weights;
#else
    const real path_weight = all / samples;
#endif
    const int interval_last = interval_count - 1;
    real segments = R(0);
    Segments f = no_segments();
    Path paths[SIMD_WIDTH];
    int idle[SIMD_WIDTH];
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) idle[lane] = 1;
    uint started = all > R(0) ? 0 : samples;
    for (;;) {
        for (int lane = 0; lane < SIMD_WIDTH && started < samples; ++lane) {
            if (!idle[lane]) continue;
            idle[lane] = 0;
            const real goal = unit(points[started * DIMENSIONS] ^ common.shift0.w) * all;
            int here = 0;
            while (here < interval_last && goal >= interval[here * INTERVAL + CUMULATIVE]) ++here;
            __global const real *one = interval + here * INTERVAL;
            const real before = here > 0 ? one[CUMULATIVE - INTERVAL] : R(0);
            const real part = most(R(0), least((goal - before) / (one[CUMULATIVE] - before), R(1)));
            const Extinction there = {one[ENTRY], one[RISE]};
            const real along = one[AT] + least(length_along(part, one[SHARE], there), one[LENGTH]);
            const int3 corner = (int3)((int)one[0], (int)one[1], (int)one[2]);
            const int cell = number_in(corner, &region);
            const real3 place = from + along * sight - (real3)(one[0], one[1], one[2]);
            idle[lane] = !start_path(
                sum, &f, lane, &paths[lane], started++, cell, place, path_weight,
                &common, &region, by_half_sine, table);
            segments += R(1);
        }
        if (!any_of(f.active)) {
            if (started >= samples) break;
            continue;
        }
        const SegmentEnd e = cross_cell(sum, &pending, &f, &region);
        if (!any_of(e.ended)) continue;
        for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
            if (!LANE_I(e.ended, lane)) continue;
            LANE_I(f.active, lane) = 0;
            end_segment(sum, &pending, &f, lane, &e, paths[lane].number, &region);
            idle[lane] = !continue_path(sum, &f, lane, &paths[lane], &common, &region, table);
            segments += idle[lane] ? R(0) : R(1);
        }
        UNROLL for (int c = 0; c < PARTS; ++c) {
            total[c] += sum[c];
            sum[c] = R(0);
        }
    }
    flush_scores(&pending);
    const int row = half_ * (PARTS + 1);
    for (int c = 0; c < PARTS; ++c)
        means[in_table(row + c, count, item)] = total[c] + sum[c] + pending.sum[c];
    means[in_table(row + PARTS, count, item)] = segments;
#ifdef COUNTED
    means[in_table(row + WITHIN, count, item)] = pending.crossed;
#endif
}
