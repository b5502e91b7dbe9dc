/* What thick cells scatter towards the camera.

   In the sweeps a cell has one source, or one that is linear in it. Within a thick one what it sends
   back to where it is lit from is more than that tells. Where a line of sight meets thick cells,
   flights start from places on it along the directions of the last sweep, by the phase function
   itself. On its way through a region, thick cells and those around them, a flight scores what they
   send along it, by the source that the last sweep had; it ends at the first face to another cell,
   where that sweep has stored the light that comes in along each of its directions, or at the
   boundary. No flight is longer than a few cells.

   In deep cells, where no linear source will do, a flight collects what is scattered instead, and all
   of that goes on from one place, in a chain: by the phase function itself, in the medium as it is.
   Chains end by Russian roulette, in which the light that sweeps found there stands for what is left;
   after MAX_SEGMENTS flights they end in that alone: light that has been scattered so often has forgotten
   where it came in. So every chain keeps its light to rounding. Without a phase function a chain's
   further flights, as its first, bring what is more than the light in their cell along their
   direction, one of the last sweep's; what all directions bring of it is known.

   COUNTED: the part from within is left out; how many cells flights crossed stands there. */

#include "simd.h"

#include "directions.h"
#include "path_segment.h"
#include "phase.h"
#include "random.h"
#include "ray.h"
#include "octree_traversal.h"

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif
#ifndef MAX_SEGMENTS
#error "MAX_SEGMENTS: flights of a chain"
#endif
#ifndef ROULETTE
#error "ROULETTE: share of its weight below which a path may end"
#endif

/* Weight of a direction for light scattered along `sight`: the directions are shared out as for a
   line of sight along +y. */
#if defined(PHASE_STEPS) && defined(CAMERA_PINHOLE)
#define SHARES
#endif
INLINE real share_of(real4 direction, real3 sight, __global const real *steps)
{
#ifdef SHARES
    const real cosine = direction.x * sight.x + direction.y * sight.y + direction.z * sight.z;
    return steps[half_sine_bin(cosine)] / steps[half_sine_bin(direction.y)];
#else
    return R(1);
#endif
}

/* Words of a point of a low-discrepancy set, of which those for a chain's first two scatterings are
   shifted. The first dimension is the place along the line of sight. */
#define DIMENSIONS 8

/* A chain, in one lane: its point, and its scatterings so far; of its flight the number of the direction
   whose light it is to end in, and the chance that it is the last where its weight is below `floor`. */
typedef struct {
    uint point, event;
    int number;
    uint chance;
    real floor;
} Path;

/* What a pixel's chains have in common. */
typedef struct {
    real3 sight;                  /* along which light is scattered to the camera */
    __global const uint *points;  /* DIMENSIONS words each */
    uint4 shift0, shift1;
    uint first;                   /* number of the first point */
    uint pixel, half_;
    uint2 key;
} Chances;

/* Begins a chain at p in a thick `cell`. It brings what is more than the light in that cell along its
   first direction, as the last sweep had it. That varies far less; what all directions bring of it is
   known (`control_variate`). */
INLINE void start_path(
    Segments *f, PendingScores *pending, int lane, Path *path, uint point, int cell, real3 p, real weight,
    const Chances *chance, const ThickRegion *m, __global const real *steps)
{
    __global const uint *word = chance->points + point * DIMENSIONS;
    const int drawn =
        direction_at(unit(word[1] ^ chance->shift0.x), m->directions, m->start, m->count);
    const real4 d = m->directions[drawn];
    const int number = m->number_of[drawn];
    weight *= share_of(d, chance->sight, steps);
    const int own = m->beside[SIDES * cell + OWN];
    if (own >= 0) score_later(pending, -weight, m->light + ((size_t)own * m->count + number) * COMPONENTS);
    path->point = point;
    path->event = 0;
    path->number = number;
    path->chance = word[6] ^ chance->shift0.z;
    path->floor = ROULETTE * weight;
    start_segment(f, lane, cell, p, d.xyz, weight, unit(word[2] ^ chance->shift0.y));
}

