/* Flights through thick cells and those around them, back to where light comes from; SIMD_WIDTH of them
   at once, cell by cell. */
#ifndef PATH_SEGMENT_H
#define PATH_SEGMENT_H

#include "boundary.h"
#include "cell_record.h"

#ifndef PENDING_READS
#error "PENDING_READS: reads of kept light that are made together"
#endif
#ifndef MIN_TRANSMISSION
#error "MIN_TRANSMISSION: transmission at which a flight ends"
#endif

/* What lies beside a cell of the region: down and up along x, y and z the number of the next cell, or
   BOUNDARY_THERE, or where the region ends its face, INTERFACE - number in the light that sweeps kept; then
   the number of the light in the cell itself, -1 where it was not kept. */
#define SIDES 8
#define OWN 6
#define BOUNDARY_THERE (-1)
#define INTERFACE (-2)

/* What flights meet. */
typedef struct {
    __global const int *places;    /* of the box that the cells lie in: their numbers; -1: others */
    __global const int4 *at;       /* of the cells: where they are in the cube */
    __global const int *beside;    /* SIDES a cell */
    __global const real *depth;    /* of the cells: optical depth of their edges, below 0: deep */
    __global const real *cells;    /* records */
    __global const real *light;    /* that comes through faces: [face][direction][component] */
    __global const real4 *directions; /* where it comes from, and the share of directions up to here
                                         in what a cell scatters along +y; neighbours are close by */
    __global const int *number_of; /* of the directions: theirs in `light` */
    __global const int *start;     /* of the directions, the one at which the share k / count lies */
    __global const int *nearest;   /* of the directions, -1: none: see direction_near */
    __global const real *means;    /* of the light kept in thick cells: [cell][component] */
    int first_own;                 /* number in `light` of the first of these */
    int count;                     /* of directions */
    int4 low, shape;               /* the box */
    Boundary boundary;
} ThickRegion;

/* Kept light that is still to be scored, and the sum of what was. Flights end anywhere in some hundred
   megabytes of it: one by one, a fifth of their time would be waiting for memory. */
typedef struct {
    __global const real *light[PENDING_READS];
    real weight[PENDING_READS];
    int count;
    real sum[PARTS];
#ifdef COUNTED
    int crossed; /* cells, by all flights */
#endif
} PendingScores;

INLINE void flush_scores(PendingScores *pending)
{
    for (int k = 0; k < pending->count; ++k) score(pending->sum, pending->weight[k], pending->light[k]);
    pending->count = 0;
}

INLINE void score_later(PendingScores *pending, real weight, __global const real *light)
{
    SOON_READ(light);
    pending->weight[pending->count] = weight;
    pending->light[pending->count] = light;
    if (++pending->count == PENDING_READS) flush_scores(pending);
}

/* Number, in the region, of a cell that is given by its place in the cube. */
INLINE int number_in(int3 cell, const ThickRegion *m)
{
    const int x = cell.x - m->low.x, y = cell.y - m->low.y, z = cell.z - m->low.z;
    return m->places[(z * m->shape.y + y) * m->shape.x + x];
}

/* Flights, one a lane. Lengths are in cells from where each began. */
typedef struct {
    lane_t tx, ty, tz;    /* where it meets the far sides of its cell */
    lane_t dx, dy, dz;    /* how far it is from side to side */
    lane_t ax, ay, az;    /* how far it gets along x, y, z in a length of 1 */
    lane_i ux, uy, uz;    /* mask: upwards */
    lane_t t;             /* where it is */
    lane_t weight, floor; /* what is left of it; with how much it ends */
    lane_t scattered;     /* what deep cells on the way have scattered */
    lane_t u;             /* chance: serves all draws of one of these, and of a place in it */
    lane_t x, y, z, share; /* of the one drawn: where in it the flight comes in; what it takes out */
    lane_i met;           /* its number, -1: none */
    lane_i cell;          /* number */
    lane_i active;         /* mask */
    real3 way[SIMD_WIDTH];    /* where light comes from */
} Segments;

