/* What thick cells scatter towards the camera.

   In the sweeps a cell has one source. Within a thick one the light varies, and what it sends back
   to where it is lit from is far more than its mean. Where a line of sight meets thick cells, chains
   follow what these scatter, by the phase function itself, from thick cell to thick cell; a flight
   ends in the first other cell, one of the rim, of which the last sweep has stored the light that
   leaves it in each of its directions, or at the boundary. No flight is longer than a few cells.

   Of what a flight loses all that is scattered goes on, from one place; chains of little weight end
   by Russian roulette, in which the cell's source stands for what is left, and after LONGEST
   scatterings with that source alone: light that has been scattered so often in thick cells has
   forgotten where it came in. So every chain keeps its light to rounding. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "directions.h"
#include "phase.h"
#include "random.h"
#include "ray.h"
#include "step.h"
#include "walk.h"

#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif
#ifndef LONGEST
#error "LONGEST: scatterings of a chain"
#endif
#ifdef PHASE_BINS
#ifndef PHASE_STEPS
#error "PHASE_STEPS: bins of the phase function, even in the sine of half the angle"
#endif
#endif

/* Of a chain's sum: the components, and what it would bring from within a medium of radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)
#define ROULETTE R(0.3) /* weight under which a chain may end */

/* A thick cell's record: optical depth of its edge, albedo, what it emits, and its source; LINEAR: and
   how that changes across the cell along x, y, z. */
#define DEPTH 0
#define ALBEDO 1
#define EMISSION 2
#define SOURCE (EMISSION + EMITTERS)
#ifdef LINEAR
#define RECORD (SOURCE + 4 * COMPONENTS)
#else
#define RECORD (SOURCE + COMPONENTS)
#endif

/* What chains meet. All places are in cells from the cube's lower corner. */
typedef struct {
    __global const int *places;    /* of the box that thick cells lie in: number in the rim; -2 -
                                      number of a thick cell; -1 neither */
    __global const real *thick;    /* records */
    __global const real *light;    /* that leaves cells of the rim: [direction][cell][component] */
    int rim;                       /* cells of it */
    __global const real4 *directions; /* where it comes from, and the share of directions up to here
                                         in what a cell scatters along +y */
    __global const int *start;     /* of the directions, the one at which the share k / count lies */
    __global const int *nearest;   /* of the directions: see direction_near */
    int count;                     /* of directions */
    int4 low, shape;               /* the box */
    Boundary boundary;
} Near;

/* Adds light of known components, and what of it is from within. */
INLINE void score(real *sum, real weight, __global const real *light)
{
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) {
        sum[c] += weight * light[c];
        if (c < BOUNDARIES) outside += light[c];
    }
    sum[WITHIN] += weight * (R(1) - outside);
}

/* Adds the source of a thick cell, as it is at p. */
INLINE void score_source(real *sum, real weight, __global const real *record, real3 p, int3 cell)
{
#ifdef LINEAR
    const real x = p.x - cell.x - R(0.5), y = p.y - cell.y - R(0.5), z = p.z - cell.z - R(0.5);
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) {
        __global const real *source = record + SOURCE + c;
        const real here = source[0] + x * source[COMPONENTS] + y * source[2 * COMPONENTS]
            + z * source[3 * COMPONENTS];
        sum[c] += weight * here;
        if (c < BOUNDARIES) outside += here;
    }
    sum[WITHIN] += weight * (R(1) - outside);
#else
    score(sum, weight, record + SOURCE);
#endif
}

/* One flight from p in `cell`, along d, the way back to where the light comes from; scores what it
   brings. Of all that thick cells on its way scatter, `weight` becomes the sum and one place is
   drawn: its record is returned, and p and `cell` are moved there; 0 if they scatter nothing. Light
   scored and `weight` left make the `weight` that came in. */
