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
   has forgotten where it came in. So every chain keeps its light to rounding. */

#include "attenuation.h"
#include "boundary.h"
#include "components.h"
#include "directions.h"
#include "moments.h"
#include "phase.h"
#include "random.h"
#include "ray.h"
#include "step.h"
#include "walk.h"

#ifndef LONGEST
#error "LONGEST: flights of a chain"
#endif
#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
#endif

/* Of a chain's sum: the components, and what it would bring from within a medium of radiance 1. */
#define WITHIN COMPONENTS
#define PARTS (COMPONENTS + 1)
#define ROULETTE R(0.3) /* weight under which a chain may end */

/* A cell's record: optical depth of its edge; albedo of a deep cell, 0 of others; what it emits, if it
   is deep; and the source of the last sweep: S_0 of all components, SLOPED: its moments (moments.h),
   LINEAR: how S_0 changes across the cell along x, y, z. Of deep cells, the light that is scattered in
   the same form, not yet times the albedo, and without what is emitted. */
#define DEPTH 0
#define ALBEDO 1
#define EMISSION 2
#define SOURCE (EMISSION + EMITTERS)
#ifdef SLOPED
#define ACROSS_IT (SOURCE + (1 + MOMENTS) * COMPONENTS)
#else
#define ACROSS_IT (SOURCE + COMPONENTS)
#endif
#ifdef LINEAR
#define RECORD (ACROSS_IT + 3 * COMPONENTS)
#else
#define RECORD ACROSS_IT
#endif

/* Numbers that a cell has in the light kept by sweeps: of six faces, and of the light in it. */
#define FACES 8
#define OWN 6

