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
   Chains of little weight end by Russian roulette, in which the light that sweeps found there stands
   for what is left, and after LONGEST flights with that alone: light that has been scattered so often
   has forgotten where it came in. So every chain keeps its light to rounding.

   COUNTED: the part from within is left out; how many cells flights crossed stands there. */

#include "directions.h"
#include "flight.h"
#include "phase.h"
#include "random.h"
#include "ray.h"
#include "walk.h"

#ifndef LONGEST
#error "LONGEST: flights of a chain"
#endif
#define ROULETTE R(0.3) /* weight under which a chain may end */

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

/* Chance of a chain's first two scatterings: a point of a low-discrepancy set, shifted. The first
   dimension is the place along the line of sight. */
#define DIMENSIONS 8
typedef struct {
    __global const uint *point;
    uint4 shift0, shift1;
} Chance;

/* Follows one chain from p in a thick `cell`, where light is scattered along `sight`: what it brings
   more than the light in that cell along its first direction, as the last sweep had it. That varies
   far less; what all directions bring of it is known (`expected`). */
INLINE void chain(
    real *sum, Ends *ends, real weight, real3 p, int3 cell, real3 sight, uint4 counter, uint2 key,
    const Chance *chance, const Near *m, __global const real *table, __global const real *steps)
{
    const real floor_ = ROULETTE * weight;
    real3 d = sight;
    for (uint event = 0; ; ++event) {
        uint4 word;
        int number;
        if (event == 0) {
            word.x = chance->point[1] ^ chance->shift0.x;
            word.z = chance->point[2] ^ chance->shift0.y;
            word.w = chance->point[6] ^ chance->shift0.z;
            const int drawn = direction_at(unit(word.x), m->directions, m->start, m->count);
            d = m->directions[drawn].xyz;
            weight *= share_of(m->directions[drawn], sight, steps);
            number = m->number_of[drawn];
            const int own = own_number(cell, m);
            if (own >= 0)
                score_later(ends, -weight, m->light + ((size_t)number * m->rim + own) * COMPONENTS);
        } else {
            if (event == 1) {
                word.x = chance->point[3] ^ chance->shift1.x;
                word.y = chance->point[4] ^ chance->shift1.y;
                word.z = chance->point[5] ^ chance->shift1.z;
                word.w = chance->point[7] ^ chance->shift1.w;
            } else {
                counter.z = event;
                word = philox(counter, key);
            }
            d = turned(d, phase_cosine(unit(word.x), table), unit(word.y));
            number = m->nearest[direction_near(d)];
        }
        __global const real *met = flight(sum, ends, &weight, &p, &cell, d, number, unit(word.z), m);
        if (!met || !(weight > R(0))) return;
        /* Where it ends, and on average where it does not, light as the sweeps have it there stands
           for what is left: no light is made or lost by chance. */
        real known = R(0);
        int ends = event + 1 >= LONGEST;
        if (ends) {
            known = weight;
        } else if (weight < floor_) {
            ends = unit(word.w) * floor_ >= weight;
            known = ends ? weight : weight - floor_;
            weight = floor_;
        }
        if (known != R(0)) {
            const real3 place = p - (real3)(cell.x + R(0.5), cell.y + R(0.5), cell.z + R(0.5));
            score_source(sum, known, known * place, d, met);
        }
        if (ends) return;
    }
}

/* Light that each thick cell scatters towards the camera, of all directions, as the last sweep had it
   in the cell: what chains bring on average, less what they bring more. */
__kernel void expected(
    __global real *means,         /* out: [cell][component] */
    __global const int4 *cells,   /* in: of the cube; number of the light in it */
    const int count,
    __global const real *light, const int rim,
    __global const real4 *directions, __global const int *number_of, const int direction_count,
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
    real sum[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) sum[c] = R(0);
    real all = R(0), before = R(0);
    for (int k = 0; k < direction_count; ++k) {
        const real share = (directions[k].w - before) * share_of(directions[k], sight, steps);
        before = directions[k].w;
        all += share;
        __global const real *seen = light + ((size_t)number_of[k] * rim + cell.w) * COMPONENTS;
        for (int c = 0; c < COMPONENTS; ++c) sum[c] += share * seen[c];
    }
    for (int c = 0; c < COMPONENTS; ++c) means[item * COMPONENTS + c] = sum[c] / all;
}

/* A stretch of a line of sight within a thick cell: the cell; where on the line it begins and how
   long it is; optical depth of the cell's edge; what part of the light the stretch takes out; and
   how much of what the camera sees thick cells up to its end scatter. */