/* Ends a chain, or a part of it, in what the sweeps have light along d scattered into at p of a cell. */
INLINE void end_at(real *sum, real weight, real3 p, real3 d, __global const real *record)
{
    Light light = no_light();
    add_source(&light, weight, weight * (p - R(0.5)), d, record);
    score_light(sum, weight, &light);
}

/* Goes on from the place that was drawn on a flight, if any; 0: the chain has ended. */
INLINE int continue_path(
    real *sum, PendingScores *pending, Segments *f, int lane, Path *path, const Chances *chance, const ThickRegion *m,
    __global const real *table)
{
    const int cell = LANE_I(f->met, lane);
    real weight = LANE(f->scattered, lane);
    if (cell < 0 || !(weight > R(0))) return 0;
    __global const real *record = m->cells + (size_t)cell * RECORD;
    const real3 d = f->way[lane];
    const real3 p = (real3)(LANE(f->x, lane), LANE(f->y, lane), LANE(f->z, lane))
        + length_at(LANE(f->u, lane), LANE(f->share, lane), record[DEPTH]) * d;
    /* Where it ends, and on average where it does not, light as the sweeps have it there stands for
       what is left: no light is made or lost by chance. */
    real known = R(0);
    int last = ++path->event >= MAX_SEGMENTS;
    if (last) {
        known = weight;
    } else if (weight < path->floor) {
        last = unit(path->chance) * path->floor >= weight;
        known = last ? weight : weight - path->floor;
        weight = path->floor;
    }
    if (known != R(0)) end_at(sum, known, p, d, record);
    if (last) return 0;
    __global const uint *word = chance->points + path->point * DIMENSIONS;
    const uint4 counter =
        (uint4)(chance->pixel, chance->first + path->point, path->event, chance->half_);
    const uint4 words = path->event == 1
        ? (uint4)(word[3], word[4], word[5], word[7]) ^ chance->shift1 : philox(counter, chance->key);
#ifdef PHASE_BINS
    const real3 on = turned(d, phase_cosine(unit(words.x), table), unit(words.y));
    path->number = m->nearest[direction_near(on)];
    if (path->number < 0) { /* none of few directions is in that octant */
        end_at(sum, weight, p, d, record);
        return 0;
    }
#else
    const int drawn = direction_at(unit(words.x), m->directions, m->start, m->count);
    const real3 on = m->directions[drawn].xyz;
    path->number = m->number_of[drawn];
    const int own = m->beside[SIDES * cell + OWN];
    if (own >= 0) { /* one beside the other, as a long chain brings much more of either than of both */
        score(pending->sum, weight, m->means + (own - m->first_own) * COMPONENTS);
        score_later(
            pending, -weight, m->light + ((size_t)own * m->count + path->number) * COMPONENTS);
    }
#endif
    path->chance = words.w;
    start_segment(f, lane, cell, p, on, weight, unit(words.z));
    return 1;
}

/* Light that each thick cell scatters towards the camera, of all directions, as the last sweep had it
   in the cell: what chains bring on average, less what they bring more. */
__kernel void control_variate(
    __global real *means,         /* out: [cell][component] */
    __global const int4 *cells,   /* in: of the cube; number of the light in it */
    const int count,
    __global const real *light, __global const real4 *directions,
    __global const int *number_of, const int direction_count,
    __global const real *steps, const real4 camera)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int4 cell = cells[item];
#ifdef SHARES
    const real3 way = (real3)(
        cell.x + R(0.5) - camera.x, cell.y + R(0.5) - camera.y, cell.z + R(0.5) - camera.z);
    const real far = root(way.x * way.x + way.y * way.y + way.z * way.z);
    const real3 sight = way / most(far, R(1e-6));
#else
    const real3 sight = (real3)(R(0), R(1), R(0));