/* What flights meet. All places are in cells from the cube's lower corner. */
typedef struct {
    __global const int *places;    /* of the box that the cells lie in: their numbers; -1: others */
    __global const int *faces;     /* of them to others: their numbers, down and up along x, y, z;
                                      and of the light in the cell itself; FACES a cell */
    __global const real *cells;    /* records */
    __global const real *light;    /* that comes through them: [direction][face][component] */
    int rim;                       /* faces of one direction */
    __global const real4 *directions; /* where it comes from, and the share of directions up to here
                                         in what a cell scatters along +y; neighbours are close by */
    __global const int *number_of; /* of the directions: theirs in `light` */
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

/* Adds what of a cell's source is seen along d: `all` of S_0 and its moments, and of how it changes
   along x, y, z as much as the place lies off the cell's middle, times `all`. */
INLINE void score_source(real *sum, real all, real3 place, real3 d, __global const real *record)
{
    __global const real *source = record + SOURCE;
    /* Loops that do one thing each become vector instructions. */
    real light[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c) light[c] = all * source[c];
#ifdef SLOPED
    const real sent[MOMENTS] = MOMENTS_SENT(d);
    for (int m = 0; m < MOMENTS; ++m) {
        const real counts = all * sent[m];
        for (int c = 0; c < COMPONENTS; ++c) light[c] += counts * source[c + (1 + m) * COMPONENTS];
    }
#endif
#ifdef LINEAR
    __global const real *change = record + ACROSS_IT;
    for (int c = 0; c < COMPONENTS; ++c)
        light[c] += place.x * change[c] + place.y * change[c + COMPONENTS]
            + place.z * change[c + 2 * COMPONENTS];
#endif
    real outside = R(0);
    for (int c = 0; c < COMPONENTS; ++c) sum[c] += light[c];
    for (int c = 0; c < BOUNDARIES; ++c) outside += light[c];
    sum[WITHIN] += all - outside;
}

/* Adds what the cell at `s` sends that a flight from p along d crosses over `length`, of optical depth
   t, which takes out `share`. */
INLINE void score_cell(
    real *sum, real weight, __global const real *record, real3 p, real3 d, const Step *s, real length,
    real t, real share)
{
    const real all = weight * share;
    real3 place = (real3)(R(0));
#ifdef LINEAR
    /* Where it is seen: less deep in the cell than in the middle of the way. */
    const real middle = s->t + R(0.5) * length;
    const real nearer = weight * t * rising(t, share, mean_transmission(t, share)) * length;
    place.x = all * (p.x + middle * d.x - s->x - R(0.5)) - nearer * d.x;
    place.y = all * (p.y + middle * d.y - s->y - R(0.5)) - nearer * d.y;
    place.z = all * (p.z + middle * d.z - s->z - R(0.5)) - nearer * d.z;
#endif
    score_source(sum, all, place, d, record);
}

/* One flight from p in `cell`, along d, the way back to where the light comes from; scores what it
   brings. Of all that deep cells on its way scatter, `weight` becomes the sum and one place is drawn:
   its record is returned, and p and `cell` are moved there; 0 if they scatter nothing. Light scored
   and `weight` left make the `weight` that came in. */
INLINE __global const real *flight(
    real *sum, real *weight, real3 *p, int3 *cell, real3 d, int number, real u, const Near *m)
{
    __global const real *met = 0;
    const real3 from = *p;
    const real whole = *weight;
    real transmitted = R(1), scattered = R(0), at = R(0), share_there = R(0);
    Step s = step_from(*cell, from, d);
    int inside = 0, face = 0;
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
        if (place < 0) { /* it came from one of the cells: there it began */
            score(sum, whole * transmitted,
                  m->light
                      + ((size_t)number * m->rim + m->faces[FACES * inside + face]) * COMPONENTS);
            break;
        }
        inside = place;
        __global const real *record = m->cells + (size_t)place * RECORD;
        if (record[DEPTH] > R(0)) {
            const real length = step_end(&s) - s.t;
            const real t = record[DEPTH] * length;
            const real share = absorbed(t);
            real taken = transmitted * share;
            const real left = transmitted - taken;
            /* What is left in the end goes no further than the last cell. */
            const int last = left <= R(CUTOFF);
            if (record[ALBEDO] > R(0)) {
                taken += last ? left : R(0);
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
            } else {
                score_cell(sum, whole * transmitted, record, from, d, &s, length, t, share);
                if (last) score(sum, whole * left, record + SOURCE);
            }
            if (last) break;
            transmitted = left;
        }
        face = step_on(&s, d);
    }
    *weight = whole * scattered;
    if (met) *p = from + (at + length_at(u, share_there, met[DEPTH])) * d;
    return met;
}

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

/* Number of the light that the last sweep had in a thick cell; -1: it was not kept. */
INLINE int own_number(int3 cell, const Near *m)
{
    const int x = cell.x - m->low.x, y = cell.y - m->low.y, z = cell.z - m->low.z;
    return m->faces[FACES * m->places[(z * m->shape.y + y) * m->shape.x + x] + OWN];
}

/* Follows one chain from p in a thick `cell`, where light is scattered along `sight`: what it brings
   more than the light in that cell along its first direction, as the last sweep had it. That varies
   far less; what all directions bring of it is known (`expected`). */
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
            const int drawn = direction_at(unit(word.x), m->directions, m->start, m->count);
            d = m->directions[drawn].xyz;
            weight *= share_of(m->directions[drawn], sight, steps);
            number = m->number_of[drawn];
            const int own = own_number(cell, m);
            if (own >= 0)
                score(sum, -weight, m->light + ((size_t)number * m->rim + own) * COMPONENTS);
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
        /* Summed apart: of a long chain the parts are far less than the sum of all. */
        real of_chain[PARTS];
        for (int c = 0; c < PARTS; ++c) of_chain[c] = R(0);
        chain(of_chain, even, from + along * sight, (int3)((int)one[0], (int)one[1], (int)one[2]), sight,
              (uint4)(numbers[number], from_point + k, 0, half_), key, &chance, &near, table, steps);
        for (int c = 0; c < PARTS; ++c) sum[c] += of_chain[c];
    }
    for (int c = 0; c < PARTS; ++c) means[c * count + item] = sum[c];
}
