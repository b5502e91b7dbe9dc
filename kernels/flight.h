/* One flight through thick cells and those around them, back to where light comes from. */
#ifndef FLIGHT_H
#define FLIGHT_H

#include "boundary.h"
#include "record.h"

#ifndef PENDING
#error "PENDING: reads of kept light that are made together"
#endif
#ifndef CUTOFF
#error "CUTOFF: transmission at which a ray ends"
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

/* Kept light that is still to be scored, and the sum of what was. Flights end anywhere in some hundred
   megabytes of it: one by one, a fifth of their time would be waiting for memory. */
typedef struct {
    __global const real *light[PENDING];
    real weight[PENDING];
    int count;
    real sum[PARTS];
#ifdef COUNTED
    int crossed; /* cells, by all flights */
#endif
} Ends;

INLINE void score_pending(Ends *ends)
{
    for (int k = 0; k < ends->count; ++k) score(ends->sum, ends->weight[k], ends->light[k]);
    ends->count = 0;
}

INLINE void score_later(Ends *ends, real weight, __global const real *light)
{
    ends->weight[ends->count] = weight;
    ends->light[ends->count] = light;
    if (++ends->count == PENDING) score_pending(ends);
}

/* Number of the light that the last sweep had in a thick cell; -1: it was not kept. */
INLINE int own_number(int3 cell, const Near *m)
{
    const int x = cell.x - m->low.x, y = cell.y - m->low.y, z = cell.z - m->low.z;
    return m->faces[FACES * m->places[(z * m->shape.y + y) * m->shape.x + x] + OWN];
}

/* One flight from p in `cell`, along d, the way back to where the light comes from; scores what it
   brings, kept light in `ends`. Of all that deep cells on its way scatter, `weight` becomes the sum and
   one place is drawn: its record is returned, and p and `cell` are moved there; 0 if they scatter
   nothing. Light scored and `weight` left make the `weight` that came in. */
INLINE __global const real *flight(
    real *sum, Ends *ends, real *weight, real3 *p, int3 *cell, real3 d, int number, real u,
    const Near *m)
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
            const size_t end = (size_t)number * m->rim + m->faces[FACES * inside + face];
            score_later(ends, whole * transmitted, m->light + end * COMPONENTS);
            break;
        }
        inside = place;
#ifdef COUNTED
        ++ends->crossed;
#endif
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

#endif