#endif
    /* What is more than along the first, for its rounding would count once for each flight of a chain. */
    __global const real *lit = light + (size_t)cell.w * direction_count * COMPONENTS;
    real more[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) more[c] = R(0);
    real all = R(0), before = R(0);
    for (int k = 0; k < direction_count; ++k) {
        const real share = (directions[k].w - before) * share_of(directions[k], sight, steps);
        before = directions[k].w;
        all += share;
        __global const real *seen = lit + number_of[k] * COMPONENTS;
        for (int c = 0; c < COMPONENTS; ++c) more[c] += share * (seen[c] - lit[c]);
    }
    for (int c = 0; c < COMPONENTS; ++c) means[item * COMPONENTS + c] = lit[c] + more[c] / all;
}

/* A stretch of a line of sight within a thick cell: the cell; where on the line it begins and how
   long it is; optical depth of the cell's edge; what part of the light the stretch takes out; and
   how much of what the camera sees thick cells up to its end scatter. */
#define AT 3
#define LENGTH 4
#define DENSITY 5
#define SHARE 6
#define UP_TO 7
#define INTERVAL 8

/* The stretches of each listed ray: with `fill` into its place among them, else only their number. */
__kernel void thick_intervals(
    __global int *number,        /* out: of stretches, [list] */
    __global real *intervals,    /* out */
    __global const int *first,   /* in: of each ray's stretches */
    const int fill,
    __global const real *list,   /* in: [across, down] of rays, in pixels */
    const int count,
    __global const real *albedo, /* in: of stored cells that are thick, else 0 */
    __global const int *directory, __global const int *span, __global const real *depth,
    const int coarse, const int stored, const int bricks, const int4 low, const int4 high,
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const Ray ray = ray_at(
        list[2 * item], list[2 * item + 1], columns, rows, middle, pitch_x, pitch_z, distance);
    const Grid grid = {coarse, bricks, low, high};
    Traversal traversal = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    real transmitted = R(1), loss = R(0);
    int met = 0;
    int inside = traversal_enter(&traversal, &grid, ray.start);
    while (inside && transmitted > R(CUTOFF)) {
        const Crossing cell = traversal_cell(&traversal, &grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const lane_t shares = absorbed((lane_t)(density * traversal_length(&traversal, &cell)));
            const real share = LANE(shares, 0);
            real taken = transmitted * share;
            transmitted -= taken;
            if (transmitted <= R(CUTOFF)) taken += transmitted; /* as in image.cl */
            const real here = taken * albedo[cell.address];
            if (here > R(0)) {
                loss += here;
                if (fill) {
                    __global real *one = intervals + (size_t)(first[item] + met) * INTERVAL;
                    one[0] = traversal.x;
                    one[1] = traversal.y;
                    one[2] = traversal.z;
                    one[AT] = traversal.t;
                    one[LENGTH] = cell.next - traversal.t;
                    one[DENSITY] = density;
                    one[SHARE] = share;
                    one[UP_TO] = loss;
                }
                ++met;
            }
        }
        inside = traversal_advance(&traversal, &cell, &grid);
    }
    if (!fill) number[item] = met;
}

/* Mean of so many chains for each chosen ray, those of the points from `from_point` on. A chain
   scatters for the first time where the share of all that thick cells scatter on the line has been
   scattered that the point's first dimension says. */