#define AT 3
#define LENGTH 4
#define DENSITY 5
#define SHARE 6
#define UP_TO 7
#define STRETCH 8

/* The stretches of each listed ray: with `fill` into its place among them, else only their number. */
__kernel void meet(
    __global int *number,        /* out: of stretches, [list] */
    __global real *stretches,    /* out */
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
    Walk walk = {ray.px, ray.py, ray.pz, ray.dx, ray.dy, ray.dz, R(0), 0, 0, 0};
    real transmitted = R(1), loss = R(0);
    int met = 0;
    int inside = walk_in(&walk, &grid, ray.start);
    while (inside && transmitted > R(CUTOFF)) {
        const Crossing cell = walk_ahead(&walk, &grid, directory, span);
        const real density = depth[cell.address];
        if (density > R(0)) {
            const real share = absorbed(density * walk_length(&walk, &cell));
            real taken = transmitted * share;
            transmitted -= taken;
            if (transmitted <= R(CUTOFF)) taken += transmitted; /* as in image.cl */
            const real here = taken * albedo[cell.address];
            if (here > R(0)) {
                loss += here;
                if (fill) {
                    __global real *one = stretches + (size_t)(first[item] + met) * STRETCH;
                    one[0] = walk.x;
                    one[1] = walk.y;
                    one[2] = walk.z;
                    one[AT] = walk.t;
                    one[LENGTH] = cell.next - walk.t;
                    one[DENSITY] = density;
                    one[SHARE] = share;
                    one[UP_TO] = loss;
                }
                ++met;
            }
        }
        inside = walk_on(&walk, &cell, &grid);
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
    __global const real *stretches,
    __global const real *table, __global const real *steps,
    __global const int *places, __global const int *faces, __global const real *cells,
    __global const real *light, const int rim,
    __global const real4 *directions, __global const int *number_of, __global const int *start,
    __global const int *nearest, const int direction_count, const int4 box_low, const int4 box_shape,
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int number = chosen[item];
    const Ray ray = ray_at(
        list[2 * number], list[2 * number + 1], columns, rows, middle, pitch_x, pitch_z, distance);
    const Near near = {places, faces, cells, light, rim, directions, number_of, start, nearest,
                       direction_count, box_low, box_shape, BOUNDARY};
    const real3 from = (real3)(ray.px, ray.py, ray.pz);
    const real3 sight = (real3)(ray.dx, ray.dy, ray.dz);
    Chance chance;
    chance.shift0 = philox((uint4)(numbers[number], 0, 0xFFFFFFFFu, half_), key);
    chance.shift1 = philox((uint4)(numbers[number], 1, 0xFFFFFFFFu, half_), key);
    real sum[PARTS];
    Ends ends;
    ends.count = 0;
#ifdef COUNTED
    ends.crossed = 0;
#endif
    for (int c = 0; c < PARTS; ++c) sum[c] = ends.sum[c] = R(0);
    /* Its weight may have been all rounding: then there is no stretch, and nothing to gather. */
    const int stretch_count = first[number + 1] - first[number];
    __global const real *stretch = stretches + (size_t)first[number] * STRETCH;
    const real all =
        stretch_count > 0 ? stretch[(stretch_count - 1) * STRETCH + UP_TO] : R(0);

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
    const int stretch_last = stretch_count - 1;
    for (uint k = 0; k < samples && all > R(0); ++k) {
        chance.point = points + k * DIMENSIONS;
        const real goal = unit(chance.point[0] ^ chance.shift0.w) * all;
        int met = 0;
        while (met < stretch_last && goal >= stretch[met * STRETCH + UP_TO]) ++met;
        __global const real *one = stretch + met * STRETCH;
        const real before = met > 0 ? one[UP_TO - STRETCH] : R(0);
        const real part = most(R(0), least((goal - before) / (one[UP_TO] - before), R(1)));
        const real along =
            one[AT] + least(length_at(part, one[SHARE], one[DENSITY]), one[LENGTH]);
        /* Summed apart: of a long chain the parts are far less than the sum of all. */
        real of_chain[PARTS];
        for (int c = 0; c < PARTS; ++c) of_chain[c] = R(0);
        chain(of_chain, &ends, even, from + along * sight,
              (int3)((int)one[0], (int)one[1], (int)one[2]), sight,
              (uint4)(numbers[number], from_point + k, 0, half_), key, &chance, &near, table, steps);
        for (int c = 0; c < PARTS; ++c) sum[c] += of_chain[c];
    }
    score_pending(&ends);
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = sum[c] + ends.sum[c];
#ifdef COUNTED
    means[WITHIN * count + item] = ends.crossed;
#endif
}