INLINE __global const real *flight(
    real *sum, real *weight, real3 *p, int3 *cell, real3 d, int number, real u, const Near *m)
{
    __global const real *met = 0;
    const real3 from = *p;
    const real whole = *weight;
    real transmitted = R(1), scattered = R(0), at = R(0), share_there = R(0);
    Step s = step_from(*cell, from, d);
    for (;;) {
        const int x = s.x - m->low.x, y = s.y - m->low.y, z = s.z - m->low.z;
        if (x < 0 || y < 0 || z < 0 || x >= m->shape.x || y >= m->shape.y || z >= m->shape.z) {
            const int seen = boundary_seen(
                from.x, from.y, from.z, d.x, d.y, d.z, R(0), &m->boundary);
            for (int c = 0; c < BOUNDARIES; ++c)
                sum[c] += c == seen ? whole * transmitted : R(0);
            break;
        }
        const int place = m->places[(z * m->shape.y + y) * m->shape.x + x];
        if (place >= 0) {
            score(sum, whole * transmitted,
                  m->light + ((size_t)number * m->rim + place) * COMPONENTS);
            break;
        }
        if (place < -1) {
            __global const real *record = m->thick + (-2 - place) * RECORD;
            const real share = absorbed(record[DEPTH] * (step_end(&s) - s.t));
            real taken = transmitted * share;
            transmitted -= taken;
            /* What is left in the end goes no further than the last cell. */
            const int last = transmitted <= R(CUTOFF);
            taken += last ? transmitted : R(0);
            const real here = taken * record[ALBEDO];
            for (int e = 0; e < EMITTERS; ++e)
                sum[BOUNDARIES + e] += whole * taken * record[EMISSION + e];
            sum[WITHIN] += whole * (taken - here);
            scattered += here;
            /* One number serves all draws: what is left of it after each is as random as before. */
            const real chance = here > R(0) ? here / scattered : R(0);
            if (u < chance) {
                u = least(u / chance, R(0.9999999));
                met = record;
                at = s.t;
                share_there = share;
                *cell = (int3)(s.x, s.y, s.z);
            } else {
                u = (u - chance) / (R(1) - chance);
            }
            if (last) break;
        }
        step_on(&s, d);
    }
    *weight = whole * scattered;
    if (met) *p = from + (at + length_at(u, share_there, met[DEPTH])) * d;
    return met;
}

/* Weight of a direction for light scattered along `sight`: the directions are shared out as for a
   line of sight along +y. */
#if defined(PHASE_BINS) && defined(CAMERA_PINHOLE)
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

/* Follows one chain from p in a thick `cell`, where light is scattered along `sight`. */
INLINE void chain(
    real *sum, real weight, real3 p, int3 cell, real3 sight, uint4 counter, uint2 key,
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
            number = direction_at(unit(word.x), m->directions, m->start, m->count);
            d = m->directions[number].xyz;
            weight *= share_of(m->directions[number], sight, steps);
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
        __global const real *met = flight(sum, &weight, &p, &cell, d, number, unit(word.z), m);
        if (!met || !(weight > R(0))) return;
        /* Where it ends, and on average where it does not, the one source stands for what is left:
           no light is made or lost by chance. */
        if (event + 1 >= LONGEST) {
            score_source(sum, weight, met, p, cell);
            return;
        }
        if (weight < floor_) {
            if (unit(word.w) * floor_ >= weight) {
                score_source(sum, weight, met, p, cell);
                return;
            }
            score_source(sum, weight - floor_, met, p, cell);
            weight = floor_;
        }
    }
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
    __global const int *places, __global const real *thick, __global const real *light,
    const int rim,
    __global const real4 *directions, __global const int *start, __global const int *nearest,
    const int direction_count, const int4 box_low, const int4 box_shape,
    const int columns, const int rows, const real4 middle, const real pitch_x, const real pitch_z,
    const real distance, BOUNDARY_ARGUMENTS)
{
    const int item = get_global_id(0);
    if (item >= count) return;
    const int number = chosen[item];
    const Ray ray = ray_at(
        list[2 * number], list[2 * number + 1], columns, rows, middle, pitch_x, pitch_z, distance);
    const Near near = {places, thick, light, rim, directions, start, nearest, direction_count, box_low,
                       box_shape, BOUNDARY};
    const real3 from = (real3)(ray.px, ray.py, ray.pz);
    const real3 sight = (real3)(ray.dx, ray.dy, ray.dz);
    Chance chance;
    chance.shift0 = philox((uint4)(numbers[number], 0, 0xFFFFFFFFu, half_), key);
    chance.shift1 = philox((uint4)(numbers[number], 1, 0xFFFFFFFFu, half_), key);
    real sum[PARTS];
    for (int c = 0; c < PARTS; ++c) sum[c] = R(0);
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
        chain(sum, even, from + along * sight, (int3)((int)one[0], (int)one[1], (int)one[2]), sight,
              (uint4)(numbers[number], from_point + k, 0, half_), key, &chance, &near, table, steps);
    }
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = sum[c];
}