__kernel void gather(
    __global real *means,         /* out: [component][list], and the part from within */
    __global const int *chosen,   /* in: of the rays */
    const int count, const uint samples, const uint from_point, const uint2 key, const uint half_,
    __global const uint *points,  /* in: low-discrepancy, one a chain */
    __global const real *list,    /* in: [across, down] of rays, in pixels */
    __global const uint *numbers, /* in: of rays; chance goes by them */
    __global const int *first,    /* in: of each ray's stretches, and their end */
    __global const real *intervals,
    __global const real *table, __global const real *steps,
    __global const int *places,   /* in: from here to `box_shape`, see Near */
    __global const int4 *at, __global const int *beside, __global const real *region_depth,
    __global const real *cells, __global const real *light,
    __global const real4 *directions, __global const int *number_of, __global const int *start,
    __global const int *nearest, __global const real *light_means, const int first_own,
    const int direction_count, const int4 box_low, const int4 box_shape,
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int number = chosen[item];
    const Ray ray = ray_at(
        list[2 * number], list[2 * number + 1], columns, rows, middle, pitch_x, pitch_z, distance);
    const ThickRegion region = {places, at, beside, region_depth, cells, light, directions, number_of,
                       start, nearest, light_means, first_own, direction_count, box_low, box_shape,
                       BOUNDARY};
    const real3 from = (real3)(ray.px, ray.py, ray.pz);
    const real3 sight = (real3)(ray.dx, ray.dy, ray.dz);
    const uint pixel = numbers[number];
    const Chances chance = {
        sight, points, philox((uint4)(pixel, 0, 0xFFFFFFFFu, half_), key),
        philox((uint4)(pixel, 1, 0xFFFFFFFFu, half_), key), from_point, pixel, half_, key};
    /* Summed apart: of a long chain the parts are far less than the sum of all. */
    real sum[PARTS], total[PARTS];
    PendingScores pending;
    pending.count = 0;
#ifdef COUNTED
    pending.crossed = 0;
#endif
    for (int c = 0; c < PARTS; ++c) sum[c] = total[c] = pending.sum[c] = R(0);
    /* Its weight may have been all rounding: then there is no stretch, and nothing to gather. */
    const int interval_count = first[number + 1] - first[number];
    __global const real *interval = intervals + (size_t)first[number] * INTERVAL;
    const real all =
        interval_count > 0 ? interval[(interval_count - 1) * INTERVAL + UP_TO] : R(0);

#ifdef SHARES
    real shares = R(0);
    for (uint k = 0; k < samples; ++k) {
        const uint word = points[k * DIMENSIONS + 1] ^ chance.shift0.x;
        const int towards = direction_at(unit(word), directions, start, direction_count);
        shares += share_of(directions[towards], sight, steps);
    }
    const real even = all / shares;
#else
    const real even = all / samples;
#endif
    const int interval_last = interval_count - 1;
    Segments f = no_segments();
    Path paths[SIMD_WIDTH];
    int idle[SIMD_WIDTH];
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) idle[lane] = 1;
    uint begun = all > R(0) ? 0 : samples;
    for (;;) {
        for (int lane = 0; lane < SIMD_WIDTH && begun < samples; ++lane) {
            if (!idle[lane]) continue;
            idle[lane] = 0;
            const real goal = unit(points[begun * DIMENSIONS] ^ chance.shift0.w) * all;
            int met = 0;
            while (met < interval_last && goal >= interval[met * INTERVAL + UP_TO]) ++met;
            __global const real *one = interval + met * INTERVAL;
            const real before = met > 0 ? one[UP_TO - INTERVAL] : R(0);
            const real part = most(R(0), least((goal - before) / (one[UP_TO] - before), R(1)));
            const real along =
                one[AT] + least(length_at(part, one[SHARE], one[DENSITY]), one[LENGTH]);
            const real3 corner = (real3)(one[0], one[1], one[2]);
            const int cell =
                number_in((int3)((int)corner.x, (int)corner.y, (int)corner.z), &region);
            start_path(&f, &pending, lane, &paths[lane], begun++, cell, from + along * sight - corner, even,
                  &chance, &region, steps);
        }
        if (!any_of(f.active)) break;
        const SegmentEnd e = cross_cell(sum, &pending, &f, &region);
        if (!any_of(e.ended)) continue;
        for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
            if (!LANE_I(e.ended, lane)) continue;
            LANE_I(f.active, lane) = 0;
            end_segment(sum, &pending, &f, lane, &e, paths[lane].number, &region);
            idle[lane] = !continue_path(sum, &pending, &f, lane, &paths[lane], &chance, &region, table);
        }
        UNROLL for (int c = 0; c < PARTS; ++c) {
            total[c] += sum[c];
            sum[c] = R(0);
        }
    }
    flush_scores(&pending);
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = total[c] + pending.sum[c];
#ifdef COUNTED
    means[WITHIN * count + item] = pending.crossed;
#endif
}