/* How one ended: with what is left of it at `beside` of its cell, or within that. */
typedef struct {
    lane_i ended;  /* mask */
    lane_i within; /* mask: nothing is left */
    lane_i beside;
} SegmentEnd;

INLINE Segments no_segments(void)
{
    Segments f;
    f.tx = f.ty = f.tz = (lane_t)R(1);
    f.dx = f.dy = f.dz = f.ax = f.ay = f.az = (lane_t)R(0);
    f.ux = f.uy = f.uz = f.met = f.cell = f.active = (lane_i)0;
    f.t = f.weight = f.floor = f.scattered = f.u = f.x = f.y = f.z = f.share = (lane_t)R(0);
    return f;
}

/* One axis of a line from `place` in a cell, 0 to 1; the far side of one that runs along it is never
   met. */
INLINE void set_axis(
    lane_t *meets, lane_t *across, lane_t *gets, lane_i *up, int lane, real place, real slope)
{
    const real part = most(slope > R(0) ? R(1) - place : place, R(0));
    const int along_it = slope == R(0);
    const real size = along_it ? part * R(1e-30) : size_of(slope);
    const real side = along_it ? R(0) : R(1) / size;
    LANE(*meets, lane) = along_it ? R(1e30) : part * side;
    LANE(*across, lane) = side;
    LANE(*gets, lane) = size;
    LANE_I(*up, lane) = -(slope > R(0));
}

/* Begins a flight from p in a cell, 0 to 1 along x, y, z. */
INLINE void start_segment(Segments *f, int lane, int cell, real3 p, real3 d, real weight, real u)
{
    set_axis(&f->tx, &f->dx, &f->ax, &f->ux, lane, p.x, d.x);
    set_axis(&f->ty, &f->dy, &f->ay, &f->uy, lane, p.y, d.y);
    set_axis(&f->tz, &f->dz, &f->az, &f->uz, lane, p.z, d.z);
    LANE(f->t, lane) = R(0);
    LANE(f->weight, lane) = weight;
    LANE(f->floor, lane) = weight * R(MIN_TRANSMISSION);
    LANE(f->scattered, lane) = R(0);
    LANE(f->u, lane) = u;
    LANE_I(f->met, lane) = -1;
    LANE_I(f->cell, lane) = cell;
    LANE_I(f->active, lane) = -1;
    f->way[lane] = d;
}

/* Place in the cell, along one axis, a way before the far side. */
#define PLACE(left, gets, up) ((up) ? R(1) - (left) * (gets) : (left) * (gets))

/* Crosses a cell with each flight, and scores what it sends. Of all that deep cells on a flight's way
   scatter, `scattered` becomes the sum and one place is drawn. Light scored, what is left and
   `scattered` make the weight that a flight began with. */
INLINE SegmentEnd cross_cell(real *sum, PendingScores *pending, Segments *f, const ThickRegion *m)
{
    const lane_t depth_there = from_table(m->depth, f->cell);
    const lane_i deep = depth_there < R(0);
    const lane_t depth = deep ? -depth_there : depth_there;
    const lane_t end = lower(f->tx, lower(f->ty, f->tz));
    const lane_t length = end - f->t;
    const lane_t t = depth * length;
    const lane_t share = absorbed(t);
    lane_t taken = f->weight * share;
    const lane_t left = f->weight - taken;
    SegmentEnd e;
    /* What is left in the end goes no further than the last cell. */
    e.within = left <= f->floor;
    taken = e.within ? f->weight : taken;
    lane_t x = taken, y = taken, z = taken;
#ifdef LINEAR_SOURCE
    /* Where it is seen: less deep in the cell than in the middle of the way. */
    const lane_t middle = f->t + R(0.5) * length;
    const lane_t nearer = f->weight * t * rising(t, share, mean_transmission(t, share)) * length;
    x = taken * (R(0.5) - (f->tx - middle) * f->ax) - nearer * f->ax;
    y = taken * (R(0.5) - (f->ty - middle) * f->ay) - nearer * f->ay;
    z = taken * (R(0.5) - (f->tz - middle) * f->az) - nearer * f->az;
    x = f->ux ? x : -x;
    y = f->uy ? y : -y;
    z = f->uz ? z : -z;
#endif
    Light sent = no_light();
    real all = R(0);
    lane_t albedo = (lane_t)R(0); /* of deep cells that are crossed */
    UNROLL for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        if (!LANE_I(f->active, lane)) continue;
#ifdef COUNTED
        ++pending->crossed;
#endif
        __global const real *it = m->cells + (size_t)LANE_I(f->cell, lane) * RECORD;
        const real here = LANE(taken, lane);
        if (LANE_I(deep, lane)) {
            add_emission(&sent, here, it);
            LANE(albedo, lane) = it[ALBEDO];
            all += here * (R(1) - it[ALBEDO]);
        } else {
            const real3 off = (real3)(LANE(x, lane), LANE(y, lane), LANE(z, lane));
            add_source(&sent, here, off, f->way[lane], it);
            all += here;
        }
    }
    score_light(sum, all, &sent);
    if (any_of(deep)) {
        const lane_t here = taken * albedo;
        f->scattered += here;
        const lane_t chance = here > R(0) ? here / f->scattered : (lane_t)R(0);
        const lane_i drawn = f->u < chance;
        /* What is left of a chance after a draw is as random as before. */
        f->u = drawn ? lower(f->u / chance, (lane_t)R(0.9999999))
            : (f->u - chance) / (R(1) - chance);
        f->met = drawn ? f->cell : f->met;
        f->share = drawn ? share : f->share;
        f->x = drawn ? PLACE(f->tx - f->t, f->ax, f->ux) : f->x;
        f->y = drawn ? PLACE(f->ty - f->t, f->ay, f->uy) : f->y;
        f->z = drawn ? PLACE(f->tz - f->t, f->az, f->uz) : f->z;
    }
    const lane_i along_x = (f->tx <= f->ty) & (f->tx <= f->tz);
    const lane_i along_y = (f->ty <= f->tz) & !along_x;
    const lane_i side = along_x ? -f->ux : along_y ? 2 - f->uy : 4 - f->uz;
    e.beside = from_numbers(m->beside, f->cell * SIDES + side);
    e.ended = f->active & (e.within | (e.beside < 0));
    const lane_i goes = f->active & !e.ended;
    f->tx += (goes & along_x) ? f->dx : (lane_t)R(0);
    f->ty += (goes & along_y) ? f->dy : (lane_t)R(0);
    f->tz += (goes & !along_x & !along_y) ? f->dz : (lane_t)R(0);
    f->cell = goes ? e.beside : f->cell;
    /* The depth alone is waited for; what the cells send is read after much else. */
    UNROLL for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        __global const real *soon = m->cells + (size_t)LANE_I(f->cell, lane) * RECORD;
        UNROLL for (int k = 0; k < RECORD; k += LINE) SOON_READ(soon + k);
    }
    f->t = end;
    f->weight = left;
    return e;
}

/* Scores what is left of a flight that ended. */
INLINE void end_segment(
    real *sum, PendingScores *pending, const Segments *f, int lane, const SegmentEnd *e, int number, const ThickRegion *m)
{
    if (LANE_I(e->within, lane)) return;
    const real weight = LANE(f->weight, lane);
    const int beside = LANE_I(e->beside, lane);
    if (beside != BOUNDARY_THERE) {
        score_later(pending, weight, m->light + ((size_t)(INTERFACE - beside) * m->count + number) * COMPONENTS);
        return;
    }
    const int4 cell = m->at[LANE_I(f->cell, lane)];
    const real3 d = f->way[lane];
    const real t = LANE(f->t, lane);
    const real x = PLACE(LANE(f->tx, lane) - t, LANE(f->ax, lane), d.x > R(0));
    const real y = PLACE(LANE(f->ty, lane) - t, LANE(f->ay, lane), d.y > R(0));
    const real z = PLACE(LANE(f->tz, lane) - t, LANE(f->az, lane), d.z > R(0));
    const int seen = boundary_seen(
        cell.x + x, cell.y + y, cell.z + z, d.x, d.y, d.z, R(0), &m->boundary);
    for (int c = 0; c < BOUNDARIES; ++c) sum[c] += c == seen ? weight : R(0);
}

#endif
